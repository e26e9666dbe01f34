"""Random actions: what an untrained agent does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.controller import OBSERVATION, columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene


class RandomActions:
    """Actions drawn uniformly, the same in every evaluation."""

    name = "random actions"

    reads = OBSERVATION

    def __init__(self, scene: Scene) -> None:
        self.columns = len(columns(scene))

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin the random numbers anew."""
        self.generator = np.random.default_rng(0)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return actions drawn from [-1, 1]."""
        return self.generator.uniform(-1.0, 1.0, (len(observation), self.columns))
