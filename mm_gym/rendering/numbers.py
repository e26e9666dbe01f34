"""Round numbers: of scales, axes and their labels."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import floor, inf, isfinite, log10
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

STEPS = (1.0, 2.0, 5.0, 10.0)
"""Round numbers within a decade."""

FINE_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Round numbers closer to each other."""

ROUND_OFF = 1e-9

MINUS, TIMES, DASH = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}", "\N{EN DASH}"

LEAST_PLAIN, MOST_PLAIN = -3, 4
"""Decades of numbers that are written without an exponent."""

PREFIXES = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm"))


class Unit(NamedTuple):
    """A unit of length: its size [m] and its name."""

    size: float
    name: str


def _decade(value: float) -> float:
    return 10.0 ** floor(log10(value))


def round_up(value: float, steps: Sequence[float] = STEPS) -> float:
    """Return the least round number that is not below a positive value."""
    decade = _decade(value)
    return steps[bisect_left(steps, value / decade * (1.0 - ROUND_OFF))] * decade


def round_down(value: float, steps: Sequence[float] = STEPS) -> float:
    """Return the largest round number that is not above a positive value."""
    decade = _decade(value)
    return steps[bisect_right(steps, value / decade * (1.0 + ROUND_OFF)) - 1] * decade


def unit_of(length: float) -> Unit:
    """Return the unit in which a length [m] is between 1 and 1000, as far as there is one."""
    for size, name in PREFIXES:
        if length >= size:
            return Unit(size, name)
    return Unit(*PREFIXES[-1])


def text_of(value: float) -> str:
    """Return a tick's number, with a minus sign of full width."""
    return f"{value:g}".replace("-", MINUS)


def reading(value: float, largest: float) -> str:
    """Return a measured number with three digits of the largest one, which keeps its width."""
    if not isfinite(value):
        return "?"
    magnitude = floor(log10(largest)) if 0.0 < largest < inf else 0
    if LEAST_PLAIN <= magnitude <= MOST_PLAIN:
        return f"{value:.{max(2 - magnitude, 0)}f}".replace("-", MINUS)
    return f"{value:.2e}".replace("-", MINUS)
