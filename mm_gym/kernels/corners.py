"""Propagation through sample intervals in which records have corners.

Records have their samples at any times, so that in an episode their corners may lie anywhere in the
sample intervals. Methods that walk lane by lane stop at each corner, and are exact; for linear
plants the records' polynomials are as good, see `mm_gym.kernels.interpolation`.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels import record
from mm_gym.kernels.excitation import (
    OWN,
    ROW,
    add_record,
    add_records,
    excited,
    has_corners,
    intervals_since,
    is_record,
    part_count,
    part_slot,
)
from mm_gym.kernels.jit import borrowing_kernel, kernel, named_after


def at_once(propagate):
    """Return a kernel that adds the records and propagates through the whole sample interval."""

    @borrowing_kernel
    @named_after(propagate)
    def move(model, lanes, interval, first, last):
        if excited(model):
            add_records(model, lanes, interval, first, last)
        return propagate(model, lanes, first, last)

    return move


def between_corners(propagate):
    """Return a kernel that propagates from corner to corner."""

    @kernel
    @named_after(propagate)
    def by_pieces(model, lanes, interval, first, last):
        own, terms, row = int(model[at.EXCITATION]), int(model[at.TERMS]), int(model[at.JETS])
        harmonics, step = int(model[at.HARMONIC_COUNT]), model[at.SAMPLE_INTERVAL]
        piece, others, phases = np.empty(own), np.empty(2 * terms), np.empty((2, harmonics))
        for slot in range(own):
            piece[slot] = model[slot]
        now, status = lanes[at.NOW, first], at.OK
        for i in range(first, last):
            clock = now, model[at.INTERVALS], float(interval)
            began = intervals_since(clock, lanes[at.BEGAN, i]) * step
            for n in range(2 * terms):
                others[n] = lanes[row + n, i]
            _save_phases(lanes, phases, i)
            elapsed = 0.0
            while elapsed < step:
                end = next_corner(model, lanes, began, elapsed, step, i)
                piece[at.SAMPLE_INTERVAL] = end - elapsed
                write_jets(model, lanes, others, began, elapsed, end - elapsed, i)
                _turn_phases(lanes, phases, elapsed, i)
                status = max(status, propagate(piece, lanes, i, i + 1))
                elapsed = end
            _turn_phases(lanes, phases, 0.0, i)
        return status

    @borrowing_kernel
    @named_after(propagate)
    def move(model, lanes, interval, first, last):
        if has_corners(model):
            return by_pieces(model, lanes, interval, first, last)
        if excited(model):
            add_records(model, lanes, interval, first, last)
        return propagate(model, lanes, first, last)

    return move


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


@borrowing_kernel
def _save_phases(lanes, phases, i):
    """Copy cosine and sine of every harmonic."""
    for j in range(phases.shape[1]):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        phases[0, j], phases[1, j] = lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i]


@borrowing_kernel
def _turn_phases(lanes, phases, elapsed, i):
    """Write cosine and sine of every harmonic some time after the phases that were saved."""
    for j in range(phases.shape[1]):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        turn = lanes[harmonic + at.FREQUENCY, i] * elapsed
        c, s = math.cos(turn), math.sin(turn)
        lanes[harmonic + at.COSINE, i] = c * phases[0, j] - s * phases[1, j]
        lanes[harmonic + at.SINE, i] = s * phases[0, j] + c * phases[1, j]
