"""The series of `taylor.kernel` on many lanes at a time, for the plain case.

That is the cubic spring without friction, sources or springs of finite stretch. Every lane has a
slot in the vectors; one whose sample interval is done makes room for the next. A lane's arithmetic
and its decisions are those of `taylor.kernel`, operation by operation: results depend neither on
which of the two works, nor on a lane's neighbours.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, alike
from mm_gym.lanes.simd_masks import larger, none, smaller, where
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.carriage_spring import has_escaped
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as rows
from mm_gym.methods.taylor import step_size_kernel as taylor_step

FEWEST_LANES = 4
"""Lanes from which on a block is quicker than one lane after the other."""

# Rows behind those of the series and the coefficients: where each slot is in its sample interval.
_LANE, _ELAPSED, UNIT, _COUNT, _ORDER, _STATUS, END = (rows.SMOOTH_END + k for k in range(7))
_IDLE = _BUSY = -1.0  # values of the rows LANE and STATUS


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    if last - first < FEWEST_LANES or not _is_plain(model):
        return taylor.propagate(model, lanes, first, last)
    return _propagate_in_slots(model, lanes, first, last)


@kernel
def _propagate_in_slots(model, lanes, first, last):
    c, b = np.zeros(rows.SIZE), on_cache_line(END * LANES)
    taylor.write_reciprocals(model, c)
    return _propagate(model, lanes, c, b, first, last)


@borrowing_kernel
def _is_plain(model):
    """Tell whether there is a cubic spring and nothing that is worked out lane by lane."""
    others = (
        model[rows.HAS_FRICTION]
        + model[rows.IS_FINITE]
        + model[layout.HARMONIC_COUNT]
        + model[layout.TERMS]
    )
    return model[rows.IS_CUBIC] > 0.0 and others == 0.0


@borrowing_kernel
def _propagate(model, lanes, c, b, first, last):
    """Advance the lanes, each in a slot as soon as one is free.

    Parameters
    ----------
    c
        (rows.SIZE,) read: 1 / n; the coefficients of one lane are written.
    b
        (END * LANES,) written: room for LANES slots.
    """
    most, status, waiting, busy = int(model[rows.ORDER]), layout.OK, first, 0
    for i in range(LANES):
        waiting = _occupy(model, lanes, c, b, i, waiting, last)
        busy += b[_LANE * LANES + i] != _IDLE
    while busy > 0:
        _advance(model, c, rows_of(b), most)
        for i in range(LANES):
            reached = b[_STATUS * LANES + i]
            if reached != _BUSY and b[_LANE * LANES + i] != _IDLE:
                if reached in (layout.OK, layout.ESCAPED):
                    _leave(lanes, b, i)
                status = max(status, int(reached))
                waiting = _occupy(model, lanes, c, b, i, waiting, last)
                busy -= b[_LANE * LANES + i] == _IDLE
    return status


@borrowing_kernel
def _occupy(model, lanes, c, b, i, lane, last):
    """Load a lane into a slot, or rest when there is none; return the next lane.

    Parameters
    ----------
    c
        (rows.SIZE,) written: the coefficients of the lane.
    b
        (END * LANES,) written: the rows of slot i.
    i
        Number of the slot.
    lane, last
        The lane, and the number of lanes: from there on there is none.
    """
    b[_ELAPSED * LANES + i] = b[_COUNT * LANES + i] = b[UNIT * LANES + i] = 0.0
    b[_LANE * LANES + i] = _IDLE
    if lane >= last:
        for row in range(rows.BY_M1, rows.SMOOTH_END):
            b[row * LANES + i] = 0.0
        for row in range(4):
            b[row * rows.WIDTH * LANES + i] = 0.0
        return lane
    taylor.coefficients(model, lanes, lane, False, c)
    for row in range(rows.BY_M1, rows.SMOOTH_END):
        b[row * LANES + i] = c[row]
    for row in range(4):
        b[row * rows.WIDTH * LANES + i] = lanes[row, lane]
    b[_LANE * LANES + i], b[UNIT * LANES + i] = lane, np.inf
    return lane + 1


@borrowing_kernel
def _leave(lanes, b, i):
    """Write the state that a slot's lane has reached."""
    lane = int(b[_LANE * LANES + i])
    for row in range(4):
        lanes[row, lane] = b[row * rows.WIDTH * LANES + i]


@borrowing_kernel
def _advance(model, c, b, most):
    """Advance every slot by one series."""
    tolerance, duration = model[rows.TOLERANCE], model[layout.SAMPLE_INTERVAL]
    rest = duration - b[_ELAPSED]
    unit = smaller(b[UNIT], rest)
    remaining = where(unit > 0.0, rest / unit, 1.0)
    part = taylor_step.allotted(tolerance, unit, duration)
    b[UNIT] = unit
    top = expand(b, c, where(remaining == 1.0, part, -1.0), most)
    order, theta = b[_ORDER], alike(unit, 1.0)
    if top == most:
        step = smaller(taylor_step.step_of(b, c, part, most), remaining)
        theta = where(order < float(most), 1.0, step)
    size = _evaluate(b, theta, order, top)
    elapsed, count = b[_ELAPSED] + theta * unit, b[_COUNT] + 1.0
    status = where(count >= float(taylor.MOST_STEPS), float(layout.TOO_MANY_SERIES), _BUSY)
    status = where(theta == remaining, float(layout.OK), status)
    status = where(elapsed >= duration, float(layout.OK), status)
    escaped = has_escaped(b[rows.X1], b[rows.V1], b[rows.ESCAPE])
    status = where(escaped, float(layout.ESCAPED), status)
    b[_STATUS] = where(size < np.inf, status, float(layout.DIVERGED))
    b[_ELAPSED], b[_COUNT], b[UNIT] = elapsed, count, larger(theta, 2.0**-20) * unit


@borrowing_kernel
def expand(b, c, enough, most):
    """Write the series of all slots and the order of each; return the highest.

    As `taylor.expand` has it.
    """
    x1, x2, v1, v2, unit = b[rows.X1], b[rows.X2], b[rows.V1], b[rows.V2], b[UNIT]
    by_m1, by_m2, d, damping = (
        b[rows.BY_M1],
        b[rows.BY_M2],
        b[rows.D],
        b[rows.C],
    )
    k1, beta, k2, held, pair = (
        b[rows.K1],
        b[rows.BETA],
        b[rows.K2],
        b[rows.U],
        b[rows.PAIR],
    )
    none_ends, order = none(enough > 0.0), alike(unit, float(most))
    for m in range(most // 2):
        n = m + m
        step, next_step = unit * c[rows.RECIPROCAL + n], unit * c[rows.RECIPROCAL + n + 1]
        next_x1, next_x2 = step * v1, step * v2
        b[rows.X1 + n + 1], b[rows.X2 + n + 1] = next_x1, next_x2
        cube, next_cube = taylor.cubes(b, m, x1, next_x1)
        inner, next_inner = fma(k2, x2 - x1, pair), k2 * (next_x2 - next_x1)
        outer = fma(k1, x1, fma(beta, cube, -held))
        v1, v2 = taylor.accelerated(step, by_m1, by_m2, d, damping, inner, outer, 0.0, v1, v2)
        b[rows.V1 + n + 1], b[rows.V2 + n + 1] = v1, v2
        x1, x2, outer = next_step * v1, next_step * v2, fma(k1, next_x1, beta * next_cube)
        v1, v2 = taylor.accelerated(
            next_step, by_m1, by_m2, d, damping, next_inner, outer, 0.0, v1, v2
        )
        b[rows.X1 + n + 2], b[rows.X2 + n + 2], b[rows.V1 + n + 2], b[rows.V2 + n + 2] = (
            x1,
            x2,
            v1,
            v2,
        )
        held = pair = alike(held, 0.0)
        if n + 2 >= taylor_step.FEWEST and not none_ends:
            ends = taylor_step.is_enough(b, n + 2, enough) & (enough > 0.0)
            order = where(ends, smaller(order, n + 2.0), order)
            if none(order > n + 2.0):
                b[_ORDER] = order
                return n + 2
    b[_ORDER] = order
    return most


@inlined_kernel
def _evaluate(b, theta, order, top):
    """Advance the states, each by the terms up to its own order; return their magnitude."""
    zero = alike(theta, 0.0)
    x1 = x2 = v1 = v2 = zero
    for n in range(top, 0, -1):
        counts = order >= float(n)
        x1, x2 = fma(x1, theta, b[rows.X1 + n]), fma(x2, theta, b[rows.X2 + n])
        v1, v2 = fma(v1, theta, b[rows.V1 + n]), fma(v2, theta, b[rows.V2 + n])
        x1, x2 = where(counts, x1, zero), where(counts, x2, zero)
        v1, v2 = where(counts, v1, zero), where(counts, v2, zero)
    x1, x2 = fma(x1, theta, b[rows.X1]), fma(x2, theta, b[rows.X2])
    v1, v2 = fma(v1, theta, b[rows.V1]), fma(v2, theta, b[rows.V2])
    b[rows.X1], b[rows.X2], b[rows.V1], b[rows.V2] = x1, x2, v1, v2
    return abs(x1) + abs(x2) + abs(v1) + abs(v2)
