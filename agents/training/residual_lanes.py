"""Lanes in which an agent adds to a base's action.

Lanes whose episodes begin in the same step have a copy of the base of their own, because a base may
remember its episode and counts steps for all its lanes at once. What each copy was told since then
is kept: a checkpoint holds it instead of the base's memory, and a continued training repeats it.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space

from agents.controllers.residual import observed, propose, send

if TYPE_CHECKING:
    from gymnasium.vector import VectorEnv
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Values
    from agents.training.arrays import Arrays
    from mm_gym import MovingMassVectorEnv

    Wrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:  # a class without parameters before Gymnasium 1.4
    Wrapper = VectorWrapper

KNOWN = ("state", "applied")
"""What a base may read of the information."""


class SomeLanes:
    """Some lanes of a vector environment, as far as a base's `reset` looks at them."""

    def __init__(self, env: MovingMassVectorEnv, lanes: NDArray[np.intp]) -> None:
        self.env, self.lanes, self.num_envs = env, lanes, len(lanes)
        self.plant = env.plant
        self.single_observation_space = env.single_observation_space
        self.single_action_space = env.single_action_space

    def drawn(self, name: str) -> Values:
        """Return the values (lanes,) that were drawn for a field of the scene."""
        return self.env.drawn(name)[self.lanes]


@dataclass(eq=False)
class Cohort:
    """Lanes whose episodes began in the same step, with their own copy of the base.

    Attributes
    ----------
    lanes, running
        (m,) numbers of the lanes, and whether their episodes still run.
    told
        What was observed, and the entries of `KNOWN`, in each step so far.
    sent
        The actions (m, k) applied in each step so far.
    """

    base: Controller
    lanes: NDArray[np.intp]
    running: NDArray[np.bool_]
    told: list[tuple[NDArray[Any], ...]] = field(default_factory=list)
    sent: list[Values] = field(default_factory=list)

    def propose(self, seen: tuple[NDArray[Any], ...]) -> Values:
        """Return the base's actions (m, k) for what it is told."""
        self.told.append(seen)
        observation, *known = seen
        return propose(self.base, observation, dict(zip(KNOWN, known, strict=True)))

    def send(self, action: Values) -> None:
        """Tell the base what is applied."""
        self.sent.append(action)
        send(self.base, action)


class ResidualLanes(Wrapper):
    """Add `authority` times the agent's actions to those of a base, which the agent observes too.

    Parameters
    ----------
    env
        A vector environment with same-step autoreset over `MovingMassVectorEnv`.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], base: Controller, authority: float) -> None:
        super().__init__(env)
        self.base, self.authority = base, authority
        own, actions = env.single_observation_space, env.single_action_space
        self.single_observation_space = Box(
            np.concatenate([own.low, actions.low]), np.concatenate([own.high, actions.high])
        )
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.cohorts: list[Cohort] = []
        self.proposed = np.zeros(env.action_space.shape)

    def reset(self, **arguments: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:  # noqa: ANN401 - Gymnasium's
        """Begin an episode in every lane."""
        observation, info = self.env.reset(**arguments)
        self.cohorts = []
        self._begin(np.arange(self.num_envs), observation, info)
        return observed(observation, self.proposed), info

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Apply the sums."""
        total = np.clip(self.proposed + self.authority * actions, -1.0, 1.0)
        for cohort in self.cohorts:
            cohort.send(total[cohort.lanes])
        observation, reward, terminated, truncated, info = self.env.step(total)
        ended = terminated | truncated
        last, known = _at_end(observation, info, ended)
        for cohort in self.cohorts:
            seen = (last[cohort.lanes], *(known[name][cohort.lanes] for name in KNOWN))
            self.proposed[cohort.lanes[cohort.running]] = cohort.propose(seen)[cohort.running]
        if ended.any():
            finals = observed(last, self.proposed)
            for lane in np.flatnonzero(ended):
                info["final_obs"][lane] = finals[lane]
            for cohort in self.cohorts:
                cohort.running &= ~ended[cohort.lanes]
            self.cohorts = [cohort for cohort in self.cohorts if cohort.running.any()]
            self._begin(np.flatnonzero(ended), observation, info)
        return observed(observation, self.proposed), reward, terminated, truncated, info

    def _begin(
        self, lanes: NDArray[np.intp], observation: NDArray[np.float32], info: dict[str, Any]
    ) -> None:
        """Let a copy of the base begin in lanes whose episodes have just begun."""
        cohort = self._cohort(lanes, np.ones(len(lanes), np.bool_))
        seen = (observation[lanes], *(info[name][lanes] for name in KNOWN))
        self.proposed[lanes] = cohort.propose(seen)
        self.cohorts.append(cohort)

    def _cohort(self, lanes: NDArray[np.intp], running: NDArray[np.bool_]) -> Cohort:
        base = copy.deepcopy(self.base)
        base.reset(SomeLanes(self.env.unwrapped, lanes))  # pyright: ignore[reportArgumentType] - all that it looks at
        return Cohort(base, lanes, running)

    def get_state(self) -> Arrays:
        """Return what each copy of the base was told, and the actions that they propose."""
        arrays: Arrays = {"proposed": self.proposed.copy()}
        for i, cohort in enumerate(self.cohorts):
            arrays |= {f"{i}.lanes": cohort.lanes, f"{i}.running": cohort.running.copy()}
            for name, values in zip(
                ("observation", *KNOWN), zip(*cohort.told, strict=True), strict=True
            ):
                arrays[f"{i}.{name}"] = np.stack(values)
            shape = (0, len(cohort.lanes), self.proposed.shape[1])
            arrays[f"{i}.sent"] = np.stack(cohort.sent) if cohort.sent else np.zeros(shape)
        return arrays

    def set_state(self, arrays: Arrays) -> None:
        """Continue from what `get_state` returned, after the environment has continued."""
        self.cohorts = []
        while f"{len(self.cohorts)}.lanes" in arrays:
            i = len(self.cohorts)
            cohort = self._cohort(arrays[f"{i}.lanes"], arrays[f"{i}.running"])
            told = zip(*(arrays[f"{i}.{name}"] for name in ("observation", *KNOWN)), strict=True)
            sent = arrays[f"{i}.sent"]
            for step, seen in enumerate(told):
                cohort.propose(seen)
                if step < len(sent):
                    cohort.send(sent[step])
            self.cohorts.append(cohort)
        self.proposed = np.array(arrays["proposed"])


def _at_end(
    observation: NDArray[np.float32], info: dict[str, Any], ended: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Return observation, state and what was applied at a step's end, before any restart."""
    known = {name: info[name] for name in ("state", "applied")}
    if not ended.any():
        return observation, known
    last = observation.copy()
    last[ended] = np.stack(info["final_obs"][ended])
    return last, {
        name: np.where(ended[:, None], info["final_info"][name], rows)
        for name, rows in known.items()
    }
