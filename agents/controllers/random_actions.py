"""Random actions: what an untrained agent does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.controller import Controller, columns
from agents.controllers.noise import Noise
from agents.controllers.registry import Entry

if TYPE_CHECKING:
    import numpy as np

    from agents.controllers.controller import Acted, Info, Memory, Observation, Values
    from mm_gym import MovingMassVectorEnv, Scene


class RandomActions(Controller):
    """Actions drawn uniformly.

    Parameters
    ----------
    generator
        Where they are drawn from. By default they are the same in every evaluation.
    """

    name = "random actions"

    def __init__(self, scene: Scene, generator: np.random.Generator | None = None) -> None:
        self.columns, self.given, self.noise = len(columns(scene)), generator, Noise(0)

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        """Begin the random numbers anew, unless their generator was given."""
        return {} if self.given is not None else {"noise": self.noise.begin(env.num_envs)}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        """Return actions drawn from [-1, 1]."""
        shape = len(observation), self.columns
        if self.given is not None:
            return _uniform(self.given, shape), memory
        action, noise = self.noise.drawn(memory["noise"], shape, 0, _uniform)
        return action, {"noise": noise}


def _uniform(generator: np.random.Generator, shape: tuple[int, ...]) -> Values:
    return generator.uniform(-1.0, 1.0, shape)


ENTRIES = (Entry("random", (), RandomActions, 0, "any"),)
