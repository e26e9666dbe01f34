"""Velocity feedback: an active damper, whose force opposes the carriage's velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.actuators import Command
from agents.controllers.controller import Law, require_number
from agents.controllers.registry import Entry
from agents.controllers.searched import DECADES, searched

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Memory, Values
    from agents.controllers.feedback import Feedback
    from mm_gym import Scene


class VelocityFeedback(Law):
    """Direct velocity feedback, u = -gain v1, within the force limit.

    It takes energy out whatever the springs. Balas, *Direct velocity feedback control of large
    space structures*, J. Guid. Control 2 (1979).
    """

    def __init__(self, scene: Scene, gain: float) -> None:
        limit = Command(scene, "force").high
        require_number("gain", gain)
        self.name = f"velocity feedback, {gain:.2g} N s/m"
        self.gain = gain / limit

    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the force over the limit."""
        return np.clip(-self.gain * state[:, 2:3], -1.0, 1.0), memory


def best_velocity_feedback(scene: Scene) -> Feedback:
    """Search the gain over four decades."""
    critical = 2.0 * np.sqrt(scene.carriage.mass * scene.carriage.stiffness)
    return searched(
        scene, lambda exponent: VelocityFeedback(scene, critical * 10.0**exponent), DECADES
    )


ENTRIES = (Entry("velocity-feedback", ("force",), best_velocity_feedback, 11),)
