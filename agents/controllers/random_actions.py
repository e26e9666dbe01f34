"""Random actions: what an untrained agent does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.controller import columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads, Values
    from mm_gym import MovingMassVectorEnv, Scene


class RandomActions:
    """Actions drawn uniformly.

    Parameters
    ----------
    generator
        Where they are drawn from. By default they are the same in every evaluation.
    """

    name = "random actions"
    reads: Reads = "observation"

    def __init__(self, scene: Scene, generator: np.random.Generator | None = None) -> None:
        self.columns = len(columns(scene))
        self.given = generator

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin the random numbers anew, unless their generator was given."""
        self.generator = np.random.default_rng(0) if self.given is None else self.given

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return actions drawn from [-1, 1]."""
        return self.generator.uniform(-1.0, 1.0, (len(observation), self.columns))
