"""Random numbers of controllers, whose state is in the memory of the lanes; random actions."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.controllers.registry import Entry
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

States = NDArray[np.uint64]

CORRELATION = 0.6
"""Correlation of successive actions' noise; white noise would hardly move the carriage."""

HALF = 64


def correlated(
    noise: np.random.Generator, shape: tuple[int, ...], by: float = CORRELATION
) -> Array:
    """Return standard normal numbers of a shape (steps, ...), correlated from step to step."""
    drawn = noise.standard_normal(shape)
    for i in range(1, len(drawn)):
        drawn[i] = by * drawn[i - 1] + np.sqrt(1.0 - by**2) * drawn[i]
    return drawn


class Noise:
    """Random numbers of lanes; those that began together draw them together.

    A lane's memory is the state of its generator, the two halves of 128 bits.
    """

    def __init__(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        self.start = self.generator.bit_generator.state

    def begin(self, lanes: int) -> States:
        return np.tile(_halves(self.start["state"]["state"]), (lanes, 1))

    def drawn(
        self,
        states: States,
        shape: tuple[int, ...],
        axis: int,
        draw: Callable[[np.random.Generator, tuple[int, ...]], Array] = correlated,
    ) -> tuple[Array, States]:
        """Return random numbers of a shape, whose axis is the lanes, and the states then."""
        found, after = np.empty(shape), states.copy()
        lanes = np.moveaxis(found, axis, 0)
        for high, low in np.unique(states, axis=0):
            own = (states == (high, low)).all(axis=1)
            state = {**self.start["state"], "state": int(high) << HALF | int(low)}
            self.generator.bit_generator.state = {**self.start, "state": state}
            some = (*shape[:axis], int(own.sum()), *shape[axis + 1 :])
            lanes[own] = np.moveaxis(draw(self.generator, some), axis, 0)
            after[own] = _halves(self.generator.bit_generator.state["state"]["state"])
        return found, after


def _halves(state: int) -> States:
    return np.array([state >> HALF, state % 2**HALF], np.uint64)


class RandomActions(Controller):
    """Actions drawn uniformly.

    Without a generator they are the same in every evaluation.
    """

    name = "random actions"

    def __init__(self, scene: Scene, generator: np.random.Generator | None = None) -> None:
        self.columns, self.given, self.noise = len(scene.actuation.names), generator, Noise(0)

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return {} if self.given is not None else {"noise": self.noise.begin(env.num_envs)}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        shape = len(observation), self.columns
        if self.given is not None:
            return _uniform(self.given, shape), memory
        action, noise = self.noise.drawn(memory["noise"], shape, 0, _uniform)
        return action, {"noise": noise}


def _uniform(generator: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return generator.uniform(-1.0, 1.0, shape)


ENTRIES = (Entry("random", (), RandomActions, 0, "any"),)
