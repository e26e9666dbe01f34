"""Filtered noise: exact samples of a linear filter driven by white noise, times an envelope.

Tags such as (E8) are equations of docs/excitation.md. The filter of a part has its rows from `row`
on. Its matrices are numbers of the model, or, where they are drawn, rows of each lane: m has them
from number or row k on. The loops run over lanes, without calls or branches, so that the compiler
vectorises them.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation.filters import (
    ORDER,
    OUTPUT,
    SPREAD,
    START_SPREAD,
    TRANSITION,
    write_matrices,
)
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.elementary import exponential
from mm_gym.lanes.memory import span
from mm_gym.lanes.random import count_draws, normals, normals_ahead

# Rows of a filter; behind them, if they are drawn, its matrices.
RMS, LOW_PASS, LOW_PASS_DAMPING, HIGH_PASS, HIGH_PASS_DAMPING, RISE, PLATEAU, DECAY = range(8)
STATE, VALUE, ROWS = 8, 12, 13
FILTER = range(LOW_PASS, HIGH_PASS_DAMPING + 1)  # what its matrices follow from

# Own slots of a part: whether the low-pass hands on its velocity too, the number of states, the
# slot of its matrices, 0 where they are drawn, and whether the envelope is 1 at all times.
PASSES_VELOCITY, STATES, PLACE, IS_LEVEL = range(4)


@inlined_kernel
def _number(m, k, i):
    """Return number k of the model, or row k of lane i."""
    return m[k] if m.ndim == 1 else m[k, i]


@inlined_kernel
def _low(m, k, i):
    """Return transition and spread of the low-pass, whose matrices begin at number k.

    As scalars: an array would be checked for overlap with every row of lanes before a loop.
    """
    spread = k + SPREAD
    return (
        (_number(m, k, i), _number(m, k + 1, i), _number(m, k + 4, i), _number(m, k + 5, i)),
        (_number(m, spread, i), _number(m, spread + 1, i), _number(m, spread + 2, i)),
    )


@inlined_kernel
def _high(m, k, i):
    """Return the rows of transition and spread of the high-pass."""
    return (
        _matrix_row(m, k + TRANSITION + 8, i),
        _matrix_row(m, k + TRANSITION + 12, i),
        _matrix_row(m, k + SPREAD + 3, i),  # the last belongs to the next row
        _matrix_row(m, k + SPREAD + 6, i),
    )


@inlined_kernel
def _matrix_row(m, k, i):
    """Return four numbers from number k on."""
    return _number(m, k, i), _number(m, k + 1, i), _number(m, k + 2, i), _number(m, k + 3, i)


@inlined_kernel
def _low_pass(m, x, g):
    """Return the low-pass's states a sample interval later (E12), from normal numbers g."""
    a, spread = m
    first = fma(spread[0], g[0], fma(a[0], x[0], a[1] * x[1]))
    return first, fma(spread[1], g[0], fma(spread[2], g[1], fma(a[2], x[0], a[3] * x[1])))


@inlined_kernel
def _high_pass(m, x, g):
    """Return the high-pass's states a sample interval later (E12)."""
    first, second = _product(m[0], x), _product(m[1], x)
    first = fma(m[2][0], g[0], fma(m[2][1], g[1], fma(m[2][2], g[2], first)))
    return first, second + _product(m[3], g)


@inlined_kernel
def _product(a, x):
    """Return a row of four numbers times four others."""
    return fma(a[0], x[0], fma(a[1], x[1], fma(a[2], x[2], a[3] * x[3])))


@inlined_kernel
def _states(lanes, row, i):
    """Return the filter's states; without high-pass the first two count."""
    return _matrix_row(lanes, row + STATE, i)


@inlined_kernel
def _normals_of_states(streams, i):
    """Return the normal numbers of four states, which stay uncounted."""
    return (*normals_ahead(streams, 0, i), *normals_ahead(streams, 2, i))


@inlined_kernel
def _envelope(lanes, row, time, i):
    """Return the envelope (E8) at a time [s] of the episode."""
    rise = lanes[row + RISE, i]
    rising = time / rise if time < rise else 1.0
    past = time - rise - lanes[row + PLATEAU, i]
    return rising * rising * (exponential(-lanes[row + DECAY, i] * past) if past > 0.0 else 1.0)


@inlined_kernel
def _end(lanes, clock_and_step, i):
    """Return the time [s] since the start of the episode at the sample interval's end."""
    now, intervals_per_step, interval, step = clock_and_step
    count = (now - lanes[layout.BEGAN, i]) * intervals_per_step + interval
    return (count + 1.0) * step


@inlined_kernel
def _contributed(has_high_pass, m, k, lanes, row, i):
    """Return what the states contribute to the noise; the matrices begin at number k."""
    x = _states(lanes, row, i)
    if has_high_pass:
        return _product(_matrix_row(m, k + OUTPUT, i), x)
    return fma(_number(m, k + OUTPUT, i), x[0], _number(m, k + OUTPUT + 1, i) * x[1])


@inlined_kernel
def _add_line(total, envelope, lanes, row, jet, i):
    """Add the line from the last value to the next to a jet; total: for rms and envelope 1."""
    before, after = lanes[row + VALUE, i], lanes[row + RMS, i] * envelope * total
    lanes[row + VALUE, i] = after
    lanes[jet, i] += before
    lanes[jet + 1, i] += after - before


@inlined_kernel
def _add_lines(has_high_pass, is_level, m, k, lanes, row, jet, clock_and_step, first, last):
    """Add the lines of the filters' outputs to the jets; the step is behind the clock's numbers."""
    if is_level:
        for i in span(first, last):
            total = _contributed(has_high_pass, m, k, lanes, row, i)
            _add_line(total, 1.0, lanes, row, jet, i)
    else:
        for i in span(first, last):
            total = _contributed(has_high_pass, m, k, lanes, row, i)
            envelope = _envelope(lanes, row, _end(lanes, clock_and_step, i), i)
            _add_line(total, envelope, lanes, row, jet, i)


@inlined_kernel
def _step_low_pass(low, lanes, row, streams, i):
    """Advance a lane's filter without high-pass."""
    x0, x1 = _low_pass(low, _states(lanes, row, i), normals(streams, i))
    lanes[row + STATE, i], lanes[row + STATE + 1, i] = x0, x1


@inlined_kernel
def _step_both(low, high, lanes, row, streams, i):
    """Advance a lane's filter with high-pass."""
    x, g = _states(lanes, row, i), _normals_of_states(streams, i)
    count_draws(streams, ORDER, i)
    x0, x1 = _low_pass(low, x, g)
    x2, x3 = _high_pass(high, x, g)
    lanes[row + STATE, i], lanes[row + STATE + 1, i] = x0, x1
    lanes[row + STATE + 2, i], lanes[row + STATE + 3, i] = x2, x3


@inlined_kernel
def _step_alone(has_high_pass, m, k, lanes, row, jet, streams, clock_and_step, i):
    """Advance a lone lane's filter, without what loops prepare, and add to its jet."""
    if has_high_pass:
        _step_both(_low(m, k, i), _high(m, k, i), lanes, row, streams, i)
    else:
        _step_low_pass(_low(m, k, i), lanes, row, streams, i)
    total = _contributed(has_high_pass, m, k, lanes, row, i)
    envelope = _envelope(lanes, row, _end(lanes, clock_and_step, i), i)
    _add_line(total, envelope, lanes, row, jet, i)


@inlined_kernel
def add(model, own, lanes, row, jet, streams, clock, first, last):
    """Advance the filter by a sample interval, exactly in distribution; add the noise to a jet."""
    clock_and_step = (*clock, model[layout.SAMPLE_INTERVAL])
    place, drawn = int(model[own + PLACE]), row + ROWS
    has_high_pass, k = model[own + STATES] == ORDER, int(model[layout.EXCITATION]) + place
    if last - first > 1:
        if place == 0:
            _add_drawn(model, own, lanes, row, jet, streams, clock_and_step, first, last)
        else:
            _add_shared(model, own, k, lanes, row, jet, streams, clock_and_step, first, last)
    elif place == 0:
        _step_alone(has_high_pass, lanes, drawn, lanes, row, jet, streams, clock_and_step, first)
    else:
        _step_alone(has_high_pass, model, k, lanes, row, jet, streams, clock_and_step, first)


@borrowing_kernel
def _add_shared(model, own, k, lanes, row, jet, streams, clock_and_step, first, last):
    """Advance filters whose matrices all lanes share, from slot k of the model on."""
    prefer_widest_vectors()
    low, high = _low(model, k, 0), _high(model, k, 0)
    is_level = model[own + IS_LEVEL] > 0.0
    if model[own + STATES] == ORDER:
        for i in span(first, last):
            _step_both(low, high, lanes, row, streams, i)
        _add_lines(True, is_level, model, k, lanes, row, jet, clock_and_step, first, last)
    else:
        for i in span(first, last):
            _step_low_pass(low, lanes, row, streams, i)
        _add_lines(False, is_level, model, k, lanes, row, jet, clock_and_step, first, last)


@borrowing_kernel
def _add_drawn(model, own, lanes, row, jet, streams, clock_and_step, first, last):
    """Advance filters of which each lane has matrices of its own.

    In several loops, because the compiler refuses to check so many rows for overlap in one.
    """
    prefer_widest_vectors()
    has_high_pass, is_level = model[own + STATES] == ORDER, model[own + IS_LEVEL] > 0.0
    k = row + ROWS
    if has_high_pass:
        for i in span(first, last):
            x, g = _states(lanes, row, i), _normals_of_states(streams, i)
            x2, x3 = _high_pass(_high(lanes, k, i), x, g)
            lanes[row + STATE + 2, i], lanes[row + STATE + 3, i] = x2, x3
    draws = ORDER if has_high_pass else ORDER // 2
    for i in span(first, last):
        g = normals_ahead(streams, 0, i)
        count_draws(streams, draws, i)
        x0, x1 = _low_pass(_low(lanes, k, i), _states(lanes, row, i), g)
        lanes[row + STATE, i], lanes[row + STATE + 1, i] = x0, x1
    if has_high_pass:
        _add_lines(True, is_level, lanes, k, lanes, row, jet, clock_and_step, first, last)
    else:
        _add_lines(False, is_level, lanes, k, lanes, row, jet, clock_and_step, first, last)


@borrowing_kernel
def begin(model, own, lanes, row, jet, streams, which):
    """Draw a filter's state from its stationary distribution, and add the first value to its jet.

    Matrices that are drawn are written first.
    """
    place, order, drawn = int(model[own + PLACE]), int(model[own + STATES]), row + ROWS
    k = int(model[layout.EXCITATION]) + place
    if place > 0:
        for i in which:
            _start(model, k, order, lanes, row, jet, streams, i)
        return
    filters = lanes[row + LOW_PASS : row + HIGH_PASS_DAMPING + 1]
    is_soil = model[own + PASSES_VELOCITY] > 0.0
    write_matrices(lanes, drawn, filters, is_soil, model[layout.SAMPLE_INTERVAL], which)
    for i in which:
        _start(lanes, drawn, order, lanes, row, jet, streams, i)


@inlined_kernel
def _start(m, k, order, lanes, row, jet, streams, i):
    """Draw the state of a lane's filter, and add the first value to its jet."""
    for j in range(order):
        lanes[row + STATE + j, i] = 0.0
    total = 0.0
    for column in range(0, order, 2):
        pair = normals(streams, i)
        for side in range(2):
            for j in range(column + side, order):
                root = _number(m, k + START_SPREAD + j * (j + 1) // 2 + column + side, i)
                lanes[row + STATE + j, i] += root * pair[side]
    for j in range(order):
        total += _number(m, k + OUTPUT + j, i) * lanes[row + STATE + j, i]
    value = lanes[row + RMS, i] * _envelope(lanes, row, 0.0, i) * total
    lanes[row + VALUE, i] = value
    lanes[jet, i] += value
