"""Layout of force and ground acceleration besides the harmonics.

In each sample interval every source adds a polynomial in t / h to a jet, that of the force or that of the
ground; the methods propagate jets exactly. Samples (records, filtered noise) are linear in between;
a sweep's Taylor series has as many terms as round-off asks for; an impulse changes the velocities.
"""

from __future__ import annotations

import math

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.memory import span
from mm_gym.kernels.noise import VALUE, advance_filter, prepare_filter, start_filter
from mm_gym.kernels.random import uniform

# Slots of the description: the number of sources, then SIZE slots each, then the records' samples.
FIRST, SIZE = 1, 6
KIND, TARGET, ROW, OWN = 0, 1, 2, 3
IMPULSE, SWEEP, FILTER, RECORD = 0, 1, 2, 3  # kinds
FORCE, GROUND = 0, 1  # targets

# Own slots of each kind.
IS_RANGE, LOWEST, HIGHEST = OWN, OWN + 1, OWN + 2  # of an impulse's size
IS_LOGARITHMIC = OWN
PASSES_VELOCITY, IS_DRAWN = OWN, OWN + 1  # of a filter; drawn: its matrices differ between lanes
DATA, LENGTH, DATA_STEP = OWN, OWN + 1, OWN + 2  # DATA counts from the description's first slot

# Rows of each kind.
IMPULSE_SIZE, RATE, TIME, CHANCE = 0, 1, 2, 3
IMPULSE_ROWS = 4
SWEEP_AMPLITUDE, START_FREQUENCY, END_FREQUENCY, DURATION, SWEEP_PHASE, COSINES = range(6)
SWEEP_ROWS = 5  # and two rows for each term of the jet
RECORD_SCALE, TIME_SCALE, RECORD_START, RECORD_VALUE = 0, 1, 2, 3
RECORD_ROWS = 4


@borrowing_kernel
def excited(model):
    """Tell whether there are sources."""
    return model[int(model[at.EXCITATION])] > 0.0


@borrowing_kernel
def excite(model, lanes, streams, interval, first, last):
    """Write the jets of a sample interval for the lanes first .. last - 1 of a block; apply the impulses."""
    base, jets, terms = int(model[at.EXCITATION]), int(model[at.JETS]), int(model[at.TERMS])
    step, start = model[at.SAMPLE_INTERVAL], float(interval)
    for row in range(jets, jets + 2 * terms):
        for i in range(first, last):
            lanes[row, i] = 0.0
    for k in range(int(model[base])):
        source = base + FIRST + SIZE * k
        kind, row = int(model[source + KIND]), int(model[source + ROW])
        ground = model[source + TARGET] > 0.0
        jet = jets + terms if ground else jets
        for i in range(first, last):
            count = (lanes[at.NOW, first] - lanes[at.BEGAN, i]) * model[at.INTERVALS] + start
            if kind == IMPULSE:
                _apply_impulses(model, source, lanes, row, ground, streams, count, i)
            elif kind == SWEEP:
                logarithmic = model[source + IS_LOGARITHMIC] > 0.0
                _sweep(lanes, row, jet, terms, logarithmic, count, step, i)
            elif kind == FILTER:
                before = lanes[row + VALUE, i]
                advance_filter(lanes, row, streams, (count + 1.0) * step, i)
                lanes[jet, i] += before
                lanes[jet + 1, i] += lanes[row + VALUE, i] - before
            else:
                before = lanes[row + RECORD_VALUE, i]
                value = _record(model, base, source, lanes, row, (count + 1.0) * step, i)
                lanes[row + RECORD_VALUE, i] = value
                lanes[jet, i] += before
                lanes[jet + 1, i] += value - before


@kernel
def begin_excitation(model, lanes, streams, mask, first, last):
    """Prepare the sources of the lanes of the mask; the jets show the values at the start."""
    base, jets, terms = int(model[at.EXCITATION]), int(model[at.JETS]), int(model[at.TERMS])
    step = model[at.SAMPLE_INTERVAL]
    for i in range(first, last):
        if not mask[i]:
            continue
        for row in range(jets, jets + 2 * terms):
            lanes[row, i] = 0.0
        for k in range(int(model[base])):
            source = base + FIRST + SIZE * k
            kind, row = int(model[source + KIND]), int(model[source + ROW])
            jet = jets + terms if model[source + TARGET] > 0.0 else jets
            if kind == IMPULSE:
                lanes[row + CHANCE, i] = -math.expm1(-lanes[row + RATE, i] * step)
            elif kind == SWEEP:
                lanes[jet, i] += lanes[row + SWEEP_AMPLITUDE, i] * math.sin(
                    lanes[row + SWEEP_PHASE, i]
                )
            elif kind == FILTER:
                if model[source + IS_DRAWN] > 0.0:
                    prepare_filter(lanes, row, model[source + PASSES_VELOCITY] > 0.0, step, i)
                start_filter(lanes, row, streams, i)
                lanes[jet, i] += lanes[row + VALUE, i]
            else:
                value = _record(model, base, source, lanes, row, 0.0, i)
                lanes[row + RECORD_VALUE, i] = value
                lanes[jet, i] += value
    return at.OK


@borrowing_kernel
def jet_value(lanes, jet, terms, part, i):
    """Return the value of a jet at a part of the sample interval."""
    total = 0.0
    for n in range(terms - 1, -1, -1):
        total = total * part + lanes[jet + n, i]
    return total


@borrowing_kernel
def add_jets(c, force_row, ground_row, model, lanes, i, elapsed, duration, degree):
    """Add the jets to series of force and ground acceleration over an interval of the sample interval.

    Term k of a series is the k-th derivative times duration**k / k!; the interval begins at
    `elapsed` [s].
    """
    jets, terms = int(model[at.JETS]), int(model[at.TERMS])
    start, ratio = elapsed / model[at.SAMPLE_INTERVAL], duration / model[at.SAMPLE_INTERVAL]
    for target in range(2):
        jet = jets + target * terms
        row = ground_row if target > 0 else force_row
        scale = 1.0
        for k in range(min(terms, degree + 1)):
            # The binomial theorem: ((s + r t)^n)_k = C(n, k) s^(n - k) r^k.
            total, weight = 0.0, 1.0
            for n in range(k, terms):
                total += weight * lanes[jet + n, i]
                weight *= start * (n + 1.0) / (n + 1.0 - k)
            c[row + k] += scale * total
            scale *= ratio


@borrowing_kernel
def _apply_impulses(model, source, lanes, row, ground, streams, count, i):
    """Apply the impulses of a sample interval."""
    step, size = model[at.SAMPLE_INTERVAL], lanes[row + IMPULSE_SIZE, i]
    is_range = model[source + IS_RANGE] > 0.0
    low, high = model[source + LOWEST], model[source + HIGHEST]
    total = 0.0
    # Always as many draws in a sample interval, so that what follows does not depend on this one.
    if 0.0 <= lanes[row + TIME, i] / step + 1e-9 - count < 1.0:
        total += low + (high - low) * uniform(streams, i) if is_range else size
    if lanes[row + RATE, i] > 0.0:
        happens, drawn = uniform(streams, i) < lanes[row + CHANCE, i], uniform(streams, i)
        if happens:
            total += low + (high - low) * drawn if is_range else size
    if ground:
        lanes[at.V1, i] -= total
        lanes[at.V2, i] -= total
    elif total != 0.0:
        lanes[at.V1, i] += total / lanes[at.M1, i]


@borrowing_kernel
def _sweep(lanes, row, jet, terms, logarithmic, count, step, i):
    """Add amplitude sin(phase(t)): s' = c phase', c' = -s phase', term by term."""
    first, final = lanes[row + START_FREQUENCY, i], lanes[row + END_FREQUENCY, i]
    whole = max(1.0, math.ceil(lanes[row + DURATION, i] / step - 1e-9))  # sample intervals
    length, time = whole * step, min(count, whole) * step
    rest = max(count - whole, 0.0) * step
    growth = math.log(final / first) / length if logarithmic else 0.0
    slope = (final - first) / length
    if logarithmic and growth != 0.0:
        frequency = first * math.exp(growth * time)
        phase = (frequency - first) / growth
    else:
        frequency = first + slope * time
        phase = (first + 0.5 * slope * time) * time
    phase += lanes[row + SWEEP_PHASE, i] + final * rest
    if count >= whole:
        frequency, slope, growth = final, 0.0, 0.0
    amplitude = lanes[row + SWEEP_AMPLITUDE, i]
    # Sines stand in the jet's own scratch rows behind the cosines.
    lanes[row + COSINES, i] = math.cos(phase)
    sines = row + COSINES + terms
    lanes[sines, i] = math.sin(phase)
    lanes[jet, i] += amplitude * lanes[sines, i]
    for n in range(1, terms):
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
def _record(model, base, source, lanes, row, time, i):
    """Return the linear interpolant of a record at a time [s] of the episode."""
    data, length = base + int(model[source + DATA]), int(model[source + LENGTH])
    record_time = lanes[row + RECORD_START, i] + time / lanes[row + TIME_SCALE, i]
    place = record_time / model[source + DATA_STEP]
    if not place < length - 1.0:
        return 0.0
    k = int(place)
    part = place - k
    value = (1.0 - part) * model[data + k] + part * model[data + k + 1]
    return lanes[row + RECORD_SCALE, i] * value


@kernel
def write_series(c, width, model, lanes, i, elapsed, duration, degree):
    """Write the series of the carriage's force (row 6) and of the ground's acceleration (row 7).

    Rows are `width` apart; the interval begins at `elapsed` [s] of the sample interval. For each harmonic
    p'' = -w**2 p.
    """
    harmonics, ground = int(model[at.HARMONIC_COUNT]), int(model[at.GROUND])
    if harmonics == 0 and model[at.TERMS] == 0.0:
        return
    for n in range(degree + 1):
        c[6 * width + n] = c[7 * width + n] = 0.0
    add_jets(c, 6 * width, 7 * width, model, lanes, i, elapsed, duration, degree)
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        frequency, scale = lanes[harmonic + at.FREQUENCY, i], lanes[harmonic + at.AMPLITUDE, i]
        cosine, sine = math.cos(frequency * elapsed), math.sin(frequency * elapsed)
        value = scale * (
            lanes[harmonic + at.SINE, i] * cosine + lanes[harmonic + at.COSINE, i] * sine
        )
        slope = scale * (
            lanes[harmonic + at.COSINE, i] * cosine - lanes[harmonic + at.SINE, i] * sine
        )
        turn = frequency * duration
        slope *= turn
        row = 7 * width if (ground >> j) & 1 else 6 * width
        for n in range(degree + 1):
            c[row + n] += value
            value, slope = slope, -value * turn * turn / ((n + 1.0) * (n + 2.0))


@borrowing_kernel
def rotate(model, lanes, first, last):
    """Advance the phase of every harmonic by one sample interval."""
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        for i in span(first, last):
            c, s = lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i]
            rc, rs = lanes[harmonic + at.ROTATE_COSINE, i], lanes[harmonic + at.ROTATE_SINE, i]
            cosine, sine = fma(c, rc, -s * rs), fma(s, rc, c * rs)
            # One Newton step for 1/norm: without it the amplitude would drift by an ulp a step.
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
