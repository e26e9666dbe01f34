"""Beginnings of episodes: what is drawn, completed and shown first.

Lanes are taken in runs that a mask treats alike, so that the compiler vectorises the loops over
them.
"""

from __future__ import annotations

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import clip, prefer_widest_vectors
from mm_gym.kernels.harmonics import begin_harmonic
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.laws import write_regimes
from mm_gym.kernels.memory import copy_row, fill, span
from mm_gym.kernels.outputs import derive, observe
from mm_gym.kernels.random import next_episode, uniform

STRIDE = 64
"""Lanes of a mask looked at together."""


@borrowing_kernel
def run_end(mask, first, last):
    """Return the end of the run of lanes, from the first on, that the mask treats alike."""
    end, kind = first, mask[first]
    while end + STRIDE <= last and is_uniform(mask[end : end + STRIDE], kind):
        end += STRIDE
    while end < last and mask[end] == kind:
        end += 1
    return end


@borrowing_kernel
def is_uniform(mask, kind):
    """Tell whether the mask treats all its lanes alike; without early exit, thus side by side."""
    other = False
    for i in range(mask.shape[0]):
        other |= mask[i] != kind
    return not other


@borrowing_kernel
def start(template, draws, model, task, lanes, streams, mask, rows, values, first, last):
    """Begin anew in the lanes of the mask: draw what is random, then set rows to given values.

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
    mask
        (count,) bool, read.
    rows, values
        (k,) int64 and (k, count), read: rows that are given, and their values.
    first, last
        The lanes first .. last - 1.

    Returns
    -------
    int
        Status.
    """
    while first < last:
        end = run_end(mask, first, last)
        if mask[first]:
            draw(template, draws, lanes, streams, first, end)
            for k in range(rows.shape[0]):
                for i in span(first, end):
                    lanes[rows[k], i] = values[k, i]
            complete(model, task, lanes, first, end)
        first = end
    return at.OK


@borrowing_kernel
def draw(template, draws, lanes, streams, first, last):
    """Fill lanes with the scene's start and draw what is random.

    Parameters
    ----------
    template, draws, streams
        As for `start`.
    lanes
        (rows, count) written, but for the block's clock, read.
    first, last
        The lanes first .. last - 1.
    """
    for i in span(first, last):
        next_episode(streams, i)
    for row in range(at.STRETCH + 1):
        fill(lanes, row, template[row], first, last)
    for block in range(first - first % at.BLOCK, last, at.BLOCK):
        stop = min(block + at.BLOCK, last)
        fill(lanes, at.BEGAN, lanes[at.NOW, block], max(block, first), stop)
    for j in range(draws.shape[0]):
        draw_row(lanes, int(draws[j, 0]), draws[j, 1], draws[j, 2], streams, first, last)


@borrowing_kernel
def draw_row(lanes, row, low, high, streams, first, last):
    """Draw a row's lanes, uniform in [low, high].

    Parameters
    ----------
    lanes
        (rows, count) written in this row.
    row, low, high
        The row, and the range in its unit.
    streams
        (2, count) uint64, read and written: random numbers.
    first, last
        The lanes first .. last - 1.
    """
    prefer_widest_vectors()
    for i in span(first, last):
        lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)


@borrowing_kernel
def complete(model, task, lanes, first, last):
    """Complete drawn lanes: positions, regimes, phases, and what rate commands start from.

    Until here row X2 holds the sphere's offset, because that is what a scene states.
    """
    for i in span(first, last):
        lanes[at.X2, i] += lanes[at.X1, i]
    if task[at.FORCE_IS_RATE] > 0.0:
        copy_row(lanes, at.FORCE, at.FORCE_ASKED, first, last)
    if task[at.STRETCH_IS_RATE] > 0.0:
        copy_row(lanes, at.STRETCH, at.STRETCH_ASKED, first, last)
    write_regimes(lanes, first, last)
    for j in range(int(model[at.HARMONIC_COUNT])):
        begin_harmonic(
            lanes, at.HARMONICS + at.HARMONIC_ROWS * j, model[at.SAMPLE_INTERVAL], first, last
        )


@borrowing_kernel
def show_first(model, task, lanes, frames, ends, streams, mask, paused, rewards, first, last):
    """Fill the history of the lanes of the mask with their first frame.

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
    mask
        (count,) bool, read.
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
    while first < last:
        end = run_end(mask, first, last)
        if mask[first]:
            fill_history(model, task, lanes, frames, streams, first, end)
            if paused:
                for i in span(first, end):
                    rewards[i] = 0.0
                fill(ends, at.TERMINATED, False, first, end)
                fill(ends, at.TRUNCATED, False, first, end)
        first = end
    return at.OK


@borrowing_kernel
def fill_history(model, task, lanes, frames, streams, first, last):
    """Fill the history with the first frame.

    Parameters
    ----------
    model, task, frames, streams
        As for `show_first`.
    lanes
        (rows, count) read; what is derived from the state is written.
    first, last
        The lanes first .. last - 1.
    """
    channels = int(task[at.CHANNEL_COUNT])
    if task[at.IS_DERIVED] > 0.0:
        derive(model, lanes, first, last)
    observe(task, lanes, frames, streams, first, last)
    for row in range(frames.shape[0] - channels - 1, -1, -1):
        copy_row(frames, row + channels, row, first, last)


@borrowing_kernel
def rest(lanes, mask, first, last):
    """Let the lanes of the mask rest at zero."""
    while first < last:
        end = run_end(mask, first, last)
        if mask[first]:
            for row in range(4):
                fill(lanes, row, 0.0, first, end)
        first = end
    return at.OK
