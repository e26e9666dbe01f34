"""Records: their time in an episode, their jets and their corners.

The kernels take `model`, (m,) float64, which they read; `own`, the first of a record's own slots in
the description of the excitation; `lanes`, (rows, lanes) float64; `row`, the first of the record's
rows; and `jet`, the first row of the jet, to which they add. They serve lane i, or the lanes
first .. last - 1.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation import interpolation
from mm_gym.lanes import layout as at

DATA, LENGTH, SPACING = 0, 1, 2
"""Own slots: where in the description its times, then its values begin, their number, and their
spacing, 0 if they are not even."""

SCALE, TIME_SCALE, START, SCRATCH = 0, 1, 2, 3
ROWS = SCRATCH + interpolation.TERMS


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
    points, scale = _points(model, own), lanes[row + SCALE, i]
    interpolation.add_interpolant(model, points, scale, begin, end, lanes, jet, row + SCRATCH, i)


@borrowing_kernel
def add_lines(model, own, lanes, row, jet, clock, first, last):
    """Add an even record whose corners are sample instants to a jet; as `add`, in less time.

    Parameters
    ----------
    model, own, lanes, row, jet, first, last
        See above.
    clock
        Three numbers, see `mm_gym.excitation.kinds`.
    """
    _, values, count, spacing = _points(model, own)
    now, intervals_per_step, interval = clock
    step, per_spacing = model[at.SAMPLE_INTERVAL], 1.0 / spacing
    for i in range(first, last):
        began = ((now - lanes[at.BEGAN, i]) * intervals_per_step + interval) * step
        begin = per_spacing * _own_time(lanes, row, began, i)
        end = per_spacing * _own_time(lanes, row, began + step, i)
        place = begin + interpolation.margin(begin, end)
        if place >= 0.0 and place < count - 1.0:
            k, scale = int(place), lanes[row + SCALE, i]
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
    points, time = _points(model, own), _own_time(lanes, row, began + elapsed, i)
    end = _own_time(lanes, row, began + duration, i)
    close = interpolation.margin(time, end)
    k = interpolation.segment_at(model, points, time + close) + 1
    corner = interpolation.time_of(model, points, k)
    if not corner < end - close:
        return duration
    since = (corner - lanes[row + START, i]) * lanes[row + TIME_SCALE, i] - began
    return since if elapsed < since < duration else duration


@borrowing_kernel
def _points(model, own):
    """Return the record's points, see `mm_gym.excitation.interpolation`."""
    first, count = int(model[at.EXCITATION]) + int(model[own + DATA]), int(model[own + LENGTH])
    return first, first + count, count, model[own + SPACING]


@borrowing_kernel
def _own_time(lanes, row, time, i):
    """Return the time of the record [s] at a time of the episode [s]."""
    return lanes[row + START, i] + time / lanes[row + TIME_SCALE, i]
