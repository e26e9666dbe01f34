"""A trained policy as a controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from stable_baselines3.common.base_class import BaseAlgorithm

    from mm_gym import MovingMassVectorEnv


class Learned:
    """The mean action of a Stable-Baselines3 policy."""

    def __init__(self, model: BaseAlgorithm, name: str = "learned") -> None:
        self.model = model
        self.name = name

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the policy's mean action."""
        action, _ = self.model.predict(observation, deterministic=True)
        return np.asarray(action, np.float64)
