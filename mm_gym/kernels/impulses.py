"""The impulses of a sample interval: which lanes have some, when they come, what they change.

The kernels take the `clock` of `mm_gym.kernels.excitation`, and `count`, the number of the sample
interval in the episode.
"""

from __future__ import annotations

from mm_gym.kernels import impulse_process as process
from mm_gym.kernels import layout as at
from mm_gym.kernels.excitation import (
    IMPULSES,
    OWN,
    ROW,
    TARGET,
    intervals_since,
    is_impulse,
    part_count,
    part_slot,
)
from mm_gym.kernels.jit import borrowing_kernel

STRIDE = 32
"""Lanes looked at together for impulses, which are rare."""


@borrowing_kernel
def apply_first_impulses(model, lanes, clock, first, last):
    """Apply the impulses at the start of a sample interval; tell whether others come within it.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; the velocities and the rows of the impulses are written.
    clock
        Three numbers, see above.
    first, last
        The lanes first .. last - 1.
    """
    some, step = False, model[at.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if not is_impulse(model, slot):
            continue
        row = int(model[slot + ROW])
        for start in range(first, last, STRIDE):
            stop = min(start + STRIDE, last)
            if process.some_inside(lanes, row, clock, step, start, stop):
                some |= _apply_first(model, slot, lanes, clock, start, stop)
    return some


@borrowing_kernel
def _apply_first(model, slot, lanes, clock, first, last):
    """Do so for the impulses of a part in a few lanes."""
    some, row, step = False, int(model[slot + ROW]) + process.NEXT, model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        count = intervals_since(clock, lanes[at.BEGAN, i])
        if lanes[row, i] < process.before_end(count, step):
            since = process.earliest(count, step)
            while lanes[row, i] < process.after_start(count, step):
                v1, v2 = take_impulse(model, slot, lanes, since, i)
                lanes[at.V1, i] += v1
                lanes[at.V2, i] += v2
            some |= lanes[row, i] < process.before_end(count, step)
    return some


@borrowing_kernel
def take_impulse(model, slot, lanes, since, i):
    """Return by what the next impulse of a part changes v1 and v2 [m/s]."""
    size = process.take(model, slot + OWN, lanes, int(model[slot + ROW]), since, i)
    if model[slot + TARGET] > 0.0:
        return -size, -size  # (E4)
    return size / lanes[at.M1, i], 0.0  # (E3)


@borrowing_kernel
def has_impulses(model):
    """Tell whether a part is impulses."""
    return model[int(model[at.EXCITATION]) + IMPULSES] > 0.0


@borrowing_kernel
def some_impulse(model, lanes, clock, first, last):
    """Tell whether in one of the lanes an impulse comes before the sample interval's end."""
    step = model[at.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            row = int(model[slot + ROW])
            if process.some_inside(lanes, row, clock, step, first, last):
                return True
    return False


@borrowing_kernel
def next_impulse(model, lanes, count, i):
    """Return when the next impulse comes in sample interval `count`, or the interval's end.

    That is a time since the interval's start [s].
    """
    step = model[at.SAMPLE_INTERVAL]
    earliest = step
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            time = lanes[int(model[slot + ROW]) + process.NEXT, i]
            if time < process.before_end(count, step):
                earliest = min(earliest, max(time - count * step, 0.0))
    return earliest


@borrowing_kernel
def take_impulses(model, lanes, count, elapsed, i):
    """Return by what the impulses until some time of an interval change v1 and v2 [m/s].

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; the rows of the impulses are written.
    count
        Number of the sample interval in the episode.
    elapsed
        Time since its start [s].
    i
        The lane.
    """
    step, v1, v2 = model[at.SAMPLE_INTERVAL], 0.0, 0.0
    start, since = count * step, process.earliest(count, step)
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            row = int(model[slot + ROW])
            while lanes[row + process.NEXT, i] - start <= elapsed:
                first, second = take_impulse(model, slot, lanes, since, i)
                v1, v2 = v1 + first, v2 + second
    return v1, v2


@borrowing_kernel
def pass_impulses(model, lanes, count):
    """Leave out the impulses of lane 0 until the start of sample interval `count`."""
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            next_row = int(model[slot + ROW]) + process.NEXT
            while lanes[next_row, 0] < process.after_start(count, model[at.SAMPLE_INTERVAL]):
                take_impulse(model, slot, lanes, 0.0, 0)


@borrowing_kernel
def write_impulses(model, lanes, intervals, found):
    """Write the impulses within sample intervals since the start of an episode.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, 1) float64: the lane at the start; the rows of the impulses are written.
    intervals
        Number of the sample intervals.
    found
        (k, 4) written: see `mm_gym.simulation.recording.Recording.impulses`.

    Returns
    -------
    int
        Their number; beyond k they are only counted.
    """
    step, k = model[at.SAMPLE_INTERVAL], 0
    for n in range(intervals):
        count = float(n)
        pass_impulses(model, lanes, count)
        elapsed = next_impulse(model, lanes, count, 0)
        while elapsed < step:
            v1, v2 = take_impulses(model, lanes, count, elapsed, 0)
            if k < found.shape[0]:
                found[k, 0], found[k, 1], found[k, 2], found[k, 3] = count, elapsed, v1, v2
            k += 1
            elapsed = next_impulse(model, lanes, count, 0)
    return k
