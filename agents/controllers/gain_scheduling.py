"""Gain scheduling: the LQR of the stiffness that the carriage's spring has at the moment."""

import numpy as np

from agents.control.controller import Acted, Law, Memory
from agents.control.feedback import Feedback
from agents.control.scene import drawn_but, nominal
from agents.controllers.lqr import LQR
from agents.controllers.registry import Entry, without_weight
from agents.controllers.searched import DECADES, searched
from mm_gym import Scene
from mm_gym.arrays import Array

FACTORS = 2.0 ** np.linspace(-2.0, 5.0, 15)
"""Stiffnesses over that at rest, at which regulators are designed."""

LINEAR, CUBIC = "carriage.linear_coefficient", "carriage.cubic_coefficient"


class Schedule:
    """The LQR's gains over the stiffness of the carriage.

    Regulators are designed at stiffnesses (n,), rising [N/m]; between them gains are interpolated.
    """

    def __init__(self, scene: Scene, stiffnesses: Array) -> None:
        self.stiffnesses = stiffnesses
        self.gains: Array = np.zeros((len(stiffnesses), 4))
        linear = {LINEAR: 1.0, CUBIC: 0.0}
        drawn = drawn_but(scene, "carriage.stiffness", LINEAR, CUBIC)
        for row, stiffness in zip(self.gains, stiffnesses, strict=True):
            own = {"carriage.stiffness": float(stiffness), **linear}
            law = LQR(scene.replace(randomization=drawn, **own))
            row[list(law.design.states)] = law.design.gain[0] / law.limit

    def action(self, stiffness: Array, state: Array) -> Array:
        total = np.zeros(len(state))
        for gains, values in zip(self.gains.T, state.T, strict=True):
            total = total - np.interp(stiffness, self.stiffnesses, gains) * values
        return total[:, None]


class GainScheduledLQR(Law):
    """Feed the state back through the LQR of the stiffness at the present amplitude.

    Over a harmonic motion of amplitude A the cubic spring has the stiffness κ of a linear one,
    k1 times linear coefficient + 3/4 cubic coefficient A², with A² = x1² + m1 v1² / κ. Khalil,
    *Nonlinear Systems*, 3rd ed. (2002), sections 7.2 and 12.5. The factor is of all gains.
    """

    def __init__(self, scene: Scene, schedule: Schedule, factor: float) -> None:
        self.name = f"gain-scheduled LQR, gains times {factor:.2g}"
        self.schedule, self.factor = schedule, factor
        stiffness, self.mass = (nominal(scene, f"carriage.{one}") for one in ("stiffness", "mass"))
        self.linear, self.cubic = (stiffness * nominal(scene, one) for one in (LINEAR, CUBIC))

    def stiffness(self, state: Array) -> Array:
        """Return the stiffness (lanes,) at the amplitude of states: the root of its equation."""
        of_displacement = self.linear + 0.75 * self.cubic * state[:, 0] ** 2
        of_velocity = 0.75 * self.cubic * self.mass * state[:, 2] ** 2
        square = np.maximum(of_displacement**2 + 4.0 * of_velocity, 0.0)
        return 0.5 * (of_displacement + np.sqrt(square))

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return self.factor * self.schedule.action(self.stiffness(state), state), memory


def best_gain_scheduled_lqr(scene: Scene) -> Feedback:
    """Search a factor of all gains over four decades."""
    schedule = Schedule(
        scene, FACTORS * nominal(scene, "carriage.stiffness") * nominal(scene, LINEAR)
    )
    return searched(
        scene, lambda exponent: GainScheduledLQR(scene, schedule, 10.0**exponent), DECADES
    )


def _refused(scene: Scene) -> str | None:
    if not np.any(scene.range_of(CUBIC, scene.carriage.cubic_coefficient)):
        return f"whose stiffness changes with the amplitude; {CUBIC}: got 0"
    if np.min(scene.range_of(LINEAR, scene.carriage.linear_coefficient)) <= 0.0:
        return f"which regulates about rest; {LINEAR}: allowed: greater than 0"
    if scene.carriage.mass == 0.0:
        return "which follows an amplitude; carriage.mass: got 0"
    return without_weight(scene)


ENTRIES = (Entry("gain-scheduled-lqr", ("force",), best_gain_scheduled_lqr, 14, refuses=_refused),)
