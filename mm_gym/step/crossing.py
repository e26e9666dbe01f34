"""Propagation through sample intervals in which impulses come and records have corners.

An impulse comes at its own time. For linear plants the responses to impulses are added to the
motion without them; the records' polynomials are as good as their corners, see
`mm_gym.excitation.record`. Methods that walk lane by lane stop at each impulse and corner,
and go on from there.

Arguments in common are those of `mm_gym.excitation`; `propagate` is the address of a method's
kernel.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from mm_gym.compiler.addresses import call
from mm_gym.compiler.jit import borrowing_kernel, kernel
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation.impulses import (
    apply_first_impulses,
    has_impulses,
    next_impulse,
    some_impulse,
    take_impulse,
    take_impulses,
)
from mm_gym.excitation.kinds import (
    ROW,
    add_records,
    excited,
    intervals_since,
    is_impulse,
    next_corner,
    part_count,
    part_slot,
    write_jets,
)
from mm_gym.lanes import layout
from mm_gym.lanes.elementary import cosine_and_sine
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.simd_masks import lowest

ROUND_OFF = 2.0**-50
"""Size of the rounding of a time, relative to it: what lies nearer is one instant."""


@cache
def by_superposition(respond):
    """Return a kernel that propagates through the whole sample interval, and adds responses.

    `respond(model, lanes, time, v1, v2, i)` adds to the state of lane i its free motion for a time
    [s] after the velocities v1, v2 [m/s] at rest.
    """

    @borrowing_kernel
    def add_few(model, slot, lanes, clock, start, inside):
        row, step = int(model[slot + ROW]) + process.NEXT, model[layout.SAMPLE_INTERVAL]
        while inside != 0:
            i = start + lowest(inside)
            inside &= inside - 1
            count = intervals_since(clock, lanes[layout.BEGAN, i])
            since = process.earliest(count, step)
            while lanes[row, i] < process.before_end(count, step):
                elapsed = lanes[row, i] - count * step
                v1, v2 = take_impulse(model, slot, lanes, since, i)
                respond(model, lanes, step - elapsed, v1, v2, i)

    @borrowing_kernel
    def add_responses(model, lanes, clock, groups, first, last):
        step = model[layout.SAMPLE_INTERVAL]
        while groups != 0:
            start = first + LANES * lowest(groups)
            groups &= groups - 1
            count = min(LANES, last - start)
            for k in range(part_count(model)):
                slot = part_slot(model, k)
                if is_impulse(model, slot):
                    row = int(model[slot + ROW])
                    inside = process.lanes_inside(lanes, row, clock, step, start, count)
                    add_few(model, slot, lanes, clock, start, inside)

    @borrowing_kernel
    def move(model, lanes, interval, propagate, first, last):
        groups_within = 0
        clock = lanes[layout.NOW, first], model[layout.INTERVALS], float(interval)
        if excited(model):
            if has_impulses(model):
                groups_within = apply_first_impulses(model, lanes, clock, first, last)
            add_records(model, lanes, clock, first, last)
        status = call(propagate, (model, lanes, first, last))
        if groups_within != 0:
            add_responses(model, lanes, clock, groups_within, first, last)
        return status

    return move


@borrowing_kernel
def at_none(model):  # noqa: ARG001 - as `has_corners`
    """Tell that a method stops at no corner, whatever the model."""
    return False


@borrowing_kernel
def unchanged(model, piece):
    """Leave the model of a piece as it is."""


@cache
def by_pieces(at_corners=at_none, shorten=unchanged):
    """Return a kernel that propagates from impulse to impulse, and from corner to corner.

    `propagate` takes any sample interval up to the one that its model was made for; `at_corners
    (model) -> bool` tells whether it stops at the corners of records; `shorten(model, piece)`
    writes what else of a piece's model depends on its length, which is its sample interval.
    """

    @kernel
    def walk(model, lanes, clock, propagate, first, last):
        own = int(model[layout.EXCITATION])
        terms, row = int(model[layout.TERMS]), int(model[layout.JETS])
        harmonics, step = int(model[layout.HARMONIC_COUNT]), model[layout.SAMPLE_INTERVAL]
        piece, others, phases = np.empty(own), np.empty(2 * terms), np.empty((2, harmonics))
        for slot in range(own):
            piece[slot] = model[slot]
        status = layout.OK
        for i in range(first, last):
            count = intervals_since(clock, lanes[layout.BEGAN, i])
            began, elapsed = count * step, 0.0
            close = ROUND_OFF * (began + step)
            for n in range(2 * terms):
                others[n] = lanes[row + n, i]
            _save_phases(lanes, phases, i)
            while elapsed < step:
                impulse = next_impulse(model, lanes, count, i)
                end = impulse
                if at_corners(model):
                    end = min(end, next_corner(model, lanes, began, elapsed, step, i))
                end = max(end, elapsed)
                if end - elapsed > close:
                    piece[layout.SAMPLE_INTERVAL] = end - elapsed
                    shorten(model, piece)
                    write_jets(model, lanes, others, began, elapsed, end - elapsed, i)
                    _turn_phases(lanes, phases, elapsed, i)
                    status = max(status, call(propagate, (piece, lanes, i, i + 1)))
                elapsed = end
                if impulse <= end < step:
                    v1, v2 = take_impulses(model, lanes, count, impulse, i)
                    lanes[layout.V1, i] += v1
                    lanes[layout.V2, i] += v2
            _turn_phases(lanes, phases, 0.0, i)
        return status

    @borrowing_kernel
    def whole(model, lanes, clock, propagate, first, last):
        if excited(model):
            add_records(model, lanes, clock, first, last)
        return call(propagate, (model, lanes, first, last))

    @borrowing_kernel
    def around_impulses(model, lanes, clock, propagate, first, last):
        status, begin, step = layout.OK, first, model[layout.SAMPLE_INTERVAL]
        for start in range(first, last, LANES):
            stop = min(start + LANES, last)
            if not some_impulse(model, lanes, clock, start, stop - start):
                continue
            for i in range(start, stop):
                count = intervals_since(clock, lanes[layout.BEGAN, i])
                if next_impulse(model, lanes, count, i) < step:
                    if begin < i:
                        status = max(status, whole(model, lanes, clock, propagate, begin, i))
                    status = max(status, walk(model, lanes, clock, propagate, i, i + 1))
                    begin = i + 1
        if begin < last:
            status = max(status, whole(model, lanes, clock, propagate, begin, last))
        return status

    @borrowing_kernel
    def move(model, lanes, interval, propagate, first, last):
        clock = lanes[layout.NOW, first], model[layout.INTERVALS], float(interval)
        groups_within = 0
        if excited(model) and has_impulses(model):
            groups_within = apply_first_impulses(model, lanes, clock, first, last)
        if at_corners(model):
            return walk(model, lanes, clock, propagate, first, last)
        if groups_within != 0:
            return around_impulses(model, lanes, clock, propagate, first, last)
        return whole(model, lanes, clock, propagate, first, last)

    return move


@borrowing_kernel
def _save_phases(lanes, phases, i):
    """Copy cosine and sine of every harmonic."""
    for j in range(phases.shape[1]):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        phases[0, j] = lanes[harmonic + layout.COSINE, i]
        phases[1, j] = lanes[harmonic + layout.SINE, i]


@borrowing_kernel
def _turn_phases(lanes, phases, elapsed, i):
    """Write cosine and sine of every harmonic some time after the phases that were saved."""
    for j in range(phases.shape[1]):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        turn = lanes[harmonic + layout.FREQUENCY, i] * elapsed
        c, s = cosine_and_sine(turn)
        lanes[harmonic + layout.COSINE, i] = c * phases[0, j] - s * phases[1, j]
        lanes[harmonic + layout.SINE, i] = s * phases[0, j] + c * phases[1, j]
