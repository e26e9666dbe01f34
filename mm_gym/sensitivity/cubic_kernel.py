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
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.groups import read, write, write_state
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.lanes.simd_masks import all_hold, none
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.methods.taylor import blocks_kernel as motion
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as rows
from mm_gym.methods.taylor import step_size_kernel as step_size
from mm_gym.sensitivity.cubic_terms_kernel import (
    COLUMN_ROWS,
    CUBE,
    OF_MOTION,
    ORDER,
    SIGNAL,
    SLOPE,
    deviate,
    part_of_motion,
)
from mm_gym.sensitivity.generator_kernel import (
    ACCELERATION,
    COUPLING,
    OFFSET,
    V1,
    X1,
    slope,
)
from mm_gym.sensitivity.layout import CAUSES, FIRST_ROW, STATES, TANGENTS, WIDTH

MOST_SERIES = 100_000

_GROWTH = 1.25
"""Length of the longest series, over that of the one before it."""


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval, or a part of it."""
    c, status = np.zeros(rows.SIZE), at.OK
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
        for row in range(rows.BY_M1, rows.SIZE):
            numbers[row * LANES + k] = c[row]
        for row in range(4):
            numbers[row * rows.WIDTH * LANES + k] = lanes[row, lane]


@borrowing_kernel
def _propagate(model, lanes, c, b, i, count):
    """Advance a group of lanes, series by series.

    Parameters
    ----------
    model, lanes
        (m,) read; (rows, count) read, and state and deviations written.
    c
        (rows.SIZE,) read: 1 / n.
    b
        Rows of vectors: coefficients and state are read, the series written.
    i, count
        The lanes: count from i on.

    Returns
    -------
    int
        Status.
    """
    prefer_widest_vectors()
    tangents, width = int(model[FIRST_ROW]) + TANGENTS, int(model[WIDTH])
    for j in range(width):
        _read_column(lanes, b, tangents + j, width, COLUMN_ROWS + 4 * j, i, count)
    has_cube, has_springs = _needs_cube(model), not none(b[rows.K2] > 0.0)
    rest = unit = model[at.SAMPLE_INTERVAL]
    for _ in range(MOST_SERIES):
        part = 1.0
        b[motion.UNIT] = everywhere(unit)
        order = motion.expand(b, c, everywhere(OF_MOTION), ORDER)
        if order == ORDER:
            part = part_of_motion(b, unit)
        while part > 0.0:
            if part < 1.0:
                pieces = np.ceil(rest / (part * unit))
                order = _shorten(b, rest / pieces / unit, order)
                unit = rest / pieces
            _write_slopes(b, unit, order)
            if has_cube:
                _write_cubes(b, order)
            part = _deviate_all(model, lanes, c, b, unit, order, has_springs, i, count)
        _finish_series(b, width, order)
        if unit == rest:
            break
        rest -= unit
        unit = rest / np.ceil(rest / (_GROWTH * unit))
    else:
        return at.TOO_MANY_SERIES
    for j in range(width):
        _write_column(lanes, b, tangents + j, width, COLUMN_ROWS + 4 * j, i, count)
    return write_state(lanes, i, count, b[rows.X1], b[rows.X2], b[rows.V1], b[rows.V2])


@borrowing_kernel
def _needs_cube(model):
    """Tell whether a parameter's deviation is driven by x1**3."""
    found = False
    for j in range(STATES, int(model[WIDTH])):
        found |= model[CAUSES + j] == at.K1 or model[CAUSES + j] == at.BETA
    return found


@inlined_kernel
def _read_column(lanes, b, row, width, target, i, count):
    x1, v1 = read(lanes, row, i, count), read(lanes, row + 2 * width, i, count)
    b[target], b[target + 2] = x1, v1
    b[target + 1] = read(lanes, row + width, i, count) - x1
    b[target + 3] = read(lanes, row + 3 * width, i, count) - v1


@inlined_kernel
def _write_column(lanes, b, row, width, source, i, count):
    write(lanes, row, i, count, b[source])
    write(lanes, row + width, i, count, b[source] + b[source + 1])
    write(lanes, row + 2 * width, i, count, b[source + 2])
    write(lanes, row + 3 * width, i, count, b[source + 2] + b[source + 3])


@borrowing_kernel
def _shorten(b, part, order):
    """Give the motion's series a part of their unit of time; return the order that is enough there.

    Velocities stay in SI units.
    """
    power = part
    for n in range(1, order + 1):
        for row in range(rows.X1, rows.W, rows.WIDTH):
            b[row + n] = power * b[row + n]
        b[rows.SQUARE + n] = power * b[rows.SQUARE + n]
        power *= part
    for n in range(step_size.FEWEST, order, 2):
        if all_hold(step_size.is_enough(b, n, everywhere(OF_MOTION))):
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
def _deviate_all(model, lanes, c, b, unit, order, has_springs, i, count):
    """Write the end of every column; return 0, or the part of the unit that is to be taken instead.

    Parameters
    ----------
    model, lanes, c
        (m,), (rows, count) and (rows.SIZE,), read.
    b
        Rows of vectors: the motion's series and the columns' starts are read, their ends written.
    unit, order
        Length [s] and order of the series.
    has_springs
        Whether the sphere's place matters.
    i, count
        The lanes: count from i on.
    """
    prefer_widest_vectors()
    zero, width = everywhere(0.0), int(model[WIDTH])
    for j in range(width):
        cause, push, to_v1, to_w = int(model[CAUSES + j]), zero, zero, zero
        is_push = cause == at.FORCE and not model[at.BETWEEN] > 0.0
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
        part = deviate(b, c, row, target, unit, order, has_springs, is_driven)
        if part < 1.0:
            return part
    return 0.0


@borrowing_kernel
def _write_signal(lanes, b, cause, unit, order, i, count):
    """Write the series that drives the deviation of a parameter; return its factors.

    Parameters
    ----------
    lanes
        (rows, count) read.
    b
        Rows of vectors: the motion's series are read.
    cause
        Row of the parameter.
    unit, order
        Length [s] and order of the series.
    i, count
        The lanes: count from i on.

    Returns
    -------
    tuple
        Factors in the accelerations of x1 and of the offset.
    """
    m1, m2 = read(lanes, at.M1, i, count), read(lanes, at.M2, i, count)
    k1, alpha = read(lanes, at.K1, i, count), read(lanes, at.ALPHA, i, count)
    k0, stretch = read(lanes, at.K0, i, count), read(lanes, at.STRETCH, i, count)
    if cause == at.FORCE:  # held between the masses
        for n in range(order):
            b[SIGNAL + n] = everywhere(1.0 if n == 0 else 0.0)
        factor = unit * unit / m1
        return factor, -factor - unit * unit / m2
    if cause in (at.K1, at.BETA):
        beta = read(lanes, at.BETA, i, count)
        for n in range(order):
            if cause == at.K1:
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
