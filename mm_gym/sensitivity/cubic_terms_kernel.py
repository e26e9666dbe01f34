"""Terms of a deviation of plants with a cubic spring, and how far they reach."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.simd import LANES, element, everywhere
from mm_gym.lanes.simd_masks import larger, none
from mm_gym.methods.taylor import blocks_kernel as motion
from mm_gym.methods.taylor import layout as rows

ORDER = 28
"""Highest order of a series; even."""

CUT_OFF = 2.0**-36
"""Size of the last four terms of the deviations, relative to their values: what is left out is a
hundredth of it, or less."""

OF_MOTION = 2.0**-41
"""The same of the motion: the series of a deviation is a derivative of it, and its terms fall less
quickly."""

_LAST, _LEADING = 4, 3
_SHORTEST = 2.0**-10
"""Least part of its unit that a series is used for."""

# Rows of vectors behind those of the motion, terms of a series: the slope of what resists the
# carriage over m1, x1**3, what drives a deviation, and x1 of a deviation. Then x1, offset, v1 and
# slip velocity of each column, at the start of a series and at its end.
SLOPE, CUBE, SIGNAL, DEVIATION, COLUMN_ROWS = (motion.END + (ORDER + 2) * k for k in range(5))


@borrowing_kernel
def part(lead, last, cut_off, order):
    """Return the part of the unit within which the last terms are below the cut-off."""
    smallest = 1.0
    if not none(last > cut_off * lead):
        for k in range(LANES):
            if element(last, k) > cut_off * element(lead, k):
                smallest = min(smallest, cut_off * element(lead, k) / element(last, k))
        return max(0.9 * smallest ** (1.0 / (order - _LAST + 1.0)), _SHORTEST)
    return 1.0


@borrowing_kernel
def deviate(b, c, row, target, unit, order, has_springs, is_driven):
    """Write a column at a series' end; return the part of the unit that its last terms allow.

    Two orders are worked out together: positions follow from the velocities before them.

    Parameters
    ----------
    b
        Rows of vectors: coefficients, slopes, signal, column and drive are read.
    c
        (rows.SIZE,) read: 1 / n.
    row, target
        Of the column's start and of its end: there are the drive's factors, and a held
        acceleration.
    unit, order
        Length [s] and order of the series.
    has_springs, is_driven
        Whether the sphere's place matters, and whether there is a signal.
    """
    prefer_widest_vectors()
    by_m1 = unit * b[rows.BY_M1]
    ratio, zero = b[rows.BY_M2] / b[rows.BY_M1], everywhere(0.0)
    g = by_m1 * b[rows.D], by_m1 * b[rows.C], unit * by_m1 * b[rows.K2], ratio
    to_v1, to_w, push = b[target], b[target + 1], b[target + 2]
    x, offset, v, w = b[row], b[row + 1], unit * b[row + 2], unit * b[row + 3]
    start = last = _size(x, offset, v, w)
    x_sum, offset_sum, v_sum, w_sum = x, offset, v, w
    for n in range(0, order, 2):
        step, following = c[rows.RECIPROCAL + n], c[rows.RECIPROCAL + n + 1]
        next_x = step * v
        b[DEVIATION + n], b[DEVIATION + n + 1] = x, next_x
        outer, next_outer, other = -push, b[SLOPE + n + 1] * b[DEVIATION], next_x
        for m in range(n + 1):
            bend, term = b[SLOPE + m], b[DEVIATION + n - m]
            outer, next_outer = fma(bend, term, outer), fma(bend, other, next_outer)
            other = term
        push = zero
        speed_up, slide = _accelerations(g, outer, offset, v, w, has_springs)
        if is_driven:
            signal = b[SIGNAL + n]
            speed_up, slide = fma(to_v1, signal, speed_up), fma(to_w, signal, slide)
        x_sum, offset_sum = x_sum + next_x, fma(step, w, offset_sum)
        if has_springs:
            offset = step * w
        if n == order - _LAST:
            last = _size(next_x, step * w, step * speed_up, step * slide)
        elif n > order - _LAST:
            last = larger(last, _size(next_x, step * w, step * speed_up, step * slide))
        v, w = step * speed_up, step * slide
        v_sum, w_sum = v_sum + v, w_sum + w
        x = following * v
        speed_up, slide = _accelerations(g, next_outer, offset, v, w, has_springs)
        if is_driven:
            signal = b[SIGNAL + n + 1]
            speed_up, slide = fma(to_v1, signal, speed_up), fma(to_w, signal, slide)
        x_sum, offset_sum = x_sum + x, fma(following, w, offset_sum)
        if has_springs:
            offset = following * w
        if n >= order - _LAST:
            size = _size(x, following * w, following * speed_up, following * slide)
            last = larger(last, size)
        v, w = following * speed_up, following * slide
        v_sum, w_sum = v_sum + v, w_sum + w
    rate = 1.0 / unit
    b[target], b[target + 1], b[target + 2], b[target + 3] = (
        x_sum,
        offset_sum,
        rate * v_sum,
        rate * w_sum,
    )
    lead = larger(start, _size(x_sum, offset_sum, v_sum, w_sum))
    return part(lead, last, CUT_OFF, order)


@inlined_kernel
def _accelerations(g, outer, offset, v, w, has_springs):
    """Return terms of the accelerations of x1 and of the offset.

    Parameters
    ----------
    g
        d, c and k2 over m1, and m1 / m2.
    outer
        What resists the carriage but for its damper, over m1.
    offset, v, w
        Terms of the offset, v1 and slip velocity.
    has_springs
        Whether the offset matters.
    """
    d, damping, k2, ratio = g
    inner = damping * w
    if has_springs:
        inner = fma(k2, offset, inner)
    speed_up = inner - fma(d, v, outer)  # (1) of docs/model.md
    return speed_up, fma(-ratio, inner, -speed_up)  # (2) less (1)


@inlined_kernel
def _size(x, offset, v, w):
    """Return the size of a term [m]."""
    return larger(larger(abs(x), abs(offset)), larger(abs(v), abs(w)))


@borrowing_kernel
def part_of_motion(b, unit):
    """Return the part of the unit within which the motion's last terms are small in every lane.

    They are compared with the leading terms.
    """
    lead, last = _size_of_motion(b, unit, 0), _size_of_motion(b, unit, ORDER)
    for n in range(1, _LEADING):
        lead = larger(lead, _size_of_motion(b, unit, n))
    for n in range(ORDER - _LAST + 1, ORDER):
        last = larger(last, _size_of_motion(b, unit, n))
    return part(lead, last, OF_MOTION, ORDER)


@inlined_kernel
def _size_of_motion(b, unit, n):
    """Return the size of term n of the motion [m]."""
    speed = larger(abs(b[rows.V1 + n]), abs(b[rows.V2 + n]))
    return larger(larger(abs(b[rows.X1 + n]), abs(b[rows.X2 + n])), unit * speed)
