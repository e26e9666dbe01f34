"""A planner that knows the whole episode: the cross-entropy method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.cross_entropy import Search
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from agents.controllers.controller import Law, Reads
    from mm_gym import Scene

    Plans = NDArray[np.float64]

SEARCH = Search(horizon=40, plans=48, elite=6, rounds=4, kept=1, spread=0.5)
HOLD = 8
"""Control steps that are carried out before the next plan."""


class Planner:
    """Try plans over a window of the episode, from the exact state, and follow the best.

    It knows the disturbance to come, which no agent can, and starts from the own plan of a law
    without memory. Its cost is reachable if the future is known; better may exist.
    """

    name = "planner (knows the episode)"
    reads: Reads = "episode"

    def __init__(self, scene: Scene, law: Law, search: Search = SEARCH) -> None:
        if scene.objective.displacement_limit or scene.objective.rail_half_length:
            msg = "objective: the planner needs episodes that do not end early"
            raise ValueError(msg)
        self.scene, self.law = scene, law
        self.search = search
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
        """Return the next action of the plan; plan again every `HOLD` steps."""
        if self.step % HOLD == 0:
            self.plan = self._improved(self.plan[self.age :], info)
            self.age = 0
        self.step += 1
        self.age += 1
        return self.plan[self.age - 1]

    def _improved(self, old: Plans, info: dict[str, Any]) -> Plans:
        state = self.env.get_state()
        length = min(self.search.horizon, self.scene.control.steps - self.step)
        first = self._plan_of_law(state, info, length)
        if len(old):
            kept = np.concatenate([old[:length], first[len(old) :]])
            better = self._worth(state, kept) > self._worth(state, first)
            first = np.where(better[:, None], kept, first)
        return self.search.best(
            first[:, :, None], lambda plans: self._worths(state, plans), self.noise
        )

    def _plan_of_law(self, state: Mapping[str, Any], info: dict[str, Any], length: int) -> Plans:
        self.trial.set_state(state)
        plan = np.empty((length, *self.trial.action_space.shape))
        for i in range(length):
            plan[i] = np.clip(self.law.action(info["state"], info["applied"]), -1.0, 1.0)
            *_, info = self.trial.step(plan[i])
        return plan

    def _worths(self, state: Mapping[str, Any], plans: Plans) -> Plans:
        """Return each lane's sums of rewards (lanes, plans) of plans (length, lanes, plans, k)."""
        return np.stack([self._worth(state, plan) for plan in np.moveaxis(plans, 2, 0)], axis=1)

    def _worth(self, state: Mapping[str, Any], plan: Plans) -> NDArray[np.float64]:
        """Return each lane's sum of rewards of a plan (length, lanes, k)."""
        self.trial.set_state(state)
        total = np.zeros(self.trial.num_envs)
        for actions in plan:
            total += self.trial.step(actions)[1]
        return total
