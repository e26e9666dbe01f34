"""Records: their time in an episode, their jets and their corners.

A part of the excitation is a set of records, or of one record, of which each episode has one. Its
block of the description holds a table with a line for each, then their times and values; all lanes
share it.

The kernels take `model`, (m,) float64, which they read; `own`, the first of a record's own slots in
the description of the excitation; `lanes`, (rows, lanes) float64; `row`, the first of the record's
rows; and `jet`, the first row of the jet, to which they add. They serve lane i, or the lanes
first .. last - 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation import interpolation
from mm_gym.lanes import layout as at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Values = NDArray[np.float64]

TABLE, COUNT, IS_EVEN = 0, 1, 2
"""Own slots: where in the description the table begins, its lines, and whether all records are
evenly spaced."""

DATA, LENGTH, SPACING, FACTOR, LINE = 0, 1, 2, 3, 4
"""Slots of a line: where behind the table's beginning its times, then its values begin, their
number, their spacing, 0 if they are not even, and a factor of the values; length of a line."""

SCALE, TIME_SCALE, START, NUMBER, SCRATCH = 0, 1, 2, 3, 4
"""Rows; NUMBER is the record's line in the table."""

ROWS = SCRATCH + interpolation.TERMS


@borrowing_kernel
def begin(model, own, lanes, row, i):
    """Make what was drawn from [0, count) the number of a record."""
    lanes[row + NUMBER, i] = min(math.floor(lanes[row + NUMBER, i]), model[own + COUNT] - 1.0)


@borrowing_kernel
def add(model, own, lanes, row, jet, began, duration, i):
    """Add a record to a jet.

    Parameters
    ----------
    model, own, lanes, row, jet, i
        See above; scratch rows of the record are written too.
    began, duration
        Start of what the jet covers since that of the episode, and its length [s].
    """
    begin, end = _own_time(lanes, row, began, i), _own_time(lanes, row, began + duration, i)
    points, scale = _points(model, own, lanes, row, i), _scale(model, own, lanes, row, i)
    interpolation.add_interpolant(model, points, scale, begin, end, lanes, jet, row + SCRATCH, i)


@borrowing_kernel
def add_lines(model, own, lanes, row, jet, clock, first, last):
    """Add even records whose corners are sample instants to a jet; as `add`, in less time.

    Parameters
    ----------
    model, own, lanes, row, jet, first, last
        See above.
    clock
        Three numbers, see `mm_gym.excitation.kinds`.
    """
    now, intervals_per_step, interval = clock
    step = model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        _, values, count, spacing = _points(model, own, lanes, row, i)
        per_spacing = 1.0 / spacing
        began = ((now - lanes[at.BEGAN, i]) * intervals_per_step + interval) * step
        begin = per_spacing * _own_time(lanes, row, began, i)
        end = per_spacing * _own_time(lanes, row, began + step, i)
        place = begin + interpolation.margin(begin, end)
        if place >= 0.0 and place < count - 1.0:
            k, scale = int(place), _scale(model, own, lanes, row, i)
            start, slope = model[values + k], model[values + k + 1] - model[values + k]
            lanes[jet, i] += scale * (start + (begin - k) * slope)
            lanes[jet + 1, i] += scale * ((end - begin) * slope)


@borrowing_kernel
def next_corner(model, own, lanes, row, began, elapsed, duration, i):
    """Return the first corner after some time of an interval, or the interval's end.

    Parameters
    ----------
    model, own, lanes, row, i
        See above; nothing is written.
    began
        Start of the interval since that of the episode [s].
    elapsed, duration
        Times since the start of the interval [s].
    """
    points, time = _points(model, own, lanes, row, i), _own_time(lanes, row, began + elapsed, i)
    end = _own_time(lanes, row, began + duration, i)
    close = interpolation.margin(time, end)
    k = interpolation.segment_at(model, points, time + close) + 1
    corner = interpolation.time_of(model, points, k)
    if not corner < end - close:
        return duration
    since = (corner - lanes[row + START, i]) * lanes[row + TIME_SCALE, i] - began
    return since if elapsed < since < duration else duration


@borrowing_kernel
def _line(model, own, lanes, row, i):
    """Return where in the model a lane's record has its line, and where the table begins."""
    table = int(model[at.EXCITATION]) + int(model[own + TABLE])
    return table + LINE * int(lanes[row + NUMBER, i]), table


@borrowing_kernel
def _points(model, own, lanes, row, i):
    """Return the points of a lane's record, see `mm_gym.excitation.interpolation`."""
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


def block_of(motions: list[Values], factors: list[float], round_off: float) -> Values:
    """Return the block of a set of records.

    Parameters
    ----------
    motions
        Times [s] and values of each record, (2, n) float64.
    factors
        Of the values of each.
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


def points_in(block: Values, number: int) -> tuple[Values, float]:
    """Return times [s] and values (2, n), and the factor of the values, of a record in a block."""
    first, length, _, factor = block[LINE * number : LINE * (number + 1)]
    return block[int(first) : int(first + 2 * length)].reshape(2, -1), float(factor)
