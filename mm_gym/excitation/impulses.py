"""The impulses of a sample interval: which lanes have some, when they come, what they change."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation.kinds import (
    IMPULSES,
    OWN,
    ROW,
    TARGET,
    intervals_since,
    is_impulse,
    part_count,
    part_slot,
)
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import prefer_widest_vectors
from mm_gym.lanes.memory import span
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.simd_masks import lowest
from mm_gym.lanes.simd_memory import prefetch


@borrowing_kernel
def apply_first_impulses(model, lanes, clock, first, last):
    """Apply impulses at the start of a sample interval; return in which lanes others come in it.

    Bit k stands for the LANES lanes from first + LANES k on.
    """
    groups, step = 0, model[layout.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if not is_impulse(model, slot):
            continue
        row = int(model[slot + ROW])
        if last - first > 1 and _is_planned(lanes, row, clock, step, first):
            _apply_planned(model, slot, lanes, clock, first, last)
        some = process.groups_inside(lanes, row, clock, step, first, last)
        while some != 0:
            group, some = lowest(some), some & (some - 1)
            start = first + LANES * group
            inside = process.lanes_inside(lanes, row, clock, step, start, min(LANES, last - start))
            if _apply_first(model, slot, lanes, clock, start, inside):
                groups |= 1 << group
    return groups


@inlined_kernel
def _is_planned(lanes, row, clock, step, i):
    """Tell whether an impulse at the interval's start comes at its given time, and alone."""
    count, time = intervals_since(clock, lanes[layout.BEGAN, i]), lanes[row + process.TIME, i]
    is_next = (lanes[row + process.NEXT, i] == time) & (lanes[row + process.RANDOM, i] > time)
    return is_next & (time < process.after_start(count, step))


@borrowing_kernel
def _apply_planned(model, slot, lanes, clock, first, last):
    """Apply such impulses side by side: one at the start of an episode is in all lanes."""
    prefer_widest_vectors()
    row, own, step = int(model[slot + ROW]), slot + OWN, model[layout.SAMPLE_INTERVAL]
    is_ground = model[slot + TARGET] > 0.0
    for i in span(first, last):
        is_planned = _is_planned(lanes, row, clock, step, i)
        size = 0.0 + process.size_of(model, own, lanes, row, 0.0, i)
        on_carriage = -size if is_ground else size / lanes[layout.M1, i]
        on_sphere = -size if is_ground else 0.0
        v1, v2, following = lanes[layout.V1, i], lanes[layout.V2, i], lanes[row + process.NEXT, i]
        random = min(lanes[row + process.RANDOM, i], process.NEVER)
        lanes[layout.V1, i] = v1 + on_carriage if is_planned else v1
        lanes[layout.V2, i] = v2 + on_sphere if is_planned else v2
        lanes[row + process.NEXT, i] = random if is_planned else following


@borrowing_kernel
def _apply_first(model, slot, lanes, clock, start, inside):
    """Apply those of the lanes `inside` from `start` on; tell whether impulses are left."""
    some, row, step = False, int(model[slot + ROW]), model[layout.SAMPLE_INTERVAL]
    while inside != 0:
        i = start + lowest(inside)
        inside &= inside - 1
        count = intervals_since(clock, lanes[layout.BEGAN, i])
        since = process.earliest(count, step)
        while lanes[row + process.NEXT, i] < process.after_start(count, step):
            v1, v2 = take_impulse(model, slot, lanes, since, i)
            lanes[layout.V1, i] += v1
            lanes[layout.V2, i] += v2
        if lanes[row + process.NEXT, i] < process.before_end(count, step):
            _fetch(lanes, row, i)
            some = True
    return some


@inlined_kernel
def _fetch(lanes, row, i):
    """Fetch what `take_impulse` reads in a lane, which would wait for one row after the other."""
    prefetch(lanes, layout.M1, i)
    for own in range(process.ROWS):
        prefetch(lanes, row + own, i)


@borrowing_kernel
def take_impulse(model, slot, lanes, since, i):
    """Return by what the next impulse of a part changes v1 and v2 [m/s]."""
    size = process.take(model, slot + OWN, lanes, int(model[slot + ROW]), since, i)
    if model[slot + TARGET] > 0.0:
        return -size, -size  # (E4)
    return size / lanes[layout.M1, i], 0.0  # (E3)


@borrowing_kernel
def has_impulses(model):
    """Tell whether a part is impulses."""
    return model[int(model[layout.EXCITATION]) + IMPULSES] > 0.0


@borrowing_kernel
def some_impulse(model, lanes, clock, i, count):
    """Tell if in one of the lanes i .. i + count - 1 an impulse comes before the interval's end."""
    step = model[layout.SAMPLE_INTERVAL]
    for k in range(part_count(model)):
        slot = part_slot(model, k)
        if is_impulse(model, slot):
            row = int(model[slot + ROW])
            if process.lanes_inside(lanes, row, clock, step, i, count) != 0:
                return True
    return False


@borrowing_kernel
def next_impulse(model, lanes, count, i):
    """Return when the next impulse comes in sample interval `count`, or the interval's end.

    That is a time since the interval's start [s].
    """
    step = model[layout.SAMPLE_INTERVAL]
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
    """Return by what the impulses until some time of interval `count` change v1 and v2 [m/s]."""
    step, v1, v2 = model[layout.SAMPLE_INTERVAL], 0.0, 0.0
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
            while lanes[next_row, 0] < process.after_start(count, model[layout.SAMPLE_INTERVAL]):
                take_impulse(model, slot, lanes, 0.0, 0)


@borrowing_kernel
def write_impulses(model, lanes, intervals, found):
    """Write the impulses within sample intervals since the start of an episode of one lane.

    They are written as `mm_gym.simulation.recording.Recording.impulses` has them, as far as there
    is room; their number is returned.
    """
    step, k = model[layout.SAMPLE_INTERVAL], 0
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
