"""Taylor series of a linear plant's motion: to round-off, or to a tolerance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.law.linear_motion import respond
from mm_gym.methods.base import (
    ExactMethod,
    Method,
    Option,
    Settings,
    degree,
    header,
    refuse_long_interval,
)
from mm_gym.methods.linear_series import kernel
from mm_gym.methods.support import LINEAR, PARAMETRIC_LINEAR, fastest_decay, fastest_oscillation
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from collections.abc import Callable

    from mm_gym.methods.support import Support

LONGEST_PIECE = 2.0
"""Largest product of the fastest rate and a piece, the equal part of a sample interval that one
series covers. The terms of a series grow up to exp of it, and round-off with them."""

MOST_PIECES = 1000
"""Largest number of pieces in a sample interval; scenes that need more would run for minutes."""

TIGHTEST = 1e-12
"""Smallest tolerance: its degree is 19 in the longest piece, where the terms lose no digits."""

TIGHT = 1e-9
"""Tolerance up to which `auto` prefers the exact methods: they cost little more than the series,
some 13 products with the generator, and the default stays what it was."""

MARGIN = 0.25
"""Part of the tolerance that what is cut off may reach in units of energy: an error of one mass may
be larger relative to the motion, in the worst of two thousand random scenes by a factor of two."""


class ExponentialAction(ExactMethod):
    """A Taylor series of the exponential acting on the state, cut off below round-off."""

    name = "exact"
    title = "the exponential's action"
    how = "exponential acting on the state as a Taylor series, cut off below round-off"
    kinds = (PARAMETRIC_LINEAR, LINEAR)
    entries = build(kernel.propagate, respond=respond)
    held = "held actuators"

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the number of pieces in a sample interval and the degree of the series."""
        return _model(support, lambda phase, _: degree(phase))

    def cost(self, model: Array) -> str:
        """Return the number of products with A."""
        return f"{int(model[kernel.PIECES])} x {int(model[kernel.DEGREE])} products with A"


class TruncatedSeries(Method):
    """A Taylor series of the motion, cut off where the tolerance allows."""

    name = "series"
    title = "the truncated series"
    how = (
        "Taylor series of the lowest degree at which what is cut off is below the tolerance, all "
        "lanes side by side"
    )
    kinds = (PARAMETRIC_LINEAR,)
    entries = ExponentialAction.entries
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(1, 13)))
    tightest = TIGHTEST

    def deferral(self, support: Support, settings: Settings) -> str | None:  # noqa: ARG002
        """Return why `auto` takes an exact method at tight tolerances."""
        if settings.tolerance > TIGHT:
            return None
        return f"solver.tolerance is {TIGHT:g} or less, where an exact method costs little more"

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the number of pieces in a sample interval and the degree of the series.

        Each piece has an equal part of the tolerance.
        """
        return _model(support, degrees_within(support, settings))

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - it follows from the tolerance
        """Return the order."""
        return "the number of derivatives"

    def cost(self, model: Array) -> str:
        """Return the number of derivatives."""
        count = f"{int(model[kernel.PIECES])} x {int(model[kernel.DEGREE])}"
        return f"{count} derivatives of some 10 products each"


def _model(support: Support, degree_of_piece: Callable[[float, float], int]) -> Array:
    """Return the constants of the kernel.

    The degree follows from the largest product of a rate and a piece, and from the number of pieces
    in a control step.
    """
    phase = rate_of(support) * support.sample_interval
    pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
    remedy = "fix what is randomised or actuated"
    refuse_long_interval(support, phase, LONGEST_PIECE * MOST_PIECES, remedy=remedy)
    terms = degree_of_piece(phase / pieces, pieces * support.intervals_per_step)
    terms += max(support.terms - 1, 0)  # what the last term of a jet causes begins so much later
    model = header(support, kernel.END - layout.MODEL_OWN)
    model[kernel.PIECES], model[kernel.DEGREE] = pieces, terms
    varies = [not all(map(support.fixed, rows)) for rows in kernel.GROUPS]
    model[kernel.VARIES : kernel.WEIGHTS] = varies
    weights = np.array([1.0 / math.factorial(n) for n in range(kernel.MOST + 2)])
    model[kernel.WEIGHTS : kernel.POWERS] = weights
    piece = support.sample_interval / pieces
    model[kernel.POWERS : kernel.END] = weights * piece ** np.arange(kernel.MOST + 2.0)
    return model


def rate_of(support: Support, slope: float | None = None) -> float:
    """Return a bound of the excitation's frequencies and of the norm of A [1/s].

    The slope [N s/m] is that of the interface, by default the steepest. See
    `mm_gym.law.bounds.fastest_rate`. Here w, the norm of the undamped motion, and s, that of the
    damping, are not added: the norm of A is at most that of [[0, w], [w, s]].
    """
    half = 0.5 * fastest_decay(support, slope)
    rate = half + math.hypot(half, fastest_oscillation(support))
    return max(rate, float(support.frequencies.max(initial=0.0)))


def degrees_within(support: Support, settings: Settings) -> Callable[[float, float], int]:
    """Return what tells the degree of a piece, by its phase and the pieces of a control step."""
    order = 2 if support.ground else 1
    return lambda phase, parts: degree_of(phase, settings.tolerance / parts, order)


def degree_of(phase: float, tolerance: float, order: int = 1) -> int:
    """Return the lowest degree n at which what is cut off is below a part of the tolerance.

    In a free motion its first term is at most phase**(n + 1) / (n + 1)!, and each next one smaller
    by a factor of phase / (n + 2) or less. From rest the velocities grow to phase**order / order!
    only, and the first term to phase**n / (n + 1)!. Of the positions, whose series is longer by a
    term, less is cut off.

    Parameters
    ----------
    phase
        Largest product of a rate and a piece.
    tolerance
        Relative to the motion.
    order
        Power of time with which velocities may grow from rest: 1 under a held force, 2 under a
        harmonic that passes through zero.
    """
    n = order + 1
    while _first_left_out(phase, n, order) > MARGIN * tolerance * (1.0 - phase / (n + 2)):
        n += 1
    return n


def _first_left_out(phase: float, n: int, order: int) -> float:
    """Return the first term beyond degree n, relative to the motion."""
    least = max(phase**order, float(math.factorial(order)))
    return least * phase ** (n + 1 - order) / math.factorial(n + 1)
