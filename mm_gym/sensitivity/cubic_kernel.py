"""Motion and deviations of plants with a cubic spring, LANES lanes at a time, as Taylor series.

That is the case without friction, springs of finite stretch and harmonic or sampled excitation. The
motion's series are those of `mm_gym.methods.taylor`. Along it the equations of the deviations are
linear, and what resists the carriage has the slope k1 (alpha + 3 beta x1**2). The lanes of a group
take their steps together, as long as the series of all of them allow. The unit of time is the
length of a series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.groups import read, write, write_state
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, element, everywhere
from mm_gym.lanes.simd_masks import all_hold, larger, none
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.methods.taylor import blocks_kernel as motion
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as rows
from mm_gym.methods.taylor import step_size_kernel as step_size
from mm_gym.sensitivity.columns_kernel import (
    ACCELERATION,
    COUPLING,
    OFFSET,
    V1,
    X1,
    read_column,
    slope,
    take_impulses,
    write_column,
)
from mm_gym.sensitivity.layout import CAUSES, FIRST_ROW, LAST_V1, LAST_V2, STATES, TANGENTS, WIDTH

ORDER = 28
"""Highest order of a series; even."""

_CUT_OFF = 2.0**-36
"""Size of the last four terms of the deviations, relative to their values: what is left out is a
hundredth of it, or less."""

_OF_MOTION = 2.0**-41
"""The same of the motion: the series of a deviation is a derivative of it, and its terms fall less
quickly."""

_LAST, _LEADING = 4, 3
_SHORTEST = 2.0**-10
"""Least part of its unit that a series is used for."""

# Rows of vectors behind those of the motion, terms of a series: the slope of what resists the
# carriage over m1, x1**3, what drives a deviation, and x1 of a deviation. Then x1, offset, v1 and
# slip velocity of each column, at the start of a series and at its end.
SLOPE, CUBE, SIGNAL, DEVIATION, COLUMN_ROWS = (motion.END + (ORDER + 2) * k for k in range(5))

MOST_SERIES = 100_000

_GROWTH = 1.25
"""Length of the longest series, over that of the one before it."""


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval, or a part of it."""
    c, status = np.zeros(rows.SIZE), layout.OK
    numbers = on_cache_line((COLUMN_ROWS + 8 * int(model[WIDTH])) * LANES)
    for n in range(ORDER):
        c[rows.RECIPROCAL + n] = 1.0 / (n + 1.0)
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        _load(model, lanes, c, numbers, i, count)
        status = max(status, _propagate(model, lanes, c, rows_of(numbers), i, count))
    return status


@borrowing_kernel
def _load(model, lanes, c, numbers, i, count):
    """Write coefficients and states of the lanes i .. i + count - 1, the last one repeated."""
    for k in range(LANES):
        lane = i + min(k, count - 1)
        taylor.coefficients(model, lanes, lane, False, c)
        for row in range(rows.BY_M1, rows.SMOOTH_END):
            numbers[row * LANES + k] = c[row]
        for row in range(4):
            numbers[row * rows.WIDTH * LANES + k] = lanes[row, lane]


@borrowing_kernel
def _propagate(model, lanes, c, b, i, count):
    """Advance a group of lanes, series by series."""
    prefer_widest_vectors()
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    tangents = own + TANGENTS
    take_impulses(model, lanes, b[rows.BY_M1], i, count)
    for j in range(width):
        column = read_column(lanes, tangents + j, width, 1.0, i, count)
        row = COLUMN_ROWS + 4 * j
        b[row], b[row + 1], b[row + 2], b[row + 3] = column
    has_cube = _needs_cube(model)
    rest = unit = model[layout.SAMPLE_INTERVAL]
    for _ in range(MOST_SERIES):
        part = 1.0
        b[motion.UNIT] = everywhere(unit)
        order = motion.expand(b, c, everywhere(_OF_MOTION), ORDER)
        if order == ORDER:
            part = _part_of_motion(b, unit)
        while part > 0.0:
            if part < 1.0:
                pieces = np.ceil(rest / (part * unit))
                order = _shorten(b, rest / pieces / unit, order)
                unit = rest / pieces
            _write_slopes(b, unit, order)
            if has_cube:
                _write_cubes(b, order)
            part = _deviate_all(model, lanes, c, b, unit, order, i, count)
        _finish_series(b, width, order)
        if unit == rest:
            break
        rest -= unit
        unit = rest / np.ceil(rest / (_GROWTH * unit))
    else:
        return layout.TOO_MANY_SERIES
    for j in range(width):
        row = COLUMN_ROWS + 4 * j
        column = b[row], b[row + 1], b[row + 2], b[row + 3]
        write_column(lanes, tangents + j, width, 1.0, column, i, count)
    write(lanes, own + LAST_V1, i, count, b[rows.V1])
    write(lanes, own + LAST_V2, i, count, b[rows.V2])
    return write_state(lanes, i, count, b[rows.X1], b[rows.X2], b[rows.V1], b[rows.V2])


@borrowing_kernel
def _needs_cube(model):
    """Tell whether a parameter's deviation is driven by x1**3."""
    found = False
    for j in range(STATES, int(model[WIDTH])):
        found |= model[CAUSES + j] == layout.K1 or model[CAUSES + j] == layout.BETA
    return found


@borrowing_kernel
def _shorten(b, part, order):
    """Give the motion's series a part of their unit; return the order that is enough there."""
    power = part
    for n in range(1, order + 1):
        for row in range(rows.X1, rows.W, rows.WIDTH):
            b[row + n] = power * b[row + n]
        b[rows.SQUARE + n] = power * b[rows.SQUARE + n]
        power *= part
    for n in range(step_size.FEWEST, order, 2):
        if all_hold(step_size.is_enough(b, n, everywhere(_OF_MOTION))):
            return n
    return order


@borrowing_kernel
def _write_slopes(b, unit, order):
    """Write the slope of what resists the carriage, k1 + 3 beta x1**2, over m1, term by term."""
    scale = unit * unit * b[rows.BY_M1]
    beta = 3.0 * scale * b[rows.BETA]
    for n in range(order):
        b[SLOPE + n] = beta * b[rows.SQUARE + n]
    b[SLOPE] = fma(scale, b[rows.K1], b[SLOPE])


@borrowing_kernel
def _write_cubes(b, order):
    """Write the series of x1**3."""
    for n in range(order):
        total = b[rows.SQUARE] * b[rows.X1 + n]
        for m in range(1, n + 1):
            total = fma(b[rows.SQUARE + m], b[rows.X1 + n - m], total)
        b[CUBE + n] = total


@borrowing_kernel
def _deviate_all(model, lanes, c, b, unit, order, i, count):
    """Write the end of every column; return 0, or the part of the unit to be taken instead."""
    prefer_widest_vectors()
    zero, width = everywhere(0.0), int(model[WIDTH])
    has_springs = not none(b[rows.K2] > 0.0)
    for j in range(width):
        cause, push, to_v1, to_w = int(model[CAUSES + j]), zero, zero, zero
        is_push = cause == layout.FORCE and not model[layout.BETWEEN] > 0.0
        if is_push:
            push = unit * unit * b[rows.BY_M1]
        elif cause >= 0:
            to_v1, to_w = _write_signal(lanes, b, cause, unit, order, i, count)
        target = COLUMN_ROWS + 4 * (width + j)
        if j == 1 and not has_springs:  # by the sphere's place: it goes along
            for k in range(4):
                b[target + k] = b[COLUMN_ROWS + 4 + k]
            continue
        b[target], b[target + 1] = to_v1, to_w
        b[target + 2] = push
        is_driven = cause >= 0 and not is_push
        row = COLUMN_ROWS + 4 * j
        part = _deviate(b, c, row, target, unit, order, has_springs, is_driven)
        if part < 1.0:
            return part
    return 0.0


@borrowing_kernel
def _write_signal(lanes, b, cause, unit, order, i, count):
    """Write the series that drives a parameter's deviation; return its factors, as of `slope`."""
    m1, m2 = read(lanes, layout.M1, i, count), read(lanes, layout.M2, i, count)
    k1, alpha = read(lanes, layout.K1, i, count), read(lanes, layout.ALPHA, i, count)
    k0, stretch = read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count)
    if cause == layout.FORCE:  # held between the masses
        for n in range(order):
            b[SIGNAL + n] = everywhere(1.0 if n == 0 else 0.0)
        factor = unit * unit / m1
        return factor, -factor - unit * unit / m2
    if cause in (layout.K1, layout.BETA):
        beta = read(lanes, layout.BETA, i, count)
        for n in range(order):
            if cause == layout.K1:
                b[SIGNAL + n] = fma(beta, b[CUBE + n], alpha * b[rows.X1 + n])
            else:
                b[SIGNAL + n] = k1 * b[CUBE + n]
        factor = unit * unit / m1
        return -factor, factor
    which, to_v1, to_w = slope(cause, (m1, m2, k1, alpha, k0, stretch), unit)
    for n in range(order):
        if which == X1:
            signal = b[rows.X1 + n]
        elif which == OFFSET:
            signal = b[rows.X2 + n] - b[rows.X1 + n]
        elif which == V1:
            signal = unit * b[rows.V1 + n]
        elif which == ACCELERATION:
            signal = (n + 1.0) * unit * b[rows.V1 + n + 1]
        elif which == COUPLING:
            signal = -(n + 1.0) * unit * (m2 / m1) * b[rows.V2 + n + 1]
        else:
            signal = unit * (b[rows.V2 + n] - b[rows.V1 + n])
        b[SIGNAL + n] = signal
    return to_v1, to_w


@borrowing_kernel
def _finish_series(b, width, order):
    """Advance the motion by a series, and take the columns' ends as their starts."""
    prefer_widest_vectors()
    for row in range(rows.X1, rows.W, rows.WIDTH):
        total = b[row + order]
        for n in range(order - 1, -1, -1):
            total = total + b[row + n]
        b[row] = total
    for k in range(4 * width):
        b[COLUMN_ROWS + k] = b[COLUMN_ROWS + 4 * width + k]


@borrowing_kernel
def _part(lead, last, cut_off, order):
    """Return the part of the unit within which the last terms are below the cut-off."""
    smallest = 1.0
    if not none(last > cut_off * lead):
        for k in range(LANES):
            if element(last, k) > cut_off * element(lead, k):
                smallest = min(smallest, cut_off * element(lead, k) / element(last, k))
        return max(0.9 * smallest ** (1.0 / (order - _LAST + 1.0)), _SHORTEST)
    return 1.0


@borrowing_kernel
def _deviate(b, c, row, target, unit, order, has_springs, is_driven):
    """Write a column at a series' end; return the part of the unit that its last terms allow.

    Two orders are worked out together: positions follow from the velocities before them. Of the
    target, where the column's end is written, the factors of the signal and a held acceleration are
    read.
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
    b[target], b[target + 1] = x_sum, offset_sum
    b[target + 2], b[target + 3] = rate * v_sum, rate * w_sum
    lead = larger(start, _size(x_sum, offset_sum, v_sum, w_sum))
    return _part(lead, last, _CUT_OFF, order)


@inlined_kernel
def _accelerations(g, outer, offset, v, w, has_springs):
    """Return terms of the accelerations of x1 and of the offset.

    Of g these are d, c and k2 over m1, and m1 / m2; `outer` resists the carriage but for its
    damper, over m1.
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
def _part_of_motion(b, unit):
    """Return the part of the unit within which the motion's last terms are small in every lane."""
    lead, last = _size_of_motion(b, unit, 0), _size_of_motion(b, unit, ORDER)
    for n in range(1, _LEADING):
        lead = larger(lead, _size_of_motion(b, unit, n))
    for n in range(ORDER - _LAST + 1, ORDER):
        last = larger(last, _size_of_motion(b, unit, n))
    return _part(lead, last, _OF_MOTION, ORDER)


@inlined_kernel
def _size_of_motion(b, unit, n):
    """Return the size of term n of the motion [m]."""
    speed = larger(abs(b[rows.V1 + n]), abs(b[rows.V2 + n]))
    return larger(larger(abs(b[rows.X1 + n]), abs(b[rows.X2 + n])), unit * speed)
