"""Excitation other than harmonics: forces on the carriage and accelerations of the ground.

In each sample interval of length h, each part of the excitation adds a polynomial in t / h to a
jet: to that of the force [N], or to that of the ground's acceleration [m/s^2].
`mm_gym.excitation.jets` has what the methods read. Samples of filtered noise are linear in between;
a sweep adds its Taylor series, whose remainder is below round-off; impulses change the velocities,
each at its own time. Impulses and the corners of records may divide a sample interval: see
`mm_gym.step.crossing`.

A kind of excitation is a code, its slots and rows, a branch in `begin_excitation` and one in
`excite`; `mm_gym.plant.excitation.KINDS` has the rest. Tags such as (E1) are equations of
docs/excitation.md.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, kernel
from mm_gym.excitation import impulse_process, noise, record
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import cosine_and_sine
from mm_gym.lanes.extended import (
    exponential_less_one,
    logarithm_of_ratio,
    on_circle,
    over,
    plus,
    times,
)
from mm_gym.lanes.listed import place_of, set_row
from mm_gym.lanes.memory import fill

# Slots of the description, at the end of the model array: the number of parts that are not
# harmonics, whether a record has corners between sample instants, whether there are impulses and
# records, SIZE slots for each part, then the matrices of filters, and the times and values of
# records.
CORNERS, IMPULSES, RECORDS, FIRST, SIZE = 1, 2, 3, 4, 7
KIND, TARGET, ROW, OWN = 0, 1, 2, 3
IMPULSE, SWEEP, FILTER, RECORD = 0, 1, 2, 3  # kinds
FORCE, GROUND = 0, 1  # targets

# Own slots of each kind.
IS_LOGARITHMIC = OWN
# Those of noise, impulses and records are in their modules.

# Rows of each kind; those of noise, impulses and records are in their modules. Behind a sweep's
# cosines stand as many sines: scratch of its series.
SWEEP_AMPLITUDE, START_FREQUENCY, END_FREQUENCY, DURATION, SWEEP_PHASE, COSINES = range(6)

LONGEST_TURN = 0.5
"""Longest sample interval of a sweep, times its highest frequency [rad]; no sweep is shorter."""

SWEEP_TERMS = 14
"""Terms of a sweep's series; a sample interval spans half a radian at most, 0.5**14 / 14! is 7e-16,
and is shorter where the frequency changes fast."""

SWEEP_ROWS = COSINES + 2 * SWEEP_TERMS


@borrowing_kernel
def excited(model):
    """Tell whether there is excitation other than harmonics."""
    return model[int(model[layout.EXCITATION])] > 0.0


@kernel
def begin_excitation(model, lanes, streams, which, first, last):
    """Prepare the excitation of new episodes; the jets hold its values at their start."""
    base = int(model[layout.EXCITATION])
    jets, terms = int(model[layout.JETS]), int(model[layout.TERMS])
    own = which[place_of(first, which) : place_of(last, which)]
    for row in range(jets, jets + 2 * terms):
        set_row(lanes, row, 0.0, own)
    for k in range(int(model[base])):
        slot = base + FIRST + SIZE * k
        kind = int(model[slot + KIND])
        row, jet = _row_and_jet(model, slot)
        if kind == IMPULSE:
            impulse_process.begin(lanes, row, streams, own)
        elif kind == FILTER:
            noise.begin(model, slot + OWN, lanes, row, jet, streams, own)
        else:
            for i in own:
                if kind == SWEEP:
                    sine = cosine_and_sine(lanes[row + SWEEP_PHASE, i])[1]
                    lanes[jet, i] += lanes[row + SWEEP_AMPLITUDE, i] * sine
                else:  # its own start is its jet over no time
                    record.begin(model, slot + OWN, lanes, row, i)
                    add_record(model, slot, lanes, 0.0, 0.0, i)
    return layout.OK


@borrowing_kernel
def excite(model, lanes, streams, interval, first, last):
    """Write the jets of a sample interval but for the records."""
    clock = lanes[layout.NOW, first], model[layout.INTERVALS], float(interval)
    _clear_jets(model, lanes, first, last)
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        kind = int(model[slot + KIND])
        if kind == SWEEP:
            _add_sweep(model, slot, lanes, clock, first, last)
        elif kind == FILTER:
            row, jet = _row_and_jet(model, slot)
            noise.add(model, slot + OWN, lanes, row, jet, streams, clock, first, last)


@borrowing_kernel
def _clear_jets(model, lanes, first, last):
    """Set the jets to which a part adds to zero; the others have been zero since the start."""
    terms = int(model[layout.TERMS])
    for target in range(2):
        is_added_to = False
        for k in range(part_count(model)):
            slot = part_slot(model, k)
            is_added_to |= not is_impulse(model, slot) and int(model[slot + TARGET]) == target
        if is_added_to:
            jet = int(model[layout.JETS]) + terms * target
            for row in range(jet, jet + terms):
                fill(lanes, row, 0.0, first, last)


@borrowing_kernel
def _row_and_jet(model, slot):
    """Return the first row of a part, and that of the jet to which it adds."""
    terms = int(model[layout.TERMS]) if model[slot + TARGET] > 0.0 else 0
    return int(model[slot + ROW]), int(model[layout.JETS]) + terms


@borrowing_kernel
def intervals_since(clock, began):
    """Return the number of sample intervals since an episode began."""
    now, intervals_per_step, interval = clock
    return (now - began) * intervals_per_step + interval


@borrowing_kernel
def _add_sweep(model, slot, lanes, clock, first, last):
    """Add amplitude sin(phase(t)) to its jet: s' = c phase', c' = -s phase', term by term."""
    row, jet = _row_and_jet(model, slot)
    logarithmic, step = model[slot + IS_LOGARITHMIC] > 0.0, model[layout.SAMPLE_INTERVAL]
    for i in range(first, last):
        count = intervals_since(clock, lanes[layout.BEGAN, i])
        angle, turn, bend, growth = _sweep_at(logarithmic, lanes, row, step, count, i)
        amplitude = lanes[row + SWEEP_AMPLITUDE, i]
        sines = row + COSINES + SWEEP_TERMS
        lanes[row + COSINES, i], lanes[sines, i] = on_circle(angle)
        lanes[jet, i] += amplitude * lanes[sines, i]
        for n in range(1, SWEEP_TERMS):
            cosine = sine = 0.0
            part = turn  # k times the k-th term of the phase
            for k in range(1, n + 1):
                cosine -= part * lanes[sines + n - k, i]
                sine += part * lanes[row + COSINES + n - k, i]
                if logarithmic:
                    part *= growth / k
                else:
                    part = bend if k == 1 else 0.0
            lanes[row + COSINES + n, i], lanes[sines + n, i] = cosine / n, sine / n
            lanes[jet + n, i] += amplitude * lanes[sines + n, i]


@borrowing_kernel
def _sweep_at(logarithmic, lanes, row, step, count, i):
    """Return where a sweep is after `count` sample intervals: its phase grows to many radians.

    That is the phase [rad], in twice a double's digits; frequency * step [rad]; and by what that
    grows in a sample interval: by a sum [rad], if not logarithmic, and relatively, if so.
    """
    w0, w1 = lanes[row + START_FREQUENCY, i], lanes[row + END_FREQUENCY, i]
    duration = max(lanes[row + DURATION, i], LONGEST_TURN / max(w0, w1))
    whole = max(1.0, math.ceil(duration / step - 1e-9))  # sample intervals
    made, rest = min(count, whole), max(count - whole, 0.0)
    share = over((made, 0.0), (whole, 0.0))
    if logarithmic and w0 != w1:
        growth = logarithm_of_ratio(w1, w0)
        grown = exponential_less_one(times(growth, share))
        swept = times((w0 * step, fma(w0, step, -(w0 * step))), over(grown, growth))  # (E2)
        swept = times((whole, 0.0), swept)
        turn, bend, relative = w0 * (1.0 + grown[0]) * step, 0.0, growth[0] / whole
    else:
        at_last = times((0.5 * made, 0.0), share)  # intervals at w1, the others at w0: (E1)
        mean = times((w0, 0.0), plus((made, 0.0), (-at_last[0], -at_last[1])))
        swept = times((step, 0.0), plus(mean, times((w1, 0.0), at_last)))
        turn, bend, relative = (w0 + (w1 - w0) * share[0]) * step, (w1 - w0) * step / whole, 0.0
    if rest > 0.0 or made == whole:
        swept = plus(swept, times((w1 * step, fma(w1, step, -(w1 * step))), (rest, 0.0)))
        turn, bend, relative = w1 * step, 0.0, 0.0
    return plus(swept, (lanes[row + SWEEP_PHASE, i], 0.0)), turn, bend, relative


@borrowing_kernel
def has_corners(model):
    """Tell whether a record may have corners between sample instants."""
    return model[int(model[layout.EXCITATION]) + CORNERS] > 0.0


@borrowing_kernel
def part_count(model):
    """Return the number of parts that are not harmonics."""
    return int(model[int(model[layout.EXCITATION])])


@borrowing_kernel
def part_slot(model, k):
    """Return the first slot of part k."""
    return int(model[layout.EXCITATION]) + FIRST + SIZE * k


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
    if not model[int(model[layout.EXCITATION]) + RECORDS] > 0.0:
        return
    step = model[layout.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if not is_record(model, slot):
            continue
        row, jet = _row_and_jet(model, slot)
        if not has_corners(model) and model[slot + OWN + record.IS_EVEN] > 0.0:
            record.add_lines(model, slot + OWN, lanes, row, jet, clock, first, last)
            continue
        for i in range(first, last):
            began = intervals_since(clock, lanes[layout.BEGAN, i]) * step
            record.add(model, slot + OWN, lanes, row, jet, began, step, i)


@borrowing_kernel
def add_record(model, slot, lanes, began, duration, i):
    """Add a record to its jet, which covers a duration [s] from `began` on."""
    row, jet = _row_and_jet(model, slot)
    record.add(model, slot + OWN, lanes, row, jet, began, duration, i)


@borrowing_kernel
def next_corner(model, lanes, began, elapsed, duration, i):
    """Return the first corner of a record after some time of an interval, or the interval's end."""
    end = duration
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_record(model, slot):
            own, row = slot + OWN, int(model[slot + ROW])
            corner = record.next_corner(model, own, lanes, row, began, elapsed, duration, i)
            end = min(end, corner)
    return end


@borrowing_kernel
def write_jets(model, lanes, others, began, elapsed, duration, i):
    """Write the jets over a part of a sample interval, and scratch rows of the records.

    `others`, (2 * terms,) read, are the jets of all parts but the records, over the whole interval.
    """
    terms, row = int(model[layout.TERMS]), int(model[layout.JETS])
    start, ratio = elapsed / model[layout.SAMPLE_INTERVAL], duration / model[layout.SAMPLE_INTERVAL]
    for target in range(2):
        scale = 1.0
        for k in range(terms):
            # The binomial theorem: ((s + r t)^n)_k = C(n, k) s^(n - k) r^k.
            total, weight = 0.0, 1.0
            for n in range(k, terms):
                total += weight * others[target * terms + n]
                weight *= start * (n + 1.0) / (n + 1.0 - k)
            lanes[row + target * terms + k, i] = scale * total
            scale *= ratio
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_record(model, slot):
            add_record(model, slot, lanes, began + elapsed, duration, i)


@borrowing_kernel
def write_rows_of_jets(model, lane, others, times, elapsed, duration, jets):
    """Write the jets (k, 2 * terms) over a part of k sample intervals that began at given times."""
    row = int(model[layout.JETS])
    for k in range(times.shape[0]):
        write_jets(model, lane, others[k], times[k], elapsed, duration, 0)
        for n in range(jets.shape[1]):
            jets[k, n] = lane[row + n, 0]
