"""Impulses: their times and sizes in an episode.

Random ones are a Poisson process. Number n of a lane's process is a hash of the lane's key and n,
so that an episode's impulses depend neither on how it is propagated nor on when they are looked at.
Times are since the start of the episode.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read
from mm_gym.lanes.listed import run_of
from mm_gym.lanes.memory import span
from mm_gym.lanes.random import numbered, uniform
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.simd_masks import bits

IS_RANGE, LOWEST, HIGHEST = 0, 1, 2
"""Own slots, of an impulse's size."""

SIZE, RATE, TIME = 0, 1, 2
KEY, COUNT, RANDOM, NEXT = 3, 4, 5, 6
"""Rows of the process: its key, the random impulses so far, when the next of them comes [s], and
when the next impulse of any kind does [s]."""

ROWS = 7

NEVER = 1e300
"""Time of an impulse that does not come; finite, as all that `set_state` accepts."""

CLOSE = 1e-12
"""Part of the time within which an impulse is at the start of a sample interval."""


@borrowing_kernel
def begin(lanes, row, streams, which):
    """Draw the keys of impulses in the lanes listed, and with them when the first ones come."""
    first, last = run_of(which)
    _draw(lanes, row, streams, first, last)
    for i in which[: 0 if last > first else which.shape[0]]:
        _draw(lanes, row, streams, i, i + 1)
    for i in which:
        rate, number = lanes[row + RATE, i], lanes[row + RANDOM, i]
        random = min(_wait(number, rate), NEVER) if rate > 0.0 else NEVER
        lanes[row + RANDOM, i] = random
        lanes[row + NEXT, i] = min(random, lanes[row + TIME, i], NEVER)


@borrowing_kernel
def _draw(lanes, row, streams, first, last):
    """Draw the keys of the lanes first .. last - 1, and into row RANDOM their first numbers."""
    prefer_widest_vectors()
    for i in span(first, last):
        key = uniform(streams, i)
        lanes[row + KEY, i], lanes[row + COUNT, i] = key, 0.0
        lanes[row + RANDOM, i] = numbered(key, 1.0)


@inlined_kernel
def earliest(count, step):
    """Return the time [s] before which no impulse belongs to sample interval `count`.

    It is number `count` of the episode, and lasts `step` [s].
    """
    return step * (count * (1.0 - CLOSE))


@inlined_kernel
def after_start(count, step):
    """Return the time [s] before which an impulse is at the start of sample interval `count`."""
    return step * (count + CLOSE * max(count, 1.0))


@inlined_kernel
def before_end(count, step):
    """Return the time [s] from which on an impulse belongs to a later sample interval."""
    return earliest(count + 1.0, step)


@inlined_kernel
def lanes_inside(lanes, row, clock, step, i, count):
    """Return in which of at most LANES lanes an impulse comes before the interval's end.

    Bit k of the result stands for lane i + k.
    """
    now, intervals_per_step, interval = clock
    if count == 1:  # a lone lane does without what vectors prepare
        passed = (now - lanes[layout.BEGAN, i]) * intervals_per_step + interval
        return bits(lanes[row + NEXT, i] < before_end(passed, step))
    passed = (now - read(lanes, layout.BEGAN, i, count)) * intervals_per_step + interval
    inside = bits(read(lanes, row + NEXT, i, count) < before_end(passed, step))
    return inside & ((1 << count) - 1)


@borrowing_kernel
def groups_inside(lanes, row, clock, step, first, last):
    """Return in which groups of lanes an impulse comes before the sample interval's end.

    Bit k stands for the LANES lanes from first + LANES k on. There are no branches, because which
    groups have one cannot be predicted.
    """
    groups, whole = 0, (last - first) // LANES
    for k in range(whole):
        inside = lanes_inside(lanes, row, clock, step, first + LANES * k, LANES)
        groups |= (1 if inside != 0 else 0) << k
    rest = first + LANES * whole
    if rest < last and lanes_inside(lanes, row, clock, step, rest, last - rest) != 0:
        groups |= 1 << whole
    return groups


@borrowing_kernel
def take(model, own, lanes, row, since, i):
    """Return the size of the next impulse, and look up when the one after it comes.

    There can be none before the time `since` [s]: in a state that was set the process may be far
    behind, and goes on from there.
    """
    now, time, size = lanes[row + NEXT, i], lanes[row + TIME, i], 0.0
    if time == now:
        size += size_of(model, own, lanes, row, 0.0, i)
    if lanes[row + RANDOM, i] <= now:
        lanes[row + COUNT, i] += 1.0
        size += size_of(model, own, lanes, row, 2.0 * lanes[row + COUNT, i], i)
        number = numbered(lanes[row + KEY, i], 2.0 * lanes[row + COUNT, i] + 1.0)
        wait = _wait(number, lanes[row + RATE, i])
        lanes[row + RANDOM, i] = min(max(now, since) + wait, NEVER)
    following = time if time > now else NEVER
    lanes[row + NEXT, i] = min(lanes[row + RANDOM, i], following, NEVER)
    return size


@borrowing_kernel
def _wait(number, rate):
    """Return the time [s] between impulses of a Poisson process, from a number in [0, 1)."""
    stay_apart()  # or a vector library might take the logarithm's place
    return -math.log(1.0 - number) / rate


@inlined_kernel
def size_of(model, own, lanes, row, n, i):
    """Return the size of an impulse [N s] or [m/s]; if it is drawn, from number n."""
    if model[own + IS_RANGE] > 0.0:
        low, high = model[own + LOWEST], model[own + HIGHEST]
        return low + (high - low) * numbered(lanes[row + KEY, i], n)
    return lanes[row + SIZE, i]
