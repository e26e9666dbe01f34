"""The LQG of a force whose rate is limited or commanded: the rate has a weight of its own."""

from itertools import product

import control
import numpy as np

from agents.control.controller import Acted, Info, Memory, Observation
from agents.control.kalman_filter import solvable, state_units
from agents.control.scene import plant_of
from agents.controllers.lqg import DISTURBANCES, ReachedLQG, regulated_part, weighed, without_force
from agents.controllers.registry import Entry
from agents.controllers.searched import cheapest, chosen_of, cost_of
from mm_gym import LinearSystem, Scene
from mm_gym.arrays import Array

DECADES = np.array([-1.0, 0.0, 1.0])
"""Exponents of both weights that are tried together; each is then searched between its neighbours.
"""


class RateLimitedLQG(ReachedLQG):
    """The LQG whose regulator weighs how fast the force changes, and whose filter knows the limit.

    The applied force is a state, and the way d that is left to the command is the input. So what a
    rate limit keeps a force from doing is hardly asked for. Rawlings, Mayne and Diehl, *Model
    Predictive Control*, 2nd ed. (2017), chapter 1. Raise `DesignError` as for `lqg.design_lqg`.

    Parameters
    ----------
    effort
        Factor of the force's weight in the reward.
    rate
        Weight of the rate over its limit, squared, over the force's weight in the reward.
    """

    def __init__(self, scene: Scene, effort: float, rate: float, unmodelled: float) -> None:
        super().__init__(scene, effort, unmodelled)
        self.name = f"rate-limited LQG, weights times {effort:.2g} and {rate:.2g}"
        of_rate = rate * scene.objective.effort_weight * (self.share / self.command.travel) ** 2
        found = _gain(self.designed, self.design.system, of_rate, self.limit)
        self.of_state, self.of_force = found

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        memory = self.corrected(memory, observation)
        applied, asked = (memory[name][:, 0] for name in ("applied", "asked"))
        law = self.design.regulator
        force = (1.0 - self.of_force) * applied + self.of_force * law.held
        force = force - (memory["estimate"] - law.rest) @ self.of_state
        return self.command(force, asked), memory


def _gain(scene: Scene, system: LinearSystem, rate: float, limit: float) -> tuple[Array, float]:
    """Return the gains of d on all states and on the applied force, with a weight of d [1/N^2]."""
    plant = plant_of(scene)
    regulated, a, b, own = regulated_part(plant, scene, None, system)
    stage, x = own.ahead(a, b), state_units(scene, plant, system)[list(regulated)]
    names = [system.states[k].name for k in regulated]
    state, cross = stage.state * np.outer(x, x), stage.cross * x[:, None] * limit
    a, b, effort = a * x / x[:, None], b * limit / x[:, None], stage.force * limit**2
    if "force" not in names:  # it follows at once, and is what was last commanded
        a, state = np.pad(a, (0, 1)), np.pad(state, (0, 1))
        b, cross = np.vstack([b, [[1.0]]]), np.vstack([cross, [[0.0]]])
        names = [*names, "force"]
    applied = np.eye(1, len(names), names.index("force"))
    across = cross @ applied
    weights = (
        state + across + across.T + effort * applied.T @ applied,
        effort + rate * limit**2,
        cross + effort * applied.T,
    )
    with solvable("the regulator's Riccati equation"):
        gain, _, _ = control.dlqr(a + b @ applied, b, *weights, method="scipy")
    found, whole = np.asarray(gain)[0], np.zeros(len(system.states))
    whole[list(regulated)] = found[: len(regulated)] * limit / x
    return whole, 0.0 if len(found) == len(regulated) else float(found[-1])


def best_rate_limited_lqg(scene: Scene) -> RateLimitedLQG:
    """Search both weights and the size of the unmodelled together, then each weight alone."""
    own = weighed(scene)

    def made(effort: float, rate: float, unmodelled: float) -> RateLimitedLQG:
        return RateLimitedLQG(own, 10.0**effort, 10.0**rate, unmodelled)

    tried = list(product(DECADES, DECADES, DISTURBANCES))
    effort, rate, unmodelled = chosen_of(
        tried, lambda numbers, most: cost_of(scene, lambda: made(*numbers), most=most)
    )
    found = cheapest(scene, lambda e: made(e, rate, unmodelled), effort + DECADES)
    effort = np.log10(found.effort)
    return cheapest(scene, lambda r: made(effort, r, unmodelled), rate + DECADES)


def _refused(scene: Scene) -> str | None:
    force = scene.actuation.force
    if force is not None and force.rate_limit is None:
        return "which knows how fast a force can change; actuation.force.rate_limit: missing"
    return without_force(scene.replace(**{"actuation.force.command": "position"}))


ENTRIES = (
    Entry(
        "rate-limited-lqg",
        ("force",),
        best_rate_limited_lqg,
        52,
        "filter",
        "rate-limited LQG",
        _refused,
    ),
)
