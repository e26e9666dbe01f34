"""Episodes of a controller on many lanes, each with the seed that starts it again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.control.controller import Controller
from agents.rollout import Rollout
from mm_gym import MovingMassVectorEnv
from mm_gym.arrays import Array, Single


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of n steps.

    ``env.reset(seed=seed)`` and the actions reproduce it to the last bit.
    """

    seed: int  # of the reset that began it
    observations: Single  # (n + 1, numbers of an observation) float32 [-]
    actions: Single  # (n, k) float32 in [-1, 1]
    rewards: Array  # (n,) [-]
    # terminations, truncations: (n,) true at most in the last step
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    states: Array  # (n + 1, 4) x1, x2 [m], v1, v2 [m/s], ground frame
    # (n + 1, k) the force [N] and stretch [-] that the actuators reached
    applied: Array


@dataclass(frozen=True, eq=False)
class Exploration:
    """Gaussian noise on a controller's actions."""

    deviation: float  # standard deviation of the noise [-]
    generator: np.random.Generator  # where it is drawn from

    def applied_to(self, actions: NDArray[np.floating[Any]]) -> Single:
        """Return actions within [-1, 1], in the type of the action space.

        The environment would also take double precision and clip by itself; but what is recorded
        must be what was done.
        """
        noise = self.deviation * self.generator.standard_normal(actions.shape)
        return np.clip(actions + noise, -1.0, 1.0).astype(np.float32)


def play(
    task: str,
    controller: Controller,
    seeds: Sequence[int],
    *,
    lanes: int,
    exploration: Exploration,
    arguments: Mapping[str, Any],
) -> Iterator[list[Episode]]:
    """Play one episode a seed, so many lanes at a time, and yield each batch in the seeds' order.

    Further arguments are those of the environment. Raise `ActionError` if the controller's actions
    are not finite; `PolicyError` if a trained policy is of other observations or actions;
    `SimulationError` if a motion cannot be followed.
    """
    for first in range(0, len(seeds), lanes):
        batch = list(seeds[first : first + lanes])
        env = gymnasium.make_vec(
            task,
            num_envs=len(batch),
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.DISABLED,
            **arguments,
        )
        yield _play_batch(env, controller, batch, exploration)  # pyright: ignore[reportArgumentType]
        env.close()


def _play_batch(
    env: MovingMassVectorEnv, controller: Controller, seeds: list[int], exploration: Exploration
) -> list[Episode]:
    rollout = Rollout(env, controller, seed=seeds, changed=exploration.applied_to)
    starts = [(rollout.observation, rollout.info["state"], rollout.info["applied"])]
    steps, length = [], np.zeros(len(seeds), np.int64)
    for made in rollout:
        starts.append((made.observation, made.info["state"], made.info["applied"]))
        steps.append((made.action, made.reward, made.terminated, made.truncated))
        length += made.ran
    observations, states, applied = (
        np.stack(column, axis=1) for column in zip(*starts, strict=True)
    )
    actions, rewards, terminations, truncations = (
        np.stack(column, axis=1) for column in zip(*steps, strict=True)
    )
    return [
        Episode(
            seed=seed,
            observations=observations[lane, : n + 1],
            actions=actions[lane, :n],
            rewards=rewards[lane, :n],
            terminations=terminations[lane, :n],
            truncations=truncations[lane, :n],
            states=states[lane, : n + 1],
            applied=applied[lane, : n + 1],
        )
        for lane, (seed, n) in enumerate(zip(seeds, length, strict=True))
    ]
