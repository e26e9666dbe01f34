"""Sources of force and ground acceleration besides the harmonic tones.

In each substep every source adds a polynomial in t / h to a jet, that of the force or that of the
ground; the methods propagate jets exactly. Samples (records, filtered noise) are linear in between;
a sweep's Taylor series has as many terms as round-off asks for; a blow changes the velocities.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.random import normals, uniform

# Slots of the description: the number of sources, then SIZE slots each, then the records' samples.
FIRST, SIZE = 1, 6
KIND, TARGET, ROW, OWN = 0, 1, 2, 3
IMPULSE, SWEEP, FILTER, RECORD = 0, 1, 2, 3  # kinds
FORCE, GROUND = 0, 1  # targets

# Own slots of each kind.
IS_RANGE, LOWEST, HIGHEST = OWN, OWN + 1, OWN + 2  # of a blow's size
IS_LOGARITHMIC = OWN
PASSES_VELOCITY, IS_DRAWN = OWN, OWN + 1  # of a filter; drawn: its matrices differ between lanes
DATA, LENGTH, DATA_STEP = OWN, OWN + 1, OWN + 2  # DATA counts from the description's first slot

# Rows of each kind.
BLOW, RATE, TIME, CHANCE = 0, 1, 2, 3
IMPULSE_ROWS = 4
SWEEP_AMPLITUDE, START_FREQUENCY, END_FREQUENCY, DURATION, SWEEP_PHASE, COSINES = range(6)
SWEEP_ROWS = 5  # and two rows for each term of the jet
RMS, LOW_PASS, LOW_PASS_DAMPING, HIGH_PASS, HIGH_PASS_DAMPING, RISE, PLATEAU, DECAY = range(8)
STATE, VALUE, TRANSITION, SPREAD, START_SPREAD, OUTPUT = 8, 12, 13, 29, 39, 49
FILTER_ROWS = 53
RECORD_SCALE, TIME_SCALE, RECORD_START, RECORD_VALUE = 0, 1, 2, 3
RECORD_ROWS = 4

ORDER = 4
"""States of a filter: x, x' of the low-pass, then of the high-pass, in units of the input."""

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4: below round-off."""


@borrowing_kernel
def excited(model):
    """Tell whether there are sources."""
    return model[int(model[at.SOURCES])] > 0.0


@borrowing_kernel
def excite(model, lanes, streams, substep, first, last):
    """Write the jets of a substep for the lanes first .. last - 1 of a block; deal the blows."""
    base, jets, terms = int(model[at.SOURCES]), int(model[at.JETS]), int(model[at.TERMS])
    step, start = model[at.TIME_STEP], float(substep)
    for row in range(jets, jets + 2 * terms):
        for i in range(first, last):
            lanes[row, i] = 0.0
    for k in range(int(model[base])):
        source = base + FIRST + SIZE * k
        kind, row = int(model[source + KIND]), int(model[source + ROW])
        ground = model[source + TARGET] > 0.0
        jet = jets + terms if ground else jets
        for i in range(first, last):
            count = (lanes[at.NOW, first] - lanes[at.BEGAN, i]) * model[at.SUBSTEPS] + start
            if kind == IMPULSE:
                _strike(model, source, lanes, row, ground, streams, count, i)
            elif kind == SWEEP:
                logarithmic = model[source + IS_LOGARITHMIC] > 0.0
                _sweep(lanes, row, jet, terms, logarithmic, count, step, i)
            elif kind == FILTER:
                before = lanes[row + VALUE, i]
                _advance_filter(lanes, row, streams, (count + 1.0) * step, i)
                lanes[jet, i] += before
                lanes[jet + 1, i] += lanes[row + VALUE, i] - before
            else:
                before = lanes[row + RECORD_VALUE, i]
                value = _record(model, base, source, lanes, row, (count + 1.0) * step, i)
                lanes[row + RECORD_VALUE, i] = value
                lanes[jet, i] += before
                lanes[jet + 1, i] += value - before


@kernel
def begin_sources(model, lanes, streams, mask, first, last):
    """Prepare the sources of the lanes of the mask; the jets show the values at the start."""
    base, jets, terms = int(model[at.SOURCES]), int(model[at.JETS]), int(model[at.TERMS])
    step = model[at.TIME_STEP]
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
                _start_filter(lanes, row, streams, i)
                lanes[jet, i] += lanes[row + VALUE, i]
            else:
                value = _record(model, base, source, lanes, row, 0.0, i)
                lanes[row + RECORD_VALUE, i] = value
                lanes[jet, i] += value
    return at.OK


@borrowing_kernel
def jet_value(lanes, jet, terms, part, i):
    """Return the value of a jet at a part of the substep."""
    total = 0.0
    for n in range(terms - 1, -1, -1):
        total = total * part + lanes[jet + n, i]
    return total


@borrowing_kernel
def add_jets(c, force_row, ground_row, model, lanes, i, elapsed, duration, degree):
    """Add the jets to series of force and ground acceleration over an interval of the substep.

    Term k of a series is the k-th derivative times duration**k / k!; the interval begins at
    `elapsed` [s].
    """
    jets, terms = int(model[at.JETS]), int(model[at.TERMS])
    start, ratio = elapsed / model[at.TIME_STEP], duration / model[at.TIME_STEP]
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
def _strike(model, source, lanes, row, ground, streams, count, i):
    """Deal the blows of a substep."""
    step, size = model[at.TIME_STEP], lanes[row + BLOW, i]
    is_range = model[source + IS_RANGE] > 0.0
    low, high = model[source + LOWEST], model[source + HIGHEST]
    total = 0.0
    # Always as many draws in a substep, so that what follows does not depend on this one.
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
    whole = max(1.0, math.ceil(lanes[row + DURATION, i] / step - 1e-9))  # substeps
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


@borrowing_kernel
def _envelope(lanes, row, time, i):
    """Return the envelope of filtered noise at a time [s] of the episode."""
    rise = lanes[row + RISE, i]
    if time < rise:
        return (time / rise) * (time / rise)
    past = time - rise - lanes[row + PLATEAU, i]
    return math.exp(-lanes[row + DECAY, i] * past) if past > 0.0 else 1.0


@borrowing_kernel
def _order(lanes, row, i):
    """Return the number of states in use."""
    return ORDER if lanes[row + HIGH_PASS, i] > 0.0 else ORDER // 2


@borrowing_kernel
def _write_value(lanes, row, order, time, i):
    """Write the noise at a time [s] from the filter's state."""
    total = 0.0
    for k in range(order):
        total += lanes[row + OUTPUT + k, i] * lanes[row + STATE + k, i]
    lanes[row + VALUE, i] = lanes[row + RMS, i] * _envelope(lanes, row, time, i) * total


@borrowing_kernel
def _add_normals(lanes, row, spread, order, streams, i):
    """Add independent normal numbers times a lower triangle, packed by rows, to the state."""
    for column in range(0, order, 2):
        pair = normals(streams, i)
        for side in range(2):
            j = column + side
            for k in range(j, order):
                lanes[row + STATE + k, i] += (
                    lanes[row + spread + k * (k + 1) // 2 + j, i] * pair[side]
                )


@borrowing_kernel
def _start_filter(lanes, row, streams, i):
    """Draw the filter's state from its stationary law."""
    order = _order(lanes, row, i)
    for k in range(ORDER):
        lanes[row + STATE + k, i] = 0.0
    _add_normals(lanes, row, START_SPREAD, order, streams, i)
    _write_value(lanes, row, order, 0.0, i)


@borrowing_kernel
def _advance_filter(lanes, row, streams, time, i):
    """Advance the filter by one substep, exactly in law, to a time [s]."""
    order = _order(lanes, row, i)
    x = (
        lanes[row + STATE, i],
        lanes[row + STATE + 1, i],
        lanes[row + STATE + 2, i],
        lanes[row + STATE + 3, i],
    )
    for k in range(order):
        own = row + TRANSITION + ORDER * k
        lanes[row + STATE + k, i] = (
            lanes[own, i] * x[0]
            + lanes[own + 1, i] * x[1]
            + lanes[own + 2, i] * x[2]
            + lanes[own + 3, i] * x[3]
        )
    _add_normals(lanes, row, SPREAD, order, streams, i)
    _write_value(lanes, row, order, time, i)


@kernel
def prepare_filter(lanes, row, passes_velocity, step, i):
    """Write transition, spread and output of a filter driven by white noise, output of variance 1.

    Low-pass x'' / w^2 + 2 z x' / w + x = noise, passed on as x, or for soil as x + 2 z x' / w
    (Kanai and Tajimi); then, if its frequency is not 0, the high-pass y'' of
    y'' / w^2 + 2 z y' / w + y = input. The covariances follow by doubling,
    Q(2 h) = Q(h) + F Q(h) F', from a Taylor series at a short h; for ever, it is the solution of
    Lyapunov's equation.
    """
    f, out = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    w, damping = lanes[row + LOW_PASS, i], 2.0 * lanes[row + LOW_PASS_DAMPING, i]
    f[0, 1], f[1, 0], f[1, 1] = w, -w, -damping * w
    out[0], out[1] = 1.0, damping if passes_velocity else 0.0
    high, high_damping = lanes[row + HIGH_PASS, i], 2.0 * lanes[row + HIGH_PASS_DAMPING, i]
    if high > 0.0:
        f[2, 3] = high
        f[3, 0], f[3, 1], f[3, 2], f[3, 3] = (
            high * out[0],
            high * out[1],
            -high,
            -high * high_damping,
        )
        out[2], out[3] = -1.0, -high_damping
    rate = w * (1.0 + damping) + high * (2.0 + damping + high_damping)
    halvings = max(0, math.ceil(math.log2(rate * step * 16.0)))
    transition, covariance = _short_step(f, w, step * 0.5**halvings)
    for _ in range(halvings):
        transition, covariance = _doubled(transition, covariance)
    for k in range(ORDER):
        for j in range(ORDER):
            lanes[row + TRANSITION + ORDER * k + j, i] = transition[k, j]
    _write_root(covariance, lanes, row + SPREAD, i)
    for _ in range(80):  # until the first state is forgotten, whatever the damping
        transition, covariance = _doubled(transition, covariance)
    _write_root(covariance, lanes, row + START_SPREAD, i)
    variance = 0.0
    for k in range(ORDER):
        for j in range(ORDER):
            variance += out[k] * covariance[k, j] * out[j]
    for k in range(ORDER):
        lanes[row + OUTPUT + k, i] = out[k] / math.sqrt(variance)


@kernel
def _short_step(f, w, step):
    """Return exp(f h) and the covariance of the state after a short h, by their Taylor series."""
    transition, term = np.eye(ORDER), np.eye(ORDER)
    covariance, form = np.zeros((ORDER, ORDER)), np.zeros((ORDER, ORDER))
    form[1, 1] = covariance[1, 1] = w * step
    for n in range(2, SERIES + 2):
        term = _product(f, term) * (step / (n - 1.0))
        transition = transition + term
        half = _product(f, form)
        form = (half + half.T) * (step / n)
        covariance = covariance + form
    return transition, covariance


@kernel
def _doubled(transition, covariance):
    """Return transition and covariance over twice the time."""
    spread = _product(_product(transition, covariance), transition.T)
    return _product(transition, transition), covariance + spread


@kernel
def _product(a, b):
    """Return a b; a library's product would round differently from one machine to the next."""
    out = np.zeros((ORDER, ORDER))
    for i in range(ORDER):
        for j in range(ORDER):
            for k in range(ORDER):
                out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def _write_root(covariance, lanes, row, i):
    """Write the Cholesky factor, packed by rows; what round-off leaves of a zero pivot is zero."""
    root = np.zeros((ORDER, ORDER))
    for k in range(ORDER):
        for j in range(k + 1):
            rest = covariance[k, j]
            for m in range(j):
                rest -= root[k, m] * root[j, m]
            if j == k:
                root[k, k] = math.sqrt(rest) if rest > 1e-15 * covariance[k, k] else 0.0
            else:
                root[k, j] = rest / root[j, j] if root[j, j] > 0.0 else 0.0
            lanes[row + k * (k + 1) // 2 + j, i] = root[k, j]
