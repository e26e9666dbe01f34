"""The one loop over episodes: a controller in every lane, until all episodes have ended."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.control.controller import Controller
from mm_gym import MovingMassVectorEnv
from mm_gym.arrays import Array, Single


class Step(NamedTuple):
    """A control step of all lanes."""

    action: NDArray[np.floating[Any]]  # (lanes, k) as the environment was given it
    # observation, reward, terminated, truncated, info: as the environment returned them
    observation: Single
    reward: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, Any]
    # (lanes,) whether the lane's episode ran in this step; what the others do is of no episode.
    ran: NDArray[np.bool_]


class Rollout:
    """One episode in each lane; iterate over it once, for a `Step` at a time.

    Parameters
    ----------
    env
        An environment without autoreset; lanes that end before others are begun again by hand.
    controller
        What acts.
    seed, options
        Of the reset.
    changed
        From actions to those that are applied in their place; the controller is not told.

    Attributes
    ----------
    observation, info
        As the reset returned them.
    """

    def __init__(
        self,
        env: MovingMassVectorEnv,
        controller: Controller,
        *,
        seed: int | Sequence[int],
        options: Mapping[str, Any] | None = None,
        changed: Callable[[Array], NDArray[np.floating[Any]]] | None = None,
    ) -> None:
        self.env, self.controller, self.changed = env, controller, changed
        seeds = seed if isinstance(seed, int) else list(seed)
        self.observation, self.info = env.reset(seed=seeds, options=dict(options or {}))

    def __iter__(self) -> Iterator[Step]:
        """Yield the steps until all episodes have ended."""
        env, controller = self.env, self.controller
        memory, observation, info = controller.begin(env), self.observation, self.info
        alive = np.ones(env.num_envs, np.bool_)
        while True:
            action, memory = controller.act(memory, observation, controller.known(info))
            if self.changed is not None:
                action = self.changed(action)
            observation, reward, terminated, truncated, info = env.step(action)
            yield Step(action, observation, reward, terminated, truncated, info, alive)
            ended = terminated | truncated
            alive = alive & ~ended
            if not alive.any():
                return
            if ended.any():
                env.reset(options={"reset_mask": ended})
