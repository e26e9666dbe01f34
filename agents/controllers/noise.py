"""Random numbers of controllers, whose state is in the memory of the lanes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from agents.controllers.controller import Values

    States = NDArray[np.uint64]

CORRELATION = 0.6
"""Correlation of successive actions' noise; white noise would hardly move the carriage."""

HALF = 64


def correlated(noise: np.random.Generator, shape: tuple[int, ...]) -> Values:
    """Return standard normal numbers of a shape (steps, ...), correlated from step to step."""
    drawn = noise.standard_normal(shape)
    for i in range(1, len(drawn)):
        drawn[i] = CORRELATION * drawn[i - 1] + np.sqrt(1.0 - CORRELATION**2) * drawn[i]
    return drawn


class Noise:
    """Random numbers of lanes; those that began together draw them together.

    A lane's memory is the state of its generator, the two halves of 128 bits.
    """

    def __init__(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        self.start = self.generator.bit_generator.state

    def begin(self, lanes: int) -> States:
        """Return the states (lanes, 2) of new episodes."""
        return np.tile(_halves(self.start["state"]["state"]), (lanes, 1))

    def drawn(
        self,
        states: States,
        shape: tuple[int, ...],
        axis: int,
        draw: Callable[[np.random.Generator, tuple[int, ...]], Values] = correlated,
    ) -> tuple[Values, States]:
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
