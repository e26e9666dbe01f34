"""Feedback linearisation: cancel the cubic carriage spring, and regulate what is left."""

from collections.abc import Mapping

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import STATES, nominal
from agents.controllers.lqr import LQR
from agents.controllers.registry import Free, Tunable, without_weight
from mm_gym import Scene
from mm_gym.arrays import Array


class FeedbackLinearisation(Law):
    """Cancel the cubic term of the carriage's spring, and feed back what is linear by the LQR.

    The force is that of the spring, k1 beta x1^3, less the regulator's, clipped together. It is of
    the displacement some time ahead: a force is held over a control step. Slotine and Li, *Applied
    Nonlinear Control* (1991), chapter 6.
    """

    name = "feedback linearisation"

    def __init__(self, scene: Scene, numbers: Mapping[str, float]) -> None:
        regulator, stiffness = LQR(scene), nominal(scene, "carriage.stiffness")
        self.limit = Command(scene, "force").high
        self.ahead = numbers["lead"] * scene.control.time_step
        self.cubic = numbers["cancelled"] * stiffness * nominal(scene, CUBIC)
        self.gain = np.zeros(4)
        for k, gain in zip(regulator.design.states, regulator.design.gain[0], strict=True):
            self.gain[k] = numbers[f"gain_{STATES[k]}"] * gain

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        displacement = state[:, 0] + self.ahead * state[:, 2]
        force = self.cubic * displacement**3 - state @ self.gain
        return np.clip(force / self.limit, -1.0, 1.0)[:, None], memory


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return the factors of the cancelled force and of the regulator's gains, and the lead [steps].

    Gains are of the states that matter to the cost.
    """
    gains = [f"gain_{STATES[k]}" for k in LQR(scene).design.states]
    return {
        "cancelled": Free(1.0, 0.3),
        "lead": Free(0.0, 0.5, ratio=False),
        **{name: Free(1.0, 0.5, ratio=False) for name in gains},
    }


def _refused(scene: Scene) -> str | None:
    if not np.any(scene.range_of(CUBIC, scene.carriage.cubic_coefficient)):
        return f"which cancels a cubic spring; {CUBIC}: got 0"
    if scene.actuation.is_between:
        return "which pushes against the ground; actuation.force.between: got 'masses'"
    return without_weight(scene)


CUBIC = "carriage.cubic_coefficient"

ENTRIES = (
    Tunable("feedback-linearisation", free_numbers, FeedbackLinearisation).entry(
        ("force",), 13, refuses=_refused
    ),
)
