"""The lanes in which a policy is trained: their seeds and their state."""

from collections.abc import Mapping

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import TransformReward
from numpy.typing import NDArray

from agents.training.arrays import part_of
from agents.training.config import SEED_BITS, TrainSettings, training_seeds
from agents.training.parts import Parts
from agents.training.residual_lanes import ResidualLanes
from mm_gym.sb3 import VectorEnvAdapter


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
            own = self.residual.get_state()
            arrays |= {f"residual/{name}": array for name, array in own.items()}
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
            self.residual.set_state(part_of(dict(state), "residual"))


def make_lanes(settings: TrainSettings, parts: Parts) -> TrainingLanes:
    """Return the lanes of a training, with scaled rewards."""
    lanes = gymnasium.make_vec(
        settings.task,
        num_envs=settings.lanes,
        vectorization_mode="vector_entry_point",
        scene=parts.scene,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    scale, residual = settings.chosen.reward_scale, None
    if parts.base is not None:
        lanes = residual = ResidualLanes(lanes, parts.base, settings.authority)
    scaled = TrainingLanes(TransformReward(lanes, lambda reward: scale * reward))
    scaled.residual = residual
    return scaled
