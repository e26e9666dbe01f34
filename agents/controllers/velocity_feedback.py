"""Velocity feedback: an active damper, whose force opposes the carriage's velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import require_actuator, require_number

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class VelocityFeedback:
    """Direct velocity feedback, u = -gain v1, within the force limit.

    It takes energy out whatever the springs. Balas, *Direct velocity feedback control of large
    space structures*, J. Guid. Control 2 (1979).
    """

    def __init__(self, scene: Scene, gain: float) -> None:
        require_actuator(scene, "force")
        actuator = scene.actuation.force
        assert actuator is not None  # noqa: S101 - as required
        require_number("gain", gain)
        self.name = f"velocity feedback, {gain:.2g} N s/m"
        self.gain = gain / actuator.limit

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the force over the limit."""
        return np.clip(-self.gain * state[:, 2:3], -1.0, 1.0)
