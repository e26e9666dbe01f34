"""Order and step of a Taylor series: what is left out of it shows in its last terms."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.simd import alike, read_bits, write_bits
from mm_gym.lanes.simd_masks import larger, smaller, where
from mm_gym.methods.taylor.layout import RECIPROCAL, V1, V2

FEWEST = 8
"""Lowest order of a series."""

_LOG_ZERO = -1.0e5  # what stands for the logarithm of zero
_FAR = 1000.0  # logarithm of a step, beyond which none is limited
_ROUND_OFF = 2.0**-54
_SLACK = 10.0  # binary digits that the last four terms may be smaller than the four before them
_FLOOR = 20.0  # binary digits between the velocities down to which the smaller one is resolved
_SAFETY = 0.9  # the logarithm that steps follow from is 6 % coarse


@inlined_kernel
def allotted(tolerance, unit, duration):
    """Return the part of the tolerance that a series may use: errors add up."""
    return larger(tolerance * unit / duration, _ROUND_OFF)


@inlined_kernel
def is_enough(c, order, enough):
    """Tell whether the last terms of both velocities are below a tolerance of their scale.

    As `step_of`, at a step of one unit.
    """
    scale1, scale2 = _largest(c, V1), _largest(c, V2)
    both = 2.0**-_FLOOR * larger(scale1, scale2)
    last1, last2 = _last(c, V1, order), _last(c, V2, order)
    within1, within2 = enough * larger(scale1, both), enough * larger(scale2, both)
    return (last1 <= within1) & (last2 <= within2)


@inlined_kernel
def _last(c, row, order):
    """Return the magnitude of the largest of the last eight terms, the earlier four reduced.

    Where only the cubic spring acts, symmetry leaves a term in four; begun at rest under a held
    force, in six; under a force that rises from zero, in eight. Reduced, because where no term is
    missing the last four are to decide.
    """
    last = larger(abs(c[row + order - 3]), _largest(c, row + order - 2))
    before = larger(abs(c[row + order - 7]), _largest(c, row + order - 6))
    return larger(last, 2.0**-_SLACK * before)


@inlined_kernel
def _largest(c, first):
    """Return the magnitude of the largest of three terms."""
    return larger(larger(abs(c[first]), abs(c[first + 1])), abs(c[first + 2]))


@borrowing_kernel
def step_of(c, reciprocals, tolerance, order):
    """Return the step at which the last terms fall below the tolerance, in units of the series.

    Those are the ones that `_last` looks at.

    Each velocity counts by its own scale, down to 1e-6 of the other's: a fast sphere that
    nothing joins to the carriage must not hide the carriage's motion.
    """
    log = _log2(tolerance)
    step1 = _step_of_one(c, reciprocals, V1, V2, log, order)
    step2 = _step_of_one(c, reciprocals, V2, V1, log, order)
    return _SAFETY * _exp2(smaller(step1, step2))


@inlined_kernel
def _step_of_one(c, reciprocals, row, other, log, order):
    """Return the logarithm of the step for one velocity, from what its last terms may reach.

    Of the leading terms the one that allows most counts: at rest or at a turning point the first is
    zero.

    Parameters
    ----------
    c
        (rows.SIZE,) or rows of vectors, read: the series.
    row, other
        Rows of this velocity and of the other [m/s].
    log
        Logarithm of the tolerance.
    """
    lead0 = log + _lead(c, row, other)
    lead1, lead2 = log + _lead(c, row + 1, other + 1), log + _lead(c, row + 2, other + 2)
    last = alike(lead0, _FAR)
    for n in range(order - 3, order + 1):
        allowed = _allowed(reciprocals, _log2(c[row + n]), lead0, lead1, lead2, n)
        last = smaller(last, allowed)
    # One logarithm for all four: they are a rough guard.
    largest = larger(abs(c[row + order - 7]), _largest(c, row + order - 6))
    before = _allowed(reciprocals, _log2(largest), lead0, lead1, lead2, order - 4)
    return smaller(last, before + _SLACK * reciprocals[RECIPROCAL + order - 1])


@inlined_kernel
def _lead(c, term, other):
    """Return the logarithm of the scale that a leading term of a velocity sets."""
    return larger(_log2(c[term]), _log2(c[other]) - _FLOOR)


@inlined_kernel
def _allowed(reciprocals, term, lead0, lead1, lead2, n):
    """Return the logarithm of the step that term n allows.

    Parameters
    ----------
    term
        Logarithm of the term.
    lead0, lead1, lead2
        Logarithms of what the leading terms allow it to be.
    n
        Its order.
    """
    last = RECIPROCAL + n - 1
    first, second, third = reciprocals[last], reciprocals[last - 1], reciprocals[last - 2]
    step = larger(larger((lead0 - term) * first, (lead1 - term) * second), (lead2 - term) * third)
    return where(term > _LOG_ZERO, step, _FAR)


@inlined_kernel
def _log2(x):
    """Return log2 of a magnitude, at most 0.09 too small: its bits read as an integer."""
    return where(x == 0.0, _LOG_ZERO, read_bits(abs(x)) * 2.0**-52 - 1023.0)


@inlined_kernel
def _exp2(y):
    """Return 2**y, at most 6 % too large."""
    return write_bits((smaller(larger(y, -_FAR), _FAR) + 1023.0) * 2.0**52)
