"""Sizes of a series' terms: where it may end, and how far it reaches."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.layout import COLUMNS

CUT_OFF = 2.0**-54
"""Size of the last terms, relative to the largest of the others."""

_LAST = 4
"""Terms that are looked at: in a series of alternating or rare terms some are small by chance."""

_LEADING, _ROUNDS = 5, 3


@borrowing_kernel
def write_size(c, t, unit, n):
    """Write the sizes [m] of terms n, and the largest but for the last three."""
    c[of.TERM + n] = max(
        abs(c[of.X1 + n]), abs(c[of.OFFSET + n]), unit * abs(c[of.V1 + n]), unit * abs(c[of.W + n])
    )
    for j in range(COLUMNS):
        speed = max(abs(t[2 * of.PART + n, j]), abs(t[3 * of.PART + n, j]))
        t[of.SIZES + n, j] = max(abs(t[n, j]), abs(t[of.PART + n, j]), unit * speed)
    if n == 0:
        c[of.LARGEST] = 0.0
        for j in range(COLUMNS):
            t[of.MOST, j] = 0.0
    if n >= of.LAG:
        c[of.LARGEST] = max(c[of.LARGEST], c[of.TERM + n - of.LAG])
        for j in range(COLUMNS):
            t[of.MOST, j] = max(t[of.MOST, j], t[of.SIZES + n - of.LAG, j])


@borrowing_kernel
def is_enough(c, t, order):
    """Tell whether the last terms of every column are below the cut-off."""
    over = False
    for n in range(order - _LAST + 1, order + 1):
        over |= c[of.TERM + n] > CUT_OFF * c[of.LARGEST]
        for j in range(COLUMNS):
            over |= t[of.SIZES + n, j] > CUT_OFF * t[of.MOST, j]
    return not over


@borrowing_kernel
def part_of_unit(c, t):
    """Return the part of the unit within which the last terms are below the cut-off.

    Relative to the leading terms there: beyond the radius of convergence the others grow.
    """
    part = 1.0
    for _ in range(_ROUNDS):
        lead, power = 0.0, 1.0
        for n in range(_LEADING):
            lead, power = max(lead, power * c[of.TERM + n]), power * part
        last = 0.0
        for n in range(of.ORDER - _LAST + 1, of.ORDER + 1):
            last = max(last, c[of.TERM + n])
        following = _part_of(last, lead if lead > 0.0 else c[of.LARGEST])
        for j in range(COLUMNS):
            lead, power = 0.0, 1.0
            for n in range(_LEADING):
                lead, power = max(lead, power * t[of.SIZES + n, j]), power * part
            last = 0.0
            for n in range(of.ORDER - _LAST + 1, of.ORDER + 1):
                last = max(last, t[of.SIZES + n, j])
            following = min(following, _part_of(last, lead if lead > 0.0 else t[of.MOST, j]))
        part = following
    return part


@borrowing_kernel
def _part_of(last, largest):
    """Return the same of one column, given its last terms and its leading ones [m]."""
    if last <= CUT_OFF * largest:
        return 1.0
    return 0.9 * (CUT_OFF * largest / last) ** (1.0 / (of.ORDER - _LAST + 1.0))
