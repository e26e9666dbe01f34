"""Velocity feedback: an active damper, whose force opposes the carriage's velocity."""

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import require_number
from agents.controllers.registry import Entry, unless
from agents.controllers.searched import over_decades
from mm_gym import Scene
from mm_gym.arrays import Array


class VelocityFeedback(Law):
    """Direct velocity feedback, u = -gain v1, within the force limit.

    It takes energy out whatever the springs. Balas, *Direct velocity feedback control of large
    space structures*, J. Guid. Control 2 (1979).
    """

    def __init__(self, scene: Scene, gain: float) -> None:
        self.command = Command(scene, "force")
        require_number("gain", gain)
        self.name, self.gain = f"velocity feedback, {gain:.2g} N s/m", gain

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return self.command(-self.gain * state[:, 2], self.command.present(applied)), memory


best_velocity_feedback = over_decades(  # of the carriage's critical damping
    lambda scene, ratio: VelocityFeedback(
        scene, 2.0 * np.sqrt(scene.carriage.mass * scene.carriage.stiffness) * ratio
    )
)

_refused = unless(
    lambda scene: scene.carriage.mass > 0.0,
    "whose gain is over the carriage's critical damping; carriage.mass: got 0",
)

ENTRIES = (Entry("velocity-feedback", ("force",), best_velocity_feedback, 11, refuses=_refused),)
