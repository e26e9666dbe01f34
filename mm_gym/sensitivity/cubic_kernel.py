"""Motion and deviations of plants with a cubic spring, LANES lanes at a time, as Taylor series.

That is the case without friction, springs of finite stretch and harmonic or sampled excitation. The
motion's series are those of `mm_gym.methods.taylor`. Along it the equations of the deviations are
linear, and what resists the carriage has the slope k1 (alpha + 3 beta x1**2). The lanes of a group
take their steps together, as long as the series of all of them allow.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma, prefer_widest_vectors
from mm_gym.kernels.groups import read, write, write_state
from mm_gym.kernels.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.kernels.memory import on_cache_line
from mm_gym.kernels.simd import LANES, element, everywhere
from mm_gym.kernels.simd_masks import larger, none
from mm_gym.kernels.simd_memory import rows_of
from mm_gym.methods.taylor import blocks_kernel as motion
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as rows
from mm_gym.sensitivity.layout import CAUSES, COLUMNS, FIRST_ROW, NONE, STATES, TANGENTS

ORDER = 28
"""Highest order of a series; even."""

CUT_OFF = 2.0**-46
"""Size of the last terms of the deviations, relative to their leading ones."""

OF_MOTION = 2.0**-50
"""The same of the motion: the series of a deviation is a derivative of it, and its terms fall less
quickly."""

MOST_SERIES = 100_000

_LAST, _LEADING, _ROUNDS = 4, 3, 3
_SHORTEST = 2.0**-10
"""Least part of its unit that a series is used for."""

# Rows of vectors behind those of the motion: the slope of what resists the carriage [N/m], then of
# each column the series of x1, offset, v1 and slip velocity, WIDTH apart.
_WIDTH = ORDER + 2
_SLOPE = motion.END
_COLUMN = _SLOPE + _WIDTH
_OFFSET, _V1, _W, _SIZE = _WIDTH, 2 * _WIDTH, 3 * _WIDTH, 4 * _WIDTH
_END = _COLUMN + COLUMNS * _SIZE


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval, or a part of it."""
    c, numbers, columns, status = np.zeros(rows.SIZE), on_cache_line(_END * LANES), STATES, at.OK
    for n in range(ORDER):
        c[rows.RECIPROCAL + n] = 1.0 / (n + 1.0)
    for j in range(STATES, COLUMNS):
        if model[CAUSES + j] != NONE:
            columns = j + 1
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        _load(lanes, c, numbers, i, count)
        status = max(status, _propagate(model, lanes, c, rows_of(numbers), columns, i, count))
    return status


@borrowing_kernel
def _load(lanes, c, numbers, i, count):
    """Write coefficients and states of the lanes i .. i + count - 1, the last one repeated."""
    for k in range(LANES):
        lane = i + min(k, count - 1)
        taylor.coefficients(lanes, lane, False, c)
        for row in range(rows.BY_M1, rows.SIZE):
            numbers[row * LANES + k] = c[row]
        for row in range(4):
            numbers[row * rows.WIDTH * LANES + k] = lanes[row, lane]


@borrowing_kernel
def _propagate(model, lanes, c, b, columns, i, count):
    """Advance a group of lanes, series by series.

    Parameters
    ----------
    model, lanes
        (m,) read; (rows, count) read, and state and deviations written.
    c
        (rows.SIZE,) read: 1 / n.
    b
        Rows of vectors: coefficients and state are read, the series written.
    columns
        How many columns of deviations there are.
    i, count
        The lanes: count from i on.

    Returns
    -------
    int
        Status.
    """
    prefer_widest_vectors()
    tangents = int(model[FIRST_ROW]) + TANGENTS
    for j in range(columns + columns % 2):
        for part in range(4):
            b[_COLUMN + j * _SIZE + part * _WIDTH] = read(
                lanes, tangents + part * COLUMNS + j, i, count
            )
    duration, elapsed = model[at.SAMPLE_INTERVAL], 0.0
    unit = duration
    for _ in range(MOST_SERIES):
        b[motion.UNIT] = everywhere(unit)
        order = motion.expand(b, c, everywhere(OF_MOTION), ORDER)
        _write_slopes(b, order)
        for j in range(0, columns, 2):
            push = 1.0 if j == STATES else 0.0
            _deviate(b, c, _COLUMN + j * _SIZE, push, unit, order)
        part = _part_of_unit(b, columns, unit, order)
        _evaluate(b, columns, part, order)
        rest = duration - elapsed
        if part == 1.0 and unit == rest:
            break
        elapsed += part * unit
        unit = min(1.25 * part * unit, duration - elapsed)
    else:
        return at.TOO_MANY_SERIES
    for j in range(columns):
        for part in range(4):
            x = b[_COLUMN + j * _SIZE + part * _WIDTH]
            write(lanes, tangents + part * COLUMNS + j, i, count, x)
    return write_state(lanes, i, count, b[rows.X1], b[rows.X2], b[rows.V1], b[rows.V2])


@borrowing_kernel
def _write_slopes(b, order):
    """Write the slope of what resists the carriage, k1 + 3 beta x1**2, term by term."""
    beta = 3.0 * b[rows.BETA]
    for n in range(order):
        b[_SLOPE + n] = beta * b[rows.SQUARE + n]
    b[_SLOPE] = b[_SLOPE] + b[rows.K1]


@borrowing_kernel
def _deviate(b, c, row, push, unit, order):
    """Write the series of two columns side by side, so that one hides the other's latency.

    Parameters
    ----------
    b
        Rows of vectors: coefficients, slopes and the columns' first terms are read.
    c
        (rows.SIZE,) read: 1 / n.
    row
        First row of the first column; that of the second follows behind it.
    push
        Force [N] on the carriage that makes the first column deviate.
    unit
        Unit of time [s].
    order
        Of the series.
    """
    prefer_widest_vectors()
    by_m1, d, damping, k2 = b[rows.BY_M1], b[rows.D], b[rows.C], b[rows.K2]
    by_both, other = by_m1 + b[rows.BY_M2], row + _SIZE
    x, offset, v, w = b[row], b[row + _OFFSET], b[row + _V1], b[row + _W]
    y, gap, u, s = b[other], b[other + _OFFSET], b[other + _V1], b[other + _W]
    for n in range(order):
        step = unit * c[rows.RECIPROCAL + n]
        outer, outer2 = fma(d, v, -push), d * u
        more, more2 = everywhere(0.0), everywhere(0.0)
        for m in range(0, n, 2):
            slope, following = b[_SLOPE + m], b[_SLOPE + m + 1]
            outer, outer2 = (
                fma(slope, b[row + n - m], outer),
                fma(slope, b[other + n - m], outer2),
            )
            more = fma(following, b[row + n - m - 1], more)
            more2 = fma(following, b[other + n - m - 1], more2)
        if n % 2 == 0:
            outer, outer2 = (
                fma(b[_SLOPE + n], b[row], outer),
                fma(b[_SLOPE + n], b[other], outer2),
            )
        outer, outer2 = outer + more, outer2 + more2
        inner, inner2 = fma(damping, w, k2 * offset), fma(damping, s, k2 * gap)
        x, offset, y, gap = step * v, step * w, step * u, step * s
        v, u = step * (by_m1 * (inner - outer)), step * (by_m1 * (inner2 - outer2))  # (1)
        w = step * fma(outer, by_m1, -inner * by_both)  # (2) less (1)
        s = step * fma(outer2, by_m1, -inner2 * by_both)
        b[row + n + 1], b[row + _OFFSET + n + 1] = x, offset
        b[row + _V1 + n + 1], b[row + _W + n + 1] = v, w
        b[other + n + 1], b[other + _OFFSET + n + 1] = y, gap
        b[other + _V1 + n + 1], b[other + _W + n + 1] = u, s
        push = 0.0


@inlined_kernel
def _size(b, row, unit, n):
    """Return the size of term n of a column [m]."""
    speed = larger(abs(b[row + _V1 + n]), abs(b[row + _W + n]))
    return larger(larger(abs(b[row + n]), abs(b[row + _OFFSET + n])), unit * speed)


@borrowing_kernel
def _part_of_unit(b, columns, unit, order):
    """Return the part of the unit within which all last terms are small enough in every lane.

    They are compared with the leading terms there.
    """
    part = 1.0
    for _ in range(_ROUNDS):
        following = 1.0
        for j in range(columns):
            row = _COLUMN + j * _SIZE
            lead, power = _size(b, row, unit, 0), part
            for n in range(1, _LEADING):
                lead, power = larger(lead, power * _size(b, row, unit, n)), power * part
            last = _size(b, row, unit, order)
            for n in range(order - _LAST + 1, order):
                last = larger(last, _size(b, row, unit, n))
            over = last > CUT_OFF * lead
            if not none(over):
                for k in range(LANES):
                    ratio = CUT_OFF * element(lead, k) / element(last, k)
                    if ratio < 1.0:
                        following = min(following, ratio)
        if following == 1.0:
            return part
        part = max(0.9 * following ** (1.0 / (order - _LAST + 1.0)), _SHORTEST)
    return part


@borrowing_kernel
def _evaluate(b, columns, part, order):
    """Advance motion and deviations by a part of the unit."""
    prefer_widest_vectors()
    for k in range(4):
        row = k * rows.WIDTH
        total = b[row + order]
        for n in range(order - 1, -1, -1):
            total = fma(total, part, b[row + n])
        b[row] = total
    for j in range(columns):
        row = _COLUMN + j * _SIZE
        x, offset, v, w = (
            b[row + order],
            b[row + _OFFSET + order],
            b[row + _V1 + order],
            b[row + _W + order],
        )
        for n in range(order - 1, -1, -1):
            x, offset = fma(x, part, b[row + n]), fma(offset, part, b[row + _OFFSET + n])
            v, w = fma(v, part, b[row + _V1 + n]), fma(w, part, b[row + _W + n])
        b[row], b[row + _OFFSET], b[row + _V1], b[row + _W] = x, offset, v, w
