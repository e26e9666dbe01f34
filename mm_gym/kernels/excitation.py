"""Excitation besides harmonics: forces on the carriage and accelerations of the ground.

In each sample interval of length h, each part of the excitation adds a polynomial in t / h to a
jet: to that of the force [N], or to that of the ground's acceleration [m/s^2].
`mm_gym.kernels.jets` has what the methods read. Samples of filtered noise are linear in between; a
sweep adds its Taylor series, whose remainder is below round-off; impulses change the velocities,
each at its own time. Impulses and the corners of records may divide a sample interval: see
`mm_gym.kernels.crossing`.

A kind of excitation is a code, its slots and rows, a branch in `begin_excitation` and one in
`excite`; `mm_gym.plant.excitation.KINDS` has the rest. Tags such as (E1) are equations of
docs/excitation.md.

The kernels of a kind take `slot`, the first slot of a part in the description, and `clock`: the
control steps made so far, the sample intervals of each, and the index of the present one.
"""

from __future__ import annotations

import math

from mm_gym.kernels import impulses, record
from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.memory import fill
from mm_gym.kernels.noise import VALUE, advance_filter, prepare_filter, start_filter

# Slots of the description, at the end of the model array: the number of parts that are not
# harmonics, whether a record has corners between sample instants, whether there are impulses, SIZE
# slots for each part, then the times and values of the records.
CORNERS, IMPULSES, FIRST, SIZE = 1, 2, 3, 6
KIND, TARGET, ROW, OWN = 0, 1, 2, 3
IMPULSE, SWEEP, FILTER, RECORD = 0, 1, 2, 3  # kinds
FORCE, GROUND = 0, 1  # targets

# Own slots of each kind.
IS_LOGARITHMIC = OWN
PASSES_VELOCITY, IS_DRAWN = OWN, OWN + 1  # of a filter; drawn: its matrices differ between lanes
# Those of impulses and records are in their modules.

# Rows of each kind; those of noise, impulses and records are in their modules. Behind a sweep's
# cosines stand as many sines: scratch of its series.
SWEEP_AMPLITUDE, START_FREQUENCY, END_FREQUENCY, DURATION, SWEEP_PHASE, COSINES = range(6)

SWEEP_TERMS = 14
"""Terms of a sweep's series; a sample interval spans half a radian: 0.5**14 / 14! is 7e-16."""

STRIDE = 32
"""Lanes looked at together for impulses, which are rare."""

SWEEP_ROWS = COSINES + 2 * SWEEP_TERMS


@borrowing_kernel
def excited(model):
    """Tell whether there is excitation besides harmonics."""
    return model[int(model[at.EXCITATION])] > 0.0


@kernel
def begin_excitation(model, lanes, streams, mask, first, last):
    """Prepare the excitation of new episodes; the jets hold its values at their start.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; jets and the rows of each part are written.
    streams
        (2, lanes) uint64, advanced.
    mask
        (lanes,) bool, read: the lanes whose episodes begin.
    first, last
        The lanes first .. last - 1.
    """
    base, jets, terms = int(model[at.EXCITATION]), int(model[at.JETS]), int(model[at.TERMS])
    for i in range(first, last):
        if not mask[i]:
            continue
        for row in range(jets, jets + 2 * terms):
            lanes[row, i] = 0.0
        for k in range(int(model[base])):
            slot = base + FIRST + SIZE * k
            kind = int(model[slot + KIND])
            if kind == IMPULSE:
                impulses.begin(lanes, int(model[slot + ROW]), streams, i)
            elif kind == SWEEP:
                _begin_sweep(model, slot, lanes, i)
            elif kind == FILTER:
                _begin_noise(model, slot, lanes, streams, i)
            else:
                # Its own start is its jet over no time.
                add_record(model, slot, lanes, 0.0, 0.0, i)
    return at.OK


@borrowing_kernel
def excite(model, lanes, streams, interval, first, last):
    """Write the jets of a sample interval but for the records.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; jets and the rows of each part are written.
    streams
        (2, lanes) uint64, advanced.
    interval
        Index of the sample interval within the control step.
    first, last
        The lanes first .. last - 1, of one block.
    """
    base, jets, terms = int(model[at.EXCITATION]), int(model[at.JETS]), int(model[at.TERMS])
    clock = lanes[at.NOW, first], model[at.INTERVALS], float(interval)
    for row in range(jets, jets + 2 * terms):
        fill(lanes, row, 0.0, first, last)
    for k in range(int(model[base])):
        slot = base + FIRST + SIZE * k
        kind = int(model[slot + KIND])
        if kind == SWEEP:
            _add_sweep(model, slot, lanes, clock, first, last)
        elif kind == FILTER:
            _add_noise(model, slot, lanes, streams, clock, first, last)


@borrowing_kernel
def _row_and_jet(model, slot):
    """Return the first row of a part, and that of the jet to which it adds."""
    terms = int(model[at.TERMS]) if model[slot + TARGET] > 0.0 else 0
    return int(model[slot + ROW]), int(model[at.JETS]) + terms


@borrowing_kernel
def intervals_since(clock, began):
    """Return the number of sample intervals since an episode began."""
    now, intervals_per_step, interval = clock
    return (now - began) * intervals_per_step + interval


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
            if impulses.some_inside(lanes, row, clock, step, start, stop):
                some |= _apply_first(model, slot, lanes, clock, start, stop)
    return some


@borrowing_kernel
def _apply_first(model, slot, lanes, clock, first, last):
    """Do so for the impulses of a part in a few lanes."""
    some, row, step = False, int(model[slot + ROW]) + impulses.NEXT, model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        count = intervals_since(clock, lanes[at.BEGAN, i])
        if lanes[row, i] < impulses.before_end(count, step):
            since = impulses.earliest(count, step)
            while lanes[row, i] < impulses.after_start(count, step):
                v1, v2 = take_impulse(model, slot, lanes, since, i)
                lanes[at.V1, i] += v1
                lanes[at.V2, i] += v2
            some |= lanes[row, i] < impulses.before_end(count, step)
    return some


@borrowing_kernel
def take_impulse(model, slot, lanes, since, i):
    """Return by what the next impulse of a part changes v1 and v2 [m/s]."""
    size = impulses.take(model, slot + OWN, lanes, int(model[slot + ROW]), since, i)
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
            if impulses.some_inside(lanes, row, clock, step, first, last):
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
            time = lanes[int(model[slot + ROW]) + impulses.NEXT, i]
            if time < impulses.before_end(count, step):
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
    start, since = count * step, impulses.earliest(count, step)
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            row = int(model[slot + ROW])
            while lanes[row + impulses.NEXT, i] - start <= elapsed:
                first, second = take_impulse(model, slot, lanes, since, i)
                v1, v2 = v1 + first, v2 + second
    return v1, v2


@borrowing_kernel
def pass_impulses(model, lanes, count):
    """Leave out the impulses of lane 0 until the start of sample interval `count`."""
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            next_row = int(model[slot + ROW]) + impulses.NEXT
            while lanes[next_row, 0] < impulses.after_start(count, model[at.SAMPLE_INTERVAL]):
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


@borrowing_kernel
def _begin_sweep(model, slot, lanes, i):
    """Add the sweep's value at the start to its jet."""
    row, jet = _row_and_jet(model, slot)
    lanes[jet, i] += lanes[row + SWEEP_AMPLITUDE, i] * math.sin(lanes[row + SWEEP_PHASE, i])


@borrowing_kernel
def _add_sweep(model, slot, lanes, clock, first, last):
    """Add amplitude sin(phase(t)) to its jet: s' = c phase', c' = -s phase', term by term.

    Parameters
    ----------
    model
        (m,) float64, read.
    slot
        First slot of the part.
    lanes
        (rows, lanes) float64; the jet and the scratch rows of the part are written.
    clock
        Three numbers, see above.
    first, last
        The lanes first .. last - 1.
    """
    row, jet = _row_and_jet(model, slot)
    logarithmic, step = model[slot + IS_LOGARITHMIC] > 0.0, model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        count = intervals_since(clock, lanes[at.BEGAN, i])
        w0, w1 = lanes[row + START_FREQUENCY, i], lanes[row + END_FREQUENCY, i]
        whole = max(1.0, math.ceil(lanes[row + DURATION, i] / step - 1e-9))  # sample intervals
        length, time = whole * step, min(count, whole) * step
        rest = max(count - whole, 0.0) * step
        growth = math.log(w1 / w0) / length if logarithmic else 0.0
        slope = (w1 - w0) / length
        if logarithmic and growth != 0.0:
            frequency = w0 * math.exp(growth * time)  # (E2)
            phase = (frequency - w0) / growth
        else:
            frequency = w0 + slope * time  # (E1)
            phase = (w0 + 0.5 * slope * time) * time
        phase += lanes[row + SWEEP_PHASE, i] + w1 * rest
        if count >= whole:
            frequency, slope, growth = w1, 0.0, 0.0
        amplitude = lanes[row + SWEEP_AMPLITUDE, i]
        lanes[row + COSINES, i] = math.cos(phase)
        sines = row + COSINES + SWEEP_TERMS
        lanes[sines, i] = math.sin(phase)
        lanes[jet, i] += amplitude * lanes[sines, i]
        for n in range(1, SWEEP_TERMS):
            cosine = sine = 0.0
            part = frequency * step  # k times the k-th term of the phase
            for k in range(1, n + 1):
                cosine -= part * lanes[sines + n - k, i]
                sine += part * lanes[row + COSINES + n - k, i]
                if logarithmic:
                    part *= growth * step / k
                else:
                    part = slope * step * step if k == 1 else 0.0
            lanes[row + COSINES + n, i], lanes[sines + n, i] = cosine / n, sine / n
            lanes[jet + n, i] += amplitude * lanes[sines + n, i]


@borrowing_kernel
def _begin_noise(model, slot, lanes, streams, i):
    """Draw the filter's first state; add the noise's value to its jet."""
    row, jet = _row_and_jet(model, slot)
    if model[slot + IS_DRAWN] > 0.0:
        passes_velocity = model[slot + PASSES_VELOCITY] > 0.0
        prepare_filter(lanes, row, passes_velocity, model[at.SAMPLE_INTERVAL], i)
    start_filter(lanes, row, streams, i)
    lanes[jet, i] += lanes[row + VALUE, i]


@borrowing_kernel
def _add_noise(model, slot, lanes, streams, clock, first, last):
    """Add filtered noise to its jet, linear over the sample interval.

    Parameters
    ----------
    model
        (m,) float64, read.
    slot
        First slot of the part.
    lanes
        (rows, lanes) float64; the jet and the filter's state and value are written.
    streams
        (2, lanes) uint64, advanced.
    clock
        Three numbers, see above.
    first, last
        The lanes first .. last - 1.
    """
    row, jet = _row_and_jet(model, slot)
    step = model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        end = (intervals_since(clock, lanes[at.BEGAN, i]) + 1.0) * step
        before = lanes[row + VALUE, i]
        advance_filter(lanes, row, streams, end, i)
        _add_line(lanes, jet, before, lanes[row + VALUE, i], i)


@borrowing_kernel
def has_corners(model):
    """Tell whether a record may have corners between sample instants."""
    return model[int(model[at.EXCITATION]) + CORNERS] > 0.0


@borrowing_kernel
def part_count(model):
    """Return the number of parts that are not harmonics."""
    return int(model[int(model[at.EXCITATION])])


@borrowing_kernel
def part_slot(model, k):
    """Return the first slot of part k."""
    return int(model[at.EXCITATION]) + FIRST + SIZE * k


@borrowing_kernel
def is_record(model, slot):
    """Tell whether a part is a record."""
    return int(model[slot + KIND]) == RECORD


@borrowing_kernel
def is_impulse(model, slot):
    """Tell whether a part is impulses."""
    return int(model[slot + KIND]) == IMPULSE


@borrowing_kernel
def add_records(model, lanes, clock, first, last):
    """Add the records to the jets of a sample interval of the lanes first .. last - 1."""
    step = model[at.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if not is_record(model, slot):
            continue
        row, jet = _row_and_jet(model, slot)
        if not has_corners(model) and model[slot + OWN + record.SPACING] > 0.0:
            record.add_lines(model, slot + OWN, lanes, row, jet, clock, first, last)
            continue
        for i in range(first, last):
            began = intervals_since(clock, lanes[at.BEGAN, i]) * step
            record.add(model, slot + OWN, lanes, row, jet, began, step, i)


@borrowing_kernel
def add_record(model, slot, lanes, began, duration, i):
    """Add a record to its jet.

    Parameters
    ----------
    model
        (m,) float64, read.
    slot
        First slot of the part.
    lanes
        (rows, lanes) float64; the jet and scratch rows of the part are written.
    began, duration
        Start of what the jet covers since that of the episode, and its length [s].
    i
        The lane.
    """
    row, jet = _row_and_jet(model, slot)
    record.add(model, slot + OWN, lanes, row, jet, began, duration, i)


@borrowing_kernel
def _add_line(lanes, jet, before, after, i):
    """Add to a jet the line from one value to another over the sample interval."""
    lanes[jet, i] += before
    lanes[jet + 1, i] += after - before
