"""Beginnings of episodes: what is drawn, completed and shown first.

The lanes are listed. Of sixteen thousand a few hundred may begin an episode in each step: to look
for them in a mask, and to call kernels for each run of them, takes longer than the step. If they
are one run, as in a reset of all, the compiler vectorises the loops over them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import clip, prefer_widest_vectors
from mm_gym.kernels.harmonics import begin_harmonic
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.laws import write_regimes
from mm_gym.kernels.memory import copy_row, fill, span
from mm_gym.kernels.outputs import blur, derive, rows_of, scaling, shown, write_channels
from mm_gym.kernels.random import next_episode, uniform
from mm_gym.kernels.task import finite


@borrowing_kernel
def list_ended(ends, eights, which):
    """List the lanes whose episodes have ended; return how many there are.

    Parameters
    ----------
    ends
        (3, 8 n) bool, read: how the last control step ended, false behind the lanes.
    eights
        (3, n) uint64, read: the same memory, eight lanes in a number, most of which are zero.
    which
        (8 n,) int64, written: the lanes, in ascending order; behind them, anything.
    """
    found = np.uintp(0)
    for k in span(0, eights.shape[1]):
        if eights[at.TERMINATED, k] | eights[at.TRUNCATED, k]:
            for i in span(8 * k, 8 * k + 8):
                which[found] = i  # without a branch, which could not be predicted
                found += np.uintp(ends[at.TERMINATED, i] | ends[at.TRUNCATED, i])
    return np.int64(found)


@borrowing_kernel
def place_of(lane, which):
    """Return the place in a list of lanes, in ascending order, of the first one from `lane` on."""
    low, high = 0, which.shape[0]
    while low < high:
        middle = (low + high) // 2
        if which[middle] < lane:
            low = middle + 1
        else:
            high = middle
    return low


@borrowing_kernel
def run_of(which):
    """Return the first lane listed and the end of the run that the list is; the same if none."""
    count = which.shape[0]
    if count == 0 or which[count - 1] - which[0] != count - 1:
        return 0, 0
    return which[0], which[0] + count


@borrowing_kernel
def set_row(rows, row, value, which):
    """Set a row to a value in the lanes listed."""
    first, last = run_of(which)
    fill(rows, row, value, first, last)
    if last == first:
        for k in span(0, which.shape[0]):
            rows[row, which[k]] = value


@borrowing_kernel
def copy_within(rows, source, target, which):
    """Copy a row to another one in the lanes listed."""
    first, last = run_of(which)
    copy_row(rows, source, target, first, last)
    if last == first:
        for k in span(0, which.shape[0]):
            rows[target, which[k]] = rows[source, which[k]]


@borrowing_kernel
def start(template, draws, model, task, lanes, streams, which, rows, values, first, last):
    """Begin anew in the lanes listed: draw what is random, then set rows to given values.

    A parameter that is neither drawn nor given keeps its value from one episode to the next.

    Parameters
    ----------
    template
        (rows,) read: the scene's start; row X2 holds the sphere's offset.
    draws
        (n, 3) read: (row, low, high) of what is drawn.
    model, task
        (m,) and (t,), read.
    lanes
        (rows, count) read and written.
    streams
        (2, count) uint64, read and written: random numbers.
    which
        (b,) int64, read: the lanes, in ascending order.
    rows, values
        (k,) int64 and (k, count), read: rows that are given, and their values.
    first, last
        The lanes first .. last - 1.

    Returns
    -------
    int
        Status.
    """
    own = which[place_of(first, which) : place_of(last, which)]
    draw(template, draws, lanes, streams, own)
    for k in range(rows.shape[0]):
        for i in own:
            lanes[rows[k], i] = values[k, i]
    complete(model, task, lanes, own)
    return at.OK


@borrowing_kernel
def draw(template, draws, lanes, streams, which):
    """Fill lanes with the scene's start and draw what is random.

    Parameters
    ----------
    template, draws, streams
        As for `start`.
    lanes
        (rows, count) written, but for the blocks' clocks, read.
    which
        (b,) int64, read: the lanes.
    """
    for row in range(at.STRETCH + 1):
        set_row(lanes, row, template[row], which)
    for k in span(0, which.shape[0]):
        i = which[k]
        next_episode(streams, i)
        lanes[at.BEGAN, i] = lanes[at.NOW, i - i % at.BLOCK]
    for j in range(draws.shape[0]):
        draw_row(lanes, int(draws[j, 0]), draws[j, 1], draws[j, 2], streams, which)


@borrowing_kernel
def draw_row(lanes, row, low, high, streams, which):
    """Draw a row's value in the lanes listed, uniform in [low, high].

    Parameters
    ----------
    lanes
        (rows, count) written in this row.
    row, low, high
        The row, and the range in its unit.
    streams
        (2, count) uint64, read and written: random numbers.
    which
        (b,) int64, read: the lanes.
    """
    prefer_widest_vectors()
    first, last = run_of(which)
    for i in span(first, last):
        lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)
    if last == first:
        for i in which:
            lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)


@borrowing_kernel
def complete(model, task, lanes, which):
    """Complete drawn lanes: positions, regimes, phases, and what rate commands start from.

    Until here row X2 holds the sphere's offset, because that is what a scene states.
    """
    for k in span(0, which.shape[0]):
        lanes[at.X2, which[k]] += lanes[at.X1, which[k]]
    if task[at.FORCE_IS_RATE] > 0.0:
        copy_within(lanes, at.FORCE, at.FORCE_ASKED, which)
    if task[at.STRETCH_IS_RATE] > 0.0:
        copy_within(lanes, at.STRETCH, at.STRETCH_ASKED, which)
    for k in span(0, which.shape[0]):
        i = which[k]
        write_regimes(lanes, i, i + 1)
        for j in range(int(model[at.HARMONIC_COUNT])):
            harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
            begin_harmonic(lanes, harmonic, model[at.SAMPLE_INTERVAL], i, i + 1)


@borrowing_kernel
def show_first(model, task, lanes, frames, ends, streams, which, paused, rewards, first, last):
    """Fill the history of the lanes listed with their first frame.

    Parameters
    ----------
    model, task
        (m,) and (t,), read.
    lanes
        (rows, count) read; what is derived from the state is written.
    frames
        (history, count) float32, written, the newest frame last.
    ends
        (3, count) bool, written for paused lanes.
    streams
        (2, count) uint64, read and written: the sensors' noise.
    which
        (b,) int64, read: the lanes, in ascending order.
    paused
        Whether the lanes begin anew instead of making a control step: they then earn nothing in it,
        and end nothing.
    rewards
        (count,) float64, written for paused lanes.
    first, last
        The lanes first .. last - 1.

    Returns
    -------
    int
        Status.
    """
    own = which[place_of(first, which) : place_of(last, which)]
    if task[at.IS_DERIVED] > 0.0:
        for i in own:
            derive(task, model, lanes, i, i + 1)
    fill_history(task, lanes, frames, streams, own)
    if paused:
        set_row(ends, at.TERMINATED, False, own)
        set_row(ends, at.TRUNCATED, False, own)
        for k in span(0, own.shape[0]):
            rewards[own[k]] = 0.0
    return at.OK


@borrowing_kernel
def fill_history(task, lanes, frames, streams, which):
    """Fill the history of the lanes listed with their first frame; arguments as of `show_first`."""
    channels = int(task[at.CHANNEL_COUNT])
    newest = frames.shape[0] - channels
    first, last = run_of(which)
    write_channels(task, lanes, frames, newest, first, last)
    for c in range(channels if last == first else 0):
        scale, shift = scaling(task, c)
        row, subtracted_row = rows_of(task, c)
        for k in span(0, which.shape[0]):
            value = lanes[row, which[k]]
            if subtracted_row != at.NO_ROW:
                value -= lanes[subtracted_row, which[k]]
            frames[newest + c, which[k]] = shown(value, scale, shift)
    if task[at.IS_NOISY] > 0.0:
        for i in which:
            blur(task, frames, newest, streams, i, i + 1)
    for row in range(newest - 1, -1, -1):
        copy_within(frames, row + channels, row, which)


@borrowing_kernel
def rest(lanes, actions, which, first, last):
    """Let the lanes listed rest at zero, unless an action is not finite; return the status."""
    if not finite(actions):
        return at.NOT_FINITE
    own = which[place_of(first, which) : place_of(last, which)]
    for row in range(4):
        set_row(lanes, row, 0.0, own)
    return at.OK
