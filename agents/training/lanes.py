"""The lanes in which a policy is trained: their seeds and their state, and the base in them."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import TransformReward
from numpy.typing import NDArray

from agents.control.controller import Controller, Memory, chosen, joined, part
from agents.controllers.learned import observed
from agents.training.arrays import Arrays, check_like
from agents.training.config import SEED_BITS, TrainSettings, training_seeds
from agents.training.parts import Parts
from mm_gym import MovingMassVectorEnv
from mm_gym.arrays import Array, Single
from mm_gym.sb3 import VectorEnvAdapter

if TYPE_CHECKING:
    Wrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:  # a class without parameters before Gymnasium 1.4
    Wrapper = VectorWrapper


class ResidualLanes(Wrapper):
    """Add `authority` times the agent's actions to those of a base, which the agent observes too.

    Parameters
    ----------
    env
        A vector environment with same-step autoreset over `MovingMassVectorEnv`.

    Attributes
    ----------
    memory
        The base's, of every lane's own episode.
    proposed
        (lanes, k) the base's actions for the last observation.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], base: Controller, authority: float) -> None:
        super().__init__(env)
        self.base, self.authority = base, authority
        own, actions = env.single_observation_space, env.single_action_space
        self.single_observation_space = Box(
            np.concatenate([own.low, actions.low]), np.concatenate([own.high, actions.high])
        )
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.memory: Memory = {}
        self.proposed = np.zeros(env.action_space.shape)

    def reset(self, **arguments: Any) -> tuple[Single, dict[str, Any]]:  # noqa: ANN401 - Gymnasium's
        """Begin an episode in every lane."""
        observation, info = self.env.reset(**arguments)
        self.proposed, self.memory = self._begun(observation, info)
        return observed(observation, self.proposed), info

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[Single, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Apply the sums."""
        total = np.clip(self.proposed + self.authority * actions, -1.0, 1.0)
        memory = self.base.note(self.memory, total)
        observation, reward, terminated, truncated, info = self.env.step(total)
        ended = terminated | truncated
        last, known = _at_end(observation, info, ended)
        self.proposed, self.memory = self.base.propose(memory, last, self.base.known(known))
        if ended.any():
            finals = observed(last, self.proposed)
            for lane in np.flatnonzero(ended):
                info["final_obs"][lane] = finals[lane]
            proposed, memory = self._begun(observation, info)
            self.proposed = chosen(ended, proposed, self.proposed)
            self.memory = {
                name: chosen(ended, begun, self.memory[name]) for name, begun in memory.items()
            }
        return observed(observation, self.proposed), reward, terminated, truncated, info

    def _begun(self, observation: Single, info: dict[str, Any]) -> tuple[Array, Memory]:
        """Return the base's actions and memory in episodes that begin in all lanes."""
        memory = self.base.begin(self.env.unwrapped)  # pyright: ignore[reportArgumentType] - as required
        return self.base.propose(memory, observation, self.base.known(info))

    def get_state(self) -> Arrays:
        """Return the base's memory, and the actions that it proposes."""
        return {"proposed": self.proposed.copy(), **joined(memory=self.memory)}

    def set_state(self, arrays: Arrays) -> None:
        """Continue from what `get_state` returned, after the environment has continued."""
        begun = self.base.begin(self.env.unwrapped)  # pyright: ignore[reportArgumentType] - as required
        check_like(arrays, {"proposed": self.proposed, **joined(memory=begun)})
        self.proposed = np.array(arrays["proposed"])
        self.memory = part(arrays, "memory")


def _at_end(
    observation: Single, info: dict[str, Any], ended: NDArray[np.bool_]
) -> tuple[Single, dict[str, Any]]:
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


class TrainingLanes(VectorEnvAdapter):
    """The lanes of one training."""

    residual: ResidualLanes | None = None
    """What adds the agent's actions to those of a base, if there is one."""

    def seed(self, seed: int | None = None) -> list[int]:
        """Seed the lanes at the next reset, see `training_seeds`."""
        if seed is None:
            seed = int(np.random.default_rng().integers(1 << SEED_BITS))
        self._seeds = training_seeds(seed, self.num_envs)
        return self._seeds

    def get_state(self) -> dict[str, NDArray[np.generic]]:
        """Return the exact state of all lanes as arrays, random streams included."""
        (state, *_) = self.env_method("get_state")
        arrays = {name: np.asarray(value) for name, value in state.items()}
        if self.residual is not None:
            arrays |= joined(residual=self.residual.get_state())
        return arrays | {"returns": self._returns.copy(), "lengths": self._lengths.copy()}

    def set_state(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Continue from what `get_state` returned."""
        arrays = {name: array for name, array in state.items() if "/" not in name}
        self._returns[:], self._lengths[:] = arrays.pop("returns"), arrays.pop("lengths")
        # The scene's digest and flags are no arrays in the environment.
        self.env_method(
            "set_state",
            {name: array if array.ndim else array.item() for name, array in arrays.items()},
        )
        if self.residual is not None:
            self.residual.set_state(part(dict(state), "residual"))


def make_lanes(settings: TrainSettings, parts: Parts) -> TrainingLanes:
    """Return the lanes of a training, with scaled rewards."""
    lanes = MovingMassVectorEnv(parts.scene, settings.lanes, autoreset_mode="SameStep")
    scale, residual = settings.chosen.reward_scale, None
    if parts.base is not None:
        lanes = residual = ResidualLanes(lanes, parts.base, settings.authority)
    scaled = TrainingLanes(TransformReward(lanes, lambda reward: scale * reward))
    scaled.residual = residual
    return scaled
