"""Adaptive control: the LQR of the stiffness that recursive least squares identify."""

import numpy as np

from agents.control.controller import Acted, Law, Memory, chosen
from agents.control.feedback import Feedback
from agents.control.model import covariance
from agents.control.observed_state import missed_covariance
from agents.control.scene import PARTS, drawn_but, nominal, plant_of
from agents.controllers.gain_scheduling import Schedule
from agents.controllers.registry import Entry, without_weight
from agents.controllers.searched import DECADES, searched
from mm_gym import Scene
from mm_gym.arrays import Array

STIFFNESS = "carriage.stiffness"

FACTORS = np.linspace(0.5, 2.0, 16)
"""Stiffnesses over that which the scene states, at which regulators are designed."""

MEMORY = 1000.0
"""Control steps in which an estimate forgets: a rig stays what it is within an episode."""

UNSURE = 0.2
"""Standard deviation of both parameters, over what they are relative to, when an episode begins."""


class AdaptiveLQR(Law):
    """Identify stiffness and damping of the carriage in each episode, and act as the LQR of these.

    The model predicts each step's end; what the carriage's velocity is off by is linear in the
    errors of stiffness and damping, which recursive least squares with forgetting estimate. The
    estimate is taken for the truth (certainty equivalence). Åström and Wittenmark, *Adaptive
    Control*, 2nd ed. (1995), chapters 2 and 3. The schedule is of regulators over the stiffness,
    and the factor is of all gains.
    """

    def __init__(self, scene: Scene, schedule: Schedule, factor: float) -> None:
        self.name = f"adaptive LQR, gains times {factor:.2g}"
        self.schedule, self.factor, self.kept = schedule, factor, float(np.exp(-1.0 / MEMORY))
        self.turn, self.push = plant_of(scene).discrete()
        self.stiffness = nominal(scene, STIFFNESS)
        self.step = scene.control.time_step
        damping = np.sqrt(self.stiffness * nominal(scene, "carriage.mass"))
        # What 100 % of either parameter adds to the velocity in a step, over the means of x1 and
        # v1: the errors act as a force that is held does.
        self.effects = -self.push[2, 0] * np.array([self.stiffness, damping])
        # What differs in a rig is no noise, but what is to be identified.
        stated = scene.replace(randomization=drawn_but(scene, *PARTS))
        self.noise = (covariance(stated) + missed_covariance(stated))[2, 2]

    def begin(self, lanes: int) -> Memory:
        spread = np.tile(np.eye(2) * UNSURE**2, (lanes, 1, 1))
        return {
            "begun": np.zeros(lanes, np.bool_),
            "state": np.zeros((lanes, 4)),
            "errors": np.zeros((lanes, 2)),
            "spread": spread,
        }

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        errors, spread = self._identified(memory, state, applied)
        begun = memory["begun"]
        errors = chosen(begun, errors, memory["errors"])
        spread = chosen(begun, spread, memory["spread"])
        found = self.stiffness * (1.0 + errors[:, 0])
        return self.factor * self.schedule.action(found, state), {
            "begun": np.ones_like(begun),
            "state": state.copy(),
            "errors": errors,
            "spread": spread,
        }

    def _identified(self, memory: Memory, state: Array, applied: Array) -> tuple[Array, Array]:
        """Return errors (lanes, 2) and their covariance after the last step, known by its end."""
        before, errors, spread = memory["state"], memory["errors"], memory["spread"]
        predicted = before @ self.turn[2] + applied[:, 0] * self.push[2, 0]
        change, both = state - before, 0.5 * (before + state)
        # Means of Hermite's cubic, of error (step w)^4 / 720.
        means = both[:, 0] - self.step / 12.0 * change[:, 2], change[:, 0] / self.step
        moved = self.effects * np.stack(means, axis=1)
        missed = state[:, 2] - predicted - np.sum(moved * errors, axis=1)
        reached = np.einsum("lij,lj->li", spread, moved)
        gain = reached / (self.noise * self.kept + np.sum(moved * reached, axis=1))[:, None]
        spread = (spread - gain[:, :, None] * reached[:, None]) / self.kept
        # Where nothing moves, forgetting alone would make it unsure without bound.
        trace = np.trace(spread, axis1=1, axis2=2)
        spread = spread * np.minimum(1.0, 2.0 * UNSURE**2 / trace)[:, None, None]
        low, high = FACTORS[0] - 1.0, FACTORS[-1] - 1.0
        return np.clip(errors + gain * missed[:, None], low, high), spread


def best_adaptive_lqr(scene: Scene) -> Feedback:
    """Search a factor of all gains over four decades."""
    schedule = Schedule(scene, FACTORS * nominal(scene, STIFFNESS))
    return searched(scene, lambda e: AdaptiveLQR(scene, schedule, 10.0**e), DECADES)


def _refused(scene: Scene) -> str | None:
    if STIFFNESS not in scene.randomization:
        return f"which identifies a stiffness; randomization: {STIFFNESS} is not drawn"
    if scene.actuation.is_between:
        return "which pushes against the ground; actuation.force.between: got 'masses'"
    if scene.carriage.mass == 0.0:
        return "which identifies a motion; carriage.mass: got 0"
    return without_weight(scene)


ENTRIES = (Entry("adaptive-lqr", ("force",), best_adaptive_lqr, 15, refuses=_refused),)
