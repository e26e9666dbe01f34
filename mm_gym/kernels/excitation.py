"""Excitation: forces on the carriage and accelerations of the ground.

A harmonic turns by its exact rotation in each sample interval. Every other part of the excitation
adds a polynomial in t / h to a jet in each sample interval of length h: to that of the force [N],
or to that of the ground's acceleration [m/s^2]. `mm_gym.kernels.jets` has what the methods read.
Samples (records, filtered noise) are linear in between; a sweep adds its Taylor series, whose
remainder is below round-off; impulses change the velocities.

A kind of excitation is a code, its slots and rows, a branch in `begin_excitation` and one in
`excite`; `mm_gym.plant.excitation.KINDS` has the rest. Tags such as (E1) are equations of
docs/excitation.md.

The kernels of a kind work on lane i. Their `slot` is the first one of a part in the description,
and their `count` the number of sample intervals since the episode began.
"""

from __future__ import annotations

import math

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.memory import span
from mm_gym.kernels.noise import VALUE, advance_filter, prepare_filter, start_filter
from mm_gym.kernels.random import uniform

# Slots of the description, at the end of the model array: the number of parts that are not
# harmonics, SIZE slots for each of them, then the samples of the records.
FIRST, SIZE = 1, 6
KIND, TARGET, ROW, OWN = 0, 1, 2, 3
IMPULSE, SWEEP, FILTER, RECORD = 0, 1, 2, 3  # kinds
FORCE, GROUND = 0, 1  # targets

# Own slots of each kind.
IS_RANGE, LOWEST, HIGHEST = OWN, OWN + 1, OWN + 2  # of an impulse's size
IS_LOGARITHMIC = OWN
PASSES_VELOCITY, IS_DRAWN = OWN, OWN + 1  # of a filter; drawn: its matrices differ between lanes
DATA, LENGTH, DATA_STEP = OWN, OWN + 1, OWN + 2  # of a record; DATA is a slot of the description

# Rows of each kind; those of filtered noise are in `mm_gym.kernels.noise`. Behind a sweep's cosines
# stand as many sines: scratch of its series.
IMPULSE_SIZE, RATE, TIME, CHANCE = 0, 1, 2, 3
IMPULSE_ROWS = 4
SWEEP_AMPLITUDE, START_FREQUENCY, END_FREQUENCY, DURATION, SWEEP_PHASE, COSINES = range(6)
RECORD_SCALE, TIME_SCALE, RECORD_START, RECORD_VALUE = 0, 1, 2, 3
RECORD_ROWS = 4

SWEEP_TERMS = 14
"""Terms of a sweep's series; a sample interval spans half a radian: 0.5**14 / 14! is 7e-16."""

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
                _begin_impulses(model, slot, lanes, i)
            elif kind == SWEEP:
                _begin_sweep(model, slot, lanes, i)
            elif kind == FILTER:
                _begin_noise(model, slot, lanes, streams, i)
            else:
                _begin_record(model, slot, lanes, i)
    return at.OK


@borrowing_kernel
def excite(model, lanes, streams, interval, first, last):
    """Write the jets of a sample interval and apply its impulses.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; velocities, jets and the rows of each part are written.
    streams
        (2, lanes) uint64, advanced.
    interval
        Index of the sample interval within the control step.
    first, last
        The lanes first .. last - 1, of one block.
    """
    base, jets, terms = int(model[at.EXCITATION]), int(model[at.JETS]), int(model[at.TERMS])
    start = float(interval)
    for row in range(jets, jets + 2 * terms):
        for i in range(first, last):
            lanes[row, i] = 0.0
    for k in range(int(model[base])):
        slot = base + FIRST + SIZE * k
        kind = int(model[slot + KIND])
        for i in range(first, last):
            count = (lanes[at.NOW, first] - lanes[at.BEGAN, i]) * model[at.INTERVALS] + start
            if kind == IMPULSE:
                _apply_impulses(model, slot, lanes, streams, count, i)
            elif kind == SWEEP:
                _add_sweep(model, slot, lanes, count, i)
            elif kind == FILTER:
                _add_noise(model, slot, lanes, streams, count, i)
            else:
                _add_record(model, slot, lanes, count, i)


@borrowing_kernel
def _row_and_jet(model, slot):
    """Return the first row of a part, and that of the jet to which it adds."""
    terms = int(model[at.TERMS]) if model[slot + TARGET] > 0.0 else 0
    return int(model[slot + ROW]), int(model[at.JETS]) + terms


@borrowing_kernel
def _begin_impulses(model, slot, lanes, i):
    """Write the probability that a sample interval has a random impulse."""
    row = int(model[slot + ROW])
    lanes[row + CHANCE, i] = -math.expm1(-lanes[row + RATE, i] * model[at.SAMPLE_INTERVAL])


@borrowing_kernel
def _apply_impulses(model, slot, lanes, streams, count, i):
    """Apply the impulses of a sample interval.

    Parameters
    ----------
    model
        (m,) float64, read.
    slot
        First slot of the part.
    lanes
        (rows, lanes) float64; the velocities are written.
    streams
        (2, lanes) uint64, advanced.
    count
        Sample intervals since the episode began.
    i
        The lane.
    """
    row, step = int(model[slot + ROW]), model[at.SAMPLE_INTERVAL]
    size, is_range = lanes[row + IMPULSE_SIZE, i], model[slot + IS_RANGE] > 0.0
    low, high = model[slot + LOWEST], model[slot + HIGHEST]
    total = 0.0
    # Both numbers are drawn in every sample interval, so that those of later ones do not depend on
    # whether this one has an impulse.
    if 0.0 <= lanes[row + TIME, i] / step + 1e-9 - count < 1.0:
        total += low + (high - low) * uniform(streams, i) if is_range else size
    if lanes[row + RATE, i] > 0.0:
        happens, drawn = uniform(streams, i) < lanes[row + CHANCE, i], uniform(streams, i)
        if happens:
            total += low + (high - low) * drawn if is_range else size
    if model[slot + TARGET] > 0.0:
        lanes[at.V1, i] -= total  # (E4)
        lanes[at.V2, i] -= total
    elif total != 0.0:
        lanes[at.V1, i] += total / lanes[at.M1, i]  # (E3)


@borrowing_kernel
def _begin_sweep(model, slot, lanes, i):
    """Add the sweep's value at the start to its jet."""
    row, jet = _row_and_jet(model, slot)
    lanes[jet, i] += lanes[row + SWEEP_AMPLITUDE, i] * math.sin(lanes[row + SWEEP_PHASE, i])


@borrowing_kernel
def _add_sweep(model, slot, lanes, count, i):
    """Add amplitude sin(phase(t)) to its jet: s' = c phase', c' = -s phase', term by term."""
    row, jet = _row_and_jet(model, slot)
    logarithmic, step = model[slot + IS_LOGARITHMIC] > 0.0, model[at.SAMPLE_INTERVAL]
    first, final = lanes[row + START_FREQUENCY, i], lanes[row + END_FREQUENCY, i]
    whole = max(1.0, math.ceil(lanes[row + DURATION, i] / step - 1e-9))  # sample intervals
    length, time = whole * step, min(count, whole) * step
    rest = max(count - whole, 0.0) * step
    growth = math.log(final / first) / length if logarithmic else 0.0
    slope = (final - first) / length
    if logarithmic and growth != 0.0:
        frequency = first * math.exp(growth * time)  # (E2)
        phase = (frequency - first) / growth
    else:
        frequency = first + slope * time  # (E1)
        phase = (first + 0.5 * slope * time) * time
    phase += lanes[row + SWEEP_PHASE, i] + final * rest
    if count >= whole:
        frequency, slope, growth = final, 0.0, 0.0
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
def _add_noise(model, slot, lanes, streams, count, i):
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
    count
        Sample intervals since the episode began.
    i
        The lane.
    """
    row, jet = _row_and_jet(model, slot)
    before = lanes[row + VALUE, i]
    advance_filter(lanes, row, streams, (count + 1.0) * model[at.SAMPLE_INTERVAL], i)
    _add_line(lanes, jet, before, lanes[row + VALUE, i], i)


@borrowing_kernel
def _begin_record(model, slot, lanes, i):
    """Add the record's value at the start to its jet."""
    row, jet = _row_and_jet(model, slot)
    value = _recorded(model, slot, lanes, 0.0, i)
    lanes[row + RECORD_VALUE, i] = value
    lanes[jet, i] += value


@borrowing_kernel
def _add_record(model, slot, lanes, count, i):
    """Add a record to its jet, linear over the sample interval."""
    row, jet = _row_and_jet(model, slot)
    before = lanes[row + RECORD_VALUE, i]
    value = _recorded(model, slot, lanes, (count + 1.0) * model[at.SAMPLE_INTERVAL], i)
    lanes[row + RECORD_VALUE, i] = value
    _add_line(lanes, jet, before, value, i)


@borrowing_kernel
def _recorded(model, slot, lanes, time, i):
    """Return a record at a time [s] of the episode, linear between its samples; 0 after its end."""
    row, length = int(model[slot + ROW]), int(model[slot + LENGTH])
    data = int(model[at.EXCITATION]) + int(model[slot + DATA])
    record_time = lanes[row + RECORD_START, i] + time / lanes[row + TIME_SCALE, i]
    place = record_time / model[slot + DATA_STEP]
    if not place < length - 1.0:
        return 0.0
    k = int(place)
    part = place - k
    value = (1.0 - part) * model[data + k] + part * model[data + k + 1]
    return lanes[row + RECORD_SCALE, i] * value


@borrowing_kernel
def _add_line(lanes, jet, before, after, i):
    """Add to a jet the line from one value to another over the sample interval."""
    lanes[jet, i] += before
    lanes[jet + 1, i] += after - before


@borrowing_kernel
def rotate(model, lanes, first, last):
    """Turn every harmonic by one sample interval."""
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        for i in span(first, last):
            c, s = lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i]
            rc, rs = lanes[harmonic + at.ROTATE_COSINE, i], lanes[harmonic + at.ROTATE_SINE, i]
            cosine, sine = fma(c, rc, -s * rs), fma(s, rc, c * rs)
            # One Newton step towards length 1, or round-off would add up in the amplitude.
            norm = fma(-0.5, fma(cosine, cosine, sine * sine), 1.5)
            lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i] = (
                cosine * norm,
                sine * norm,
            )


@borrowing_kernel
def begin_harmonic(lanes, harmonic, time_step, first, last):
    """Write cosine and sine of a harmonic's phase, and of its turn in one sample interval."""
    for i in span(first, last):
        phase, turn = lanes[harmonic + at.PHASE, i], lanes[harmonic + at.FREQUENCY, i] * time_step
        lanes[harmonic + at.COSINE, i] = math.cos(phase)
        lanes[harmonic + at.SINE, i] = math.sin(phase)
        lanes[harmonic + at.ROTATE_COSINE, i] = math.cos(turn)
        lanes[harmonic + at.ROTATE_SINE, i] = math.sin(turn)
