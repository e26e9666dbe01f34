"""The methods: what each propagates, how, at what order, cost and error bound. A new method is tested by standing here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.kernels import linear, series
from mm_gym.kernels.entries import Entries, build
from mm_gym.plant import linear_system
from mm_gym.propagators import response_to_tone, transition

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.parameters import Support

ROUND_OFF = 2.0**-54
"""Relative size below which a term of a series changes nothing."""

LONGEST_SUBSTEP = 2.0
"""Largest rate times substep: the terms of the series grow to exp of it, and round-off with them."""

MOST_SUBSTEPS = 1000
"""Substeps of a control step beyond which a scene is refused rather than run for minutes."""


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
        Builds the kernel's constants for a support; raises `CompileError` where the bound cannot be met.
    entries
        The compiled entries.
    """

    name: str
    plant: str
    how: str
    order: str
    bound: str
    cost: Callable[[NDArray[np.float64]], str]
    model: Callable[[Support], NDArray[np.float64]]
    entries: Entries


def _header(support: Support, own: int) -> NDArray[np.float64]:
    model = np.zeros(at.MODEL_OWN + own)
    model[at.TIME_STEP] = support.time_step
    model[at.TONE_COUNT] = len(support.ground)
    model[at.GROUND] = sum(1 << j for j, ground in enumerate(support.ground) if ground)
    return model


def _linear_model(support: Support) -> NDArray[np.float64]:
    model = _header(support, 20 + 8 * len(support.ground))
    system = linear_system(support.low)
    try:
        model[linear.TRANSITION : linear.RESPONSES] = transition(system, support.time_step).ravel()
        for j, ground in enumerate(support.ground):
            frequency = float(support.low[at.TONES + at.TONE_ROWS * j + at.FREQUENCY])
            response = response_to_tone(system, frequency, ground=ground, time=support.time_step)
            first = linear.RESPONSES + 8 * j
            model[first : first + 8] = response.ravel()
    except OverflowError as error:
        msg = f"control.time_step: {support.time_step} s is too long for this scene's rates: {error}"
        raise CompileError(msg) from error
    return model


def _series_model(support: Support) -> NDArray[np.float64]:
    model = _header(support, 2)
    phase = fastest_rate(support) * support.time_step
    substeps = max(1.0, np.ceil(phase / LONGEST_SUBSTEP))
    if not substeps <= MOST_SUBSTEPS:
        msg = (
            f"control.time_step: {support.time_step} s spans {phase:.3g} times the scene's shortest time constant "
            f"{support.time_step / phase:.3g} s; the series allows {LONGEST_SUBSTEP * MOST_SUBSTEPS:.0f}. Shorten the "
            "step, or fix what is randomised or actuated"
        )
        raise CompileError(msg)
    model[series.SUBSTEPS] = substeps
    model[series.DEGREE] = degree(phase / substeps)
    return model


def fastest_rate(support: Support) -> float:
    """Return a bound of the spectral norm of A, in the energy norm, and of the excitation's frequencies [1/s].

    With positions scaled by the root of stiffness and velocities by the root of mass, A is the skew matrix of the
    undamped motion plus minus the scaled damping; the norm of each is at most its trace.
    """
    low, high = support.low, support.high
    k1 = high[at.K1] * high[at.ALPHA]
    # k2 falls with stretch and never exceeds 6 k0.
    stretch = low[at.STRETCH]
    k2 = 2.0 * high[at.K0] * (1.0 + 2.0 / stretch**3) if high[at.K0] > 0.0 else 0.0
    m1, m2, c, d = low[at.M1], low[at.M2], high[at.C], high[at.D]
    oscillation = np.sqrt((k1 + k2) / m1 + k2 / m2)
    dissipation = (c + d) / m1 + c / m2
    tones = high[at.TONES + at.FREQUENCY :: at.TONE_ROWS]
    return float(max(oscillation + dissipation, tones.max(initial=0.0)))


def degree(phase: float) -> int:
    """Return the least n with phase**(n + 1) / (n + 1)! * exp(phase) below round-off: Taylor's remainder."""
    n = 1
    while phase ** (n + 1) / math.factorial(n + 1) * math.exp(phase) > ROUND_OFF:
        n += 1
    return n


LINEAR = Method(
    name="exact",
    plant="linear",
    how="transition matrix, computed once in decimal arithmetic and rounded once; harmonic excitation as an exosystem",
    order="exact for a held force",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=lambda model: f"one 4 x 5 product, and 8 products for each of {int(model[at.TONE_COUNT])} harmonics",
    model=_linear_model,
    entries=build(linear.propagate),
)

PARAMETRIC = Method(
    name="exact",
    plant="parametric linear",
    how="exponential acting on the state as a Taylor series, cut off below round-off",
    order="exact for a held force and stretch",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=lambda model: f"{int(model[series.SUBSTEPS])} x {int(model[series.DEGREE])} products with A",
    model=_series_model,
    entries=build(series.propagate),
)
