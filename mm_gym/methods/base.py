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

    from mm_gym.kernels.entries import Entries
    from mm_gym.parameters import Support

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
        model[at.SOURCES] = len(model)
        return np.concatenate([model, support.sources])


@contextmanager
def refuse_overflow(support: Support) -> Generator[None]:
    """Turn an overflow of a transition matrix into a `CompileError`."""
    try:
        yield
    except OverflowError as error:
        msg = (
            f"control.time_step: {support.time_step} s is too long for this scene's rates: {error}"
        )
        raise CompileError(msg) from error


def header(support: Support, own: int) -> NDArray[np.float64]:
    """Return a model array with the slots that every method shares, and `own` slots more."""
    model = np.zeros(at.MODEL_OWN + own)
    model[at.TIME_STEP], model[at.SUBSTEPS] = support.time_step, support.substeps
    model[at.JETS], model[at.TERMS] = support.jets, support.terms
    model[at.TONE_COUNT] = len(support.ground)
    model[at.GROUND] = sum(1 << j for j, ground in enumerate(support.ground) if ground)
    return model


def fastest_oscillation(support: Support) -> float:
    """Return a bound of the undamped frequencies about rest [rad/s]; see `fastest_rate`."""
    low, high = support.low, support.high
    k1 = high[at.K1] * high[at.ALPHA]
    # k2 falls with stretch and never exceeds 6 k0.
    k2 = 2.0 * high[at.K0] * (1.0 + 2.0 / low[at.STRETCH] ** 3) if high[at.K0] > 0.0 else 0.0
    return float(np.sqrt((k1 + k2) / low[at.M1] + k2 / low[at.M2]))


def fastest_rate(support: Support, damping: float | None = None) -> float:
    """Return a bound of the excitation's frequencies and of the norm of A [1/s].

    The norm is the spectral one, in the energy norm.

    With positions scaled by the root of stiffness and velocities by the root of mass, A is the skew
    matrix of the undamped motion plus minus the scaled damping; the norm of each is at most its
    trace.

    Parameters
    ----------
    support
        The values that the parameters can take.
    damping
        Damping of the interface [N s/m]; by default the highest of the support.
    """
    low, high = support.low, support.high
    c = high[at.C] if damping is None else damping
    dissipation = (c + high[at.D]) / low[at.M1] + c / low[at.M2]
    tones = support.frequencies.max(initial=0.0)
    return float(max(fastest_oscillation(support) + dissipation, tones))


def degree(phase: float) -> int:
    """Return the least n for which Taylor's remainder is below round-off.

    The remainder is at most phase**(n + 1) / (n + 1)! * exp(phase).
    """
    n = 1
    while phase ** (n + 1) / math.factorial(n + 1) * math.exp(phase) > ROUND_OFF:
        n += 1
    return n
