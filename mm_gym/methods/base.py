"""What a method is, and what methods share: their model's header, bounds of the motion's rates."""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from numpy.typing import NDArray

    from mm_gym.kernels.control_step import Entries
    from mm_gym.methods.support import Support

ROUND_OFF = 2.0**-54
"""Relative size below which a term of a series changes nothing."""


@dataclass(frozen=True)
class Method:
    """A way to propagate a plant.

    Attributes
    ----------
    name
        The value of ``solver.method`` that asks for it.
    plant
        What it propagates.
    how, order, bound
        In words, for `Plant.explain` and the documentation.
    cost
        Work per control step in words, given the model array.
    model
        Builds the kernel's constants for a support; raises `CompileError` where the bound cannot be
        met.
    entries
        The compiled entries.
    options
        Fields of ``solver`` that have an effect.
    """

    name: str
    plant: str
    how: str
    order: str
    bound: str
    cost: Callable[[NDArray[np.float64]], str]
    model: Callable[[Support], NDArray[np.float64]]
    entries: Entries
    options: tuple[str, ...] = ()

    def constants(self, support: Support) -> NDArray[np.float64]:
        """Return the model array, the sources' description at its end."""
        model = self.model(support)
        model[at.EXCITATION] = len(model)
        return np.concatenate([model, support.excitation])


@contextmanager
def refuse_overflow(support: Support) -> Generator[None]:
    """Turn an overflow of a transition matrix into a `CompileError`."""
    try:
        yield
    except OverflowError as error:
        msg = f"control.time_step: {support.sample_interval} s is too long for this scene's rates: {error}"
        raise CompileError(msg) from error


def header(support: Support, own: int) -> NDArray[np.float64]:
    """Return a model array with the slots that every method shares, and `own` slots more."""
    model = np.zeros(at.MODEL_OWN + own)
    model[at.SAMPLE_INTERVAL], model[at.INTERVALS] = (
        support.sample_interval,
        support.intervals_per_step,
    )
    model[at.JETS], model[at.TERMS] = support.jets, support.terms
    model[at.HARMONIC_COUNT] = len(support.ground)
    model[at.GROUND] = sum(1 << j for j, ground in enumerate(support.ground) if ground)
    return model


def degree(phase: float) -> int:
    """Return the least n for which Taylor's remainder is below round-off.

    The remainder is at most its first term phase**(n + 1) / (n + 1)!, and each further one is
    smaller by phase / (n + 2) or less. It is 2 at least: slow or free masses too move by t**2 / 2
    under a held force.
    """
    n = max(2, math.ceil(phase))
    while phase ** (n + 1) / math.factorial(n + 1) > ROUND_OFF * (1.0 - phase / (n + 2)):
        n += 1
    return n
