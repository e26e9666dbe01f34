"""A planner that knows the whole episode: the cross-entropy method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from agents.controllers.controller import Law, Reads
    from mm_gym import Scene

    Plans = NDArray[np.float64]

CORRELATION = 0.6
"""Correlation of successive actions' noise; white noise would hardly move the carriage."""


@dataclass(frozen=True)
class Effort:
    """How hard the planner tries.

    Attributes
    ----------
    window, hold
        Control steps planned ahead, and carried out before the next plan.
    population, elite, rounds
        Plans tried at once, those that the next are drawn around, and repetitions.
    """

    window: int = 40
    hold: int = 8
    population: int = 48
    elite: int = 6
    rounds: int = 4


class Planner:
    """Try plans over a window of the episode, from the exact state, and follow the best.

    It knows the disturbance to come, which no agent can, and starts from the own plan of a law
    without memory. Its cost is reachable if the future is known; better may exist. De Boer et al.,
    *A tutorial on the cross-entropy method*, Ann. Oper. Res. 134 (2005).
    """

    name = "planner (knows the episode)"
    reads: Reads = "episode"

    def __init__(self, scene: Scene, law: Law, effort: Effort | None = None) -> None:
        if scene.objective.displacement_limit or scene.objective.rail_half_length:
            msg = "objective: the planner needs episodes that do not end early"
            raise ValueError(msg)
        self.scene, self.law = scene, law
        self.effort = effort or Effort()
        self.noise = np.random.default_rng(0)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Make a copy of the lanes, in which plans are tried."""
        self.env = env
        self.trial = MovingMassVectorEnv(
            self.scene, env.num_envs, autoreset_mode="Disabled", copy=False
        )
        self.law.begin(env.num_envs)
        self.step = 0
        self.plan: Plans = np.empty((0, *env.action_space.shape))
        self.age = 0

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the next action of the plan; plan again every `Effort.hold` steps."""
        if self.step % self.effort.hold == 0:
            self.plan = self._improved(self.plan[self.age :], info)
            self.age = 0
        self.step += 1
        self.age += 1
        return self.plan[self.age - 1]

    def _improved(self, old: Plans, info: dict[str, Any]) -> Plans:
        state = self.env.get_state()
        length = min(self.effort.window, self.scene.control.steps - self.step)
        first = self._plan_of_law(state, info, length)
        if len(old):
            kept = np.concatenate([old[:length], first[len(old) :]])
            better = self._worth(state, kept) > self._worth(state, first)
            first = np.where(better[:, None], kept, first)
        return self._searched(state, first)

    def _plan_of_law(self, state: Mapping[str, Any], info: dict[str, Any], length: int) -> Plans:
        self.trial.set_state(state)
        plan = np.empty((length, *self.trial.action_space.shape))
        for i in range(length):
            plan[i] = np.clip(self.law.action(info["state"], info["applied"]), -1.0, 1.0)
            *_, info = self.trial.step(plan[i])
        return plan

    def _searched(self, state: Mapping[str, Any], best: Plans) -> Plans:
        """Return the best of the plans drawn and of the one to start from."""
        mean, deviation = best, np.full(best.shape, 0.5)
        rows = np.arange(best.shape[1])
        for _ in range(self.effort.rounds):
            plans = mean[:, :, None] + deviation[:, :, None] * self._noise(best.shape)
            plans[:, :, 0] = best
            np.clip(plans, -1.0, 1.0, out=plans)
            worth = [self._worth(state, plan) for plan in np.moveaxis(plans, 2, 0)]
            order = np.argsort(-np.stack(worth, axis=1), axis=1)[:, : self.effort.elite]
            chosen = plans[:, rows[:, None], order]
            best, mean, deviation = chosen[:, :, 0], chosen.mean(axis=2), chosen.std(axis=2)
        return best

    def _noise(self, shape: tuple[int, ...]) -> Plans:
        length, lanes, columns = shape
        noise = self.noise.standard_normal((length, lanes, self.effort.population, columns))
        for i in range(1, length):
            noise[i] = CORRELATION * noise[i - 1] + np.sqrt(1 - CORRELATION**2) * noise[i]
        return noise

    def _worth(self, state: Mapping[str, Any], plan: Plans) -> NDArray[np.float64]:
        """Return each lane's sum of rewards of a plan (length, lanes, k)."""
        self.trial.set_state(state)
        total = np.zeros(self.trial.num_envs)
        for actions in plan:
            total += self.trial.step(actions)[1]
        return total
