"""The corners of records within sample intervals, and the jets over a part of an interval.

Records have their samples at any times, so that in an episode their corners may lie anywhere in the
sample intervals.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation import record
from mm_gym.excitation.kinds import OWN, ROW, add_record, is_record, part_count, part_slot
from mm_gym.lanes import layout as at


@borrowing_kernel
def next_corner(model, lanes, began, elapsed, duration, i):
    """Return the first corner of a record after some time of an interval, or the interval's end.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64, read.
    began
        Start of the sample interval since that of the episode [s].
    elapsed, duration
        Times since the start of the sample interval [s].
    i
        The lane.
    """
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
    """Write the jets over a part of a sample interval.

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; the jets are written, and scratch rows of the records.
    others
        (2 * terms,) float64, read: the jets of all parts but the records, over the whole sample
        interval.
    began
        Start of the sample interval since that of the episode [s].
    elapsed, duration
        Start of the part since that of the sample interval, and its length [s].
    i
        The lane.
    """
    terms, row = int(model[at.TERMS]), int(model[at.JETS])
    start, ratio = elapsed / model[at.SAMPLE_INTERVAL], duration / model[at.SAMPLE_INTERVAL]
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
    row = int(model[at.JETS])
    for k in range(times.shape[0]):
        write_jets(model, lane, others[k], times[k], elapsed, duration, 0)
        for n in range(jets.shape[1]):
            jets[k, n] = lane[row + n, 0]
