"""Records: their time in an episode, their jets and their corners.

A part of the excitation is a set of records, or of one record, of which each episode has one. Its
block of the description holds a table with a line for each, then their times and values; all lanes
share it.

Points of a record are a tuple: the slots of the model at which their times and their values begin,
their number, and their spacing, which is 0 if they are not even. The interpolant is linear, and 0
before the first point and after the last.

Over a sample interval with corners inside, the interpolant p is replaced by the polynomial q of
degree MOMENTS that has its end value and its moments up to t^(MOMENTS - 1). A linear plant adds the
integral of g p to its state, where g is a sum of exponentials: what q leaves of that is
(rate h / 2)^MOMENTS / (2^(MOMENTS - 1) MOMENTS!) of |p - q|, below 1e-11 for rate h = 0.5.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout

TABLE, COUNT, IS_EVEN = 0, 1, 2
"""Own slots: where in the description the table begins, its lines, and whether all records are
evenly spaced."""

DATA, LENGTH, SPACING, FACTOR, LINE = 0, 1, 2, 3, 4
"""Slots of a line: where behind the table's beginning its times, then its values begin, their
number, their spacing, 0 if they are not even, and a factor of the values; length of a line."""

MOMENTS = 8
TERMS = MOMENTS + 1
"""Coefficients of the polynomial."""

_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(TERMS // 2 + 1)
NODES, WEIGHTS = 0.5 * (_ROOTS + 1.0), 0.5 * _WEIGHTS
"""Gauss's rule on [0, 1], exact for a line times a Legendre polynomial of degree MOMENTS - 1."""

MONOMIALS = np.array(
    [
        [(-1.0) ** (k + n) * math.comb(k, n) * math.comb(k + n, n) for n in range(TERMS)]
        for k in range(TERMS)
    ]
)
"""Coefficients of t^n in Legendre's polynomial k of 2 t - 1."""

ROUND_OFF = 2.0**-48
"""Size of the rounding of a time, relative to it."""

CLOSE = 1e-12
"""Part of an interval below which a corner is at its end."""

SCALE, TIME_SCALE, START, NUMBER, SCRATCH = 0, 1, 2, 3, 4
"""Rows; NUMBER is the record's line in the table."""

ROWS = SCRATCH + TERMS


@borrowing_kernel
def begin(model, own, lanes, row, i):
    """Make what was drawn from [0, count) the number of a record."""
    lanes[row + NUMBER, i] = min(math.floor(lanes[row + NUMBER, i]), model[own + COUNT] - 1.0)


@borrowing_kernel
def add(model, own, lanes, row, jet, began, duration, i):
    """Add a record to a jet over a duration from `began` on; scratch rows of it are written too."""
    begin, end = _own_time(lanes, row, began, i), _own_time(lanes, row, began + duration, i)
    points, scale = _points(model, own, lanes, row, i), _scale(model, own, lanes, row, i)
    add_interpolant(model, points, scale, begin, end, lanes, jet, row + SCRATCH, i)


@borrowing_kernel
def add_lines(model, own, lanes, row, jet, clock, first, last):
    """Add even records whose corners are sample instants to a jet; as `add`, in less time."""
    now, intervals_per_step, interval = clock
    step = model[layout.SAMPLE_INTERVAL]
    for i in range(first, last):
        _, values, count, spacing = _points(model, own, lanes, row, i)
        per_spacing = 1.0 / spacing
        began = ((now - lanes[layout.BEGAN, i]) * intervals_per_step + interval) * step
        begin = per_spacing * _own_time(lanes, row, began, i)
        end = per_spacing * _own_time(lanes, row, began + step, i)
        place = begin + margin(begin, end)
        if place >= 0.0 and place < count - 1.0:
            k, scale = int(place), _scale(model, own, lanes, row, i)
            start, slope = model[values + k], model[values + k + 1] - model[values + k]
            lanes[jet, i] += scale * (start + (begin - k) * slope)
            lanes[jet + 1, i] += scale * ((end - begin) * slope)


@borrowing_kernel
def next_corner(model, own, lanes, row, began, elapsed, duration, i):
    """Return the first corner after some time of an interval, or the interval's end."""
    points, time = _points(model, own, lanes, row, i), _own_time(lanes, row, began + elapsed, i)
    end = _own_time(lanes, row, began + duration, i)
    close = margin(time, end)
    k = segment_at(model, points, time + close) + 1
    corner = time_of(model, points, k)
    if not corner < end - close:
        return duration
    since = (corner - lanes[row + START, i]) * lanes[row + TIME_SCALE, i] - began
    return since if elapsed < since < duration else duration


@borrowing_kernel
def _line(model, own, lanes, row, i):
    """Return where in the model a lane's record has its line, and where the table begins."""
    table = int(model[layout.EXCITATION]) + int(model[own + TABLE])
    return table + LINE * int(lanes[row + NUMBER, i]), table


@borrowing_kernel
def _points(model, own, lanes, row, i):
    """Return the points of a lane's record."""
    line, table = _line(model, own, lanes, row, i)
    first, count = table + int(model[line + DATA]), int(model[line + LENGTH])
    return first, first + count, count, model[line + SPACING]


@borrowing_kernel
def _scale(model, own, lanes, row, i):
    """Return the factor of the values of a lane's record."""
    return lanes[row + SCALE, i] * model[_line(model, own, lanes, row, i)[0] + FACTOR]


@borrowing_kernel
def _own_time(lanes, row, time, i):
    """Return the time of the record [s] at a time of the episode [s]."""
    return lanes[row + START, i] + time / lanes[row + TIME_SCALE, i]


@borrowing_kernel
def time_of(model, points, k):
    """Return the time of a point; behind the last one it is infinite."""
    times, _, count, spacing = points
    if k >= count:
        return np.inf
    return k * spacing if spacing > 0.0 else model[times + k]


@borrowing_kernel
def segment_at(model, points, time):
    """Return the last point that is not later than a time, -1 before the first one."""
    _, _, count, spacing = points
    if not time >= time_of(model, points, 0):
        return -1
    if time >= time_of(model, points, count - 1):
        return count - 1
    if spacing > 0.0:
        k = min(int(time / spacing), count - 1)
        if k * spacing > time:
            return k - 1
        return k + 1 if (k + 1) * spacing <= time else k
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if time_of(model, points, middle) <= time:
            low = middle
        else:
            high = middle
    return low


@borrowing_kernel
def _line_at(model, points, k, time):
    """Return at a time the line from point k to the next; 0 beyond the ends."""
    _, values, count, _ = points
    if k < 0 or k >= count - 1:
        return 0.0
    start = time_of(model, points, k)
    part = (time - start) / (time_of(model, points, k + 1) - start)
    return (1.0 - part) * model[values + k] + part * model[values + k + 1]


@borrowing_kernel
def margin(begin, end):
    """Return the time below which a point is at an end of an interval."""
    return ROUND_OFF * max(abs(begin), abs(end)) + CLOSE * (end - begin)


@borrowing_kernel
def add_interpolant(model, points, scale, begin, end, lanes, jet, scratch, i):
    """Add the interpolant over begin .. end to a jet: exactly, or its projection.

    TERMS rows of the jet (2 if there are no corners inside) and of the scratch are written; `scale`
    is a factor of the values.
    """
    close = margin(begin, end)
    k = segment_at(model, points, begin + close)
    if not time_of(model, points, k + 1) < end - close:
        before, after = _line_at(model, points, k, begin), _line_at(model, points, k, end)
        lanes[jet, i] += scale * before
        lanes[jet + 1, i] += scale * (after - before)
        return
    for n in range(TERMS):
        lanes[scratch + n, i] = 0.0
    start = begin
    while True:
        stop = time_of(model, points, k + 1)
        if not stop < end - close:
            break
        _add_moments(model, points, k, start, stop, begin, end, lanes, scratch, i)
        start, k = stop, k + 1
    _add_moments(model, points, k, start, end, begin, end, lanes, scratch, i)
    rest = _line_at(model, points, k, end)
    for n in range(MOMENTS):
        rest -= lanes[scratch + n, i]
    lanes[scratch + MOMENTS, i] = rest  # every Legendre polynomial ends in 1
    for n in range(TERMS):
        total = 0.0
        for degree in range(n, TERMS):
            total += MONOMIALS[degree, n] * lanes[scratch + degree, i]
        lanes[jet + n, i] += scale * total


@borrowing_kernel
def _add_moments(model, points, k, start, stop, begin, end, lanes, scratch, i):
    """Add a line's part of the coefficients of the Legendre polynomials over begin .. end."""
    share = (stop - start) / (end - begin)
    for node in range(NODES.shape[0]):
        time = start + NODES[node] * (stop - start)
        value = WEIGHTS[node] * share * _line_at(model, points, k, time)
        place = 2.0 * (time - begin) / (end - begin) - 1.0
        legendre, following = 1.0, place
        for n in range(MOMENTS):
            lanes[scratch + n, i] += (2.0 * n + 1.0) * value * legendre
            legendre, following = (
                following,
                ((2.0 * n + 3.0) * place * following - (n + 1.0) * legendre) / (n + 2.0),
            )


def block_of(motions: list[Array], factors: list[float], round_off: float) -> Array:
    """Return the block of a set of records.

    Parameters
    ----------
    motions, factors
        Times [s] and values of each record, (2, n) float64, and a factor of its values.
    round_off
        Size of the rounding of a time, relative to it.
    """
    table = np.zeros((len(motions), LINE))
    place = table.size
    for line, points, factor in zip(table, motions, factors, strict=True):
        times = points[0]
        spacing = times[-1] / (len(times) - 1)  # the shortest one is rounded
        even = spacing * np.arange(len(times))
        is_even = bool(np.all(np.abs(times - even) <= round_off * even))
        line[:] = place, len(times), spacing if is_even else 0.0, factor
        place += points.size
    return np.concatenate([table.ravel(), *(points.ravel() for points in motions)])


def points_in(block: Array, number: int) -> tuple[Array, float]:
    """Return times [s] and values (2, n), and the factor of the values, of a record in a block."""
    first, length, _, factor = block[LINE * number : LINE * (number + 1)]
    return block[int(first) : int(first + 2 * length)].reshape(2, -1), float(factor)
