"""Beginnings of episodes: what is drawn, completed and shown first.

The lanes are listed. Of sixteen thousand a few hundred, here and there, may begin an episode in
each step: to look for them in a mask, and to call kernels for each run of them, takes longer than
the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.addresses import call
from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation.harmonics import begin_harmonic
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import clip, prefer_widest_vectors
from mm_gym.lanes.listed import copy_within, gather_row, place_of, run_of, scatter_row, set_row
from mm_gym.lanes.memory import span
from mm_gym.lanes.random import COUNT, KEY, next_episode, uniform
from mm_gym.law.dry_friction import REGIMES_READ, REGIMES_WRITTEN, write_regimes
from mm_gym.step.outputs import (
    begin_sensors,
    bias_row_of,
    blur,
    pass_frame,
    rows_of,
    scaling,
    shown,
    write_channels,
)
from mm_gym.step.task import ACTUATORS, IS_RATE, begin_own, finite, task_and_model


@borrowing_kernel
def list_ended(ends, eights, which):
    """List the lanes whose episodes have ended; return how many there are.

    Parameters
    ----------
    ends
        (3, 8 n) bool, read: false behind the lanes.
    eights
        (3, n) uint64, read: the same memory, eight lanes in a number, most of which are zero.
    which
        (8 n,) int64, written: the lanes; behind them, anything.
    """
    # In two passes without branches, which could not be predicted: where some of eight have ended,
    # then which of them. The first one writes to the end of the list, where the second is last.
    count = np.uintp(eights.shape[1])
    places, some, found = which[7 * count :], np.uintp(0), np.uintp(0)
    for k in span(0, count):
        places[some] = k
        some += np.uintp(
            (eights[layout.TERMINATED, k] | eights[layout.TRUNCATED, k]) != np.uint64(0)
        )
    for j in span(0, some):
        k = np.uintp(places[j])
        for i in span(8 * k, 8 * k + 8):
            which[found] = i
            found += np.uintp(ends[layout.TERMINATED, i] | ends[layout.TRUNCATED, i])
    return np.int64(found)


@borrowing_kernel
def start(template, draws, constants, lanes, streams, which, rows, values, first, last):
    """Begin anew in the lanes listed: draw what is random, then set rows to given values.

    A parameter that is neither drawn nor given keeps its value from one episode to the next.

    Parameters
    ----------
    template
        (rows,) read: the scene's start; row X2 holds the sphere's offset.
    draws
        (n, 3) read: (row, low, high) of what is drawn.
    rows, values
        (k,) int64 and (k, count), read: rows that are given, and their values.
    """
    task, model = task_and_model(constants)
    own = which[place_of(first, which) : place_of(last, which)]
    draw(template, draws, lanes, streams, own)
    for k in range(rows.shape[0]):
        for i in own:
            lanes[rows[k], i] = values[k, i]
    complete(model, task, lanes, own)
    return layout.OK


@borrowing_kernel
def draw(template, draws, lanes, streams, which):
    """Fill lanes with the scene's start and draw what is random; of them, only clocks are read."""
    for row in range(layout.DAMPING + 1):
        set_row(lanes, row, template[row], which)
    for k in span(0, which.shape[0]):
        i = which[k]
        next_episode(streams, i)
        lanes[layout.BEGAN, i] = lanes[layout.NOW, i - i % layout.BLOCK]
    for j in range(draws.shape[0]):
        draw_row(lanes, int(draws[j, 0]), draws[j, 1], draws[j, 2], streams, which)


@borrowing_kernel
def draw_row(lanes, row, low, high, streams, which):
    """Draw a row's value in the lanes listed, uniform in [low, high]."""
    prefer_widest_vectors()
    first, last = run_of(which)
    for i in span(first, last):
        lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)
    if last == first:
        for i in which:
            lanes[row, i] = clip(low + (high - low) * uniform(streams, i), low, high)


@borrowing_kernel
def complete(model, task, lanes, which):
    """Complete drawn lanes: positions, damping, regimes, phases, and what rates start from.

    Until here row X2 holds the sphere's offset, because that is what a scene states.
    """
    for k in span(0, which.shape[0]):
        lanes[layout.X2, which[k]] += lanes[layout.X1, which[k]]
    for actuator in ACTUATORS:
        slot, row, asked, _ = actuator
        if task[slot + IS_RATE] > 0.0:
            copy_within(lanes, row, asked, which)
    if model[layout.DAMPED] > 0.0:
        copy_within(lanes, layout.DAMPING, int(model[layout.DAMPED]), which)
    begin_sensors(task, lanes, which)
    begin_own(task, lanes, which)
    first, last = run_of(which)
    if last > first:
        _write_regimes_and_phases(model, lanes, first, last)
    elif which.shape[0] > 0 and (
        lanes[layout.VR, which[0]] != 0.0 or model[layout.HARMONIC_COUNT] > 0.0
    ):
        for i in which:
            _write_regimes_and_phases(model, lanes, i, i + 1)


@borrowing_kernel
def _write_regimes_and_phases(model, lanes, first, last):
    """Write the regimes and the harmonics' phases of the lanes first .. last - 1."""
    write_regimes(lanes, first, last)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        begin_harmonic(lanes, harmonic, model[layout.SAMPLE_INTERVAL], first, last)


@borrowing_kernel
def show_first(constants, kernels, lanes, frames, streams, which, first, last):
    """Fill the history of the lanes listed with their first frame.

    `kernels` are those of a control step, see `mm_gym.step.control_step.Entries.kernels`.
    """
    task, model = task_and_model(constants)
    own = which[place_of(first, which) : place_of(last, which)]
    if task[layout.IS_DERIVED] > 0.0:
        for i in own:
            call(kernels[1], (task, model, lanes, i, i + 1))
    fill_history(task, lanes, frames, streams, own)
    return layout.OK


@borrowing_kernel
def pause(ends, rewards, which):
    """Let the lanes listed, which begin anew in place of a step, earn and end nothing in it."""
    set_row(ends, layout.TERMINATED, False, which)
    set_row(ends, layout.TRUNCATED, False, which)
    for k in span(0, which.shape[0]):
        rewards[which[k]] = 0.0


@borrowing_kernel
def fill_history(task, lanes, frames, streams, which):
    """Fill the history of the lanes listed with their first frame; what is derived is known."""
    channels = int(task[layout.CHANNEL_COUNT])
    newest = frames.shape[0] - channels
    first, last = run_of(which)
    write_channels(task, lanes, frames, newest, first, last)
    for c in range(channels if last == first else 0):
        scale, shift = scaling(task, c)
        row, subtracted_row = rows_of(task, c)
        bias_row = bias_row_of(task, c)
        for k in span(0, which.shape[0]):
            value = lanes[row, which[k]]
            if subtracted_row != layout.NO_ROW:
                value -= lanes[subtracted_row, which[k]]
            if bias_row != layout.NO_ROW:
                value += lanes[bias_row, which[k]]
            frames[newest + c, which[k]] = shown(value, scale, shift)
    if task[layout.IS_NOISY] > 0.0:
        blur(task, lanes, frames, newest, streams, first, last)
        for i in which[: 0 if last > first else which.shape[0]]:
            blur(task, lanes, frames, newest, streams, i, i + 1)
    pass_frame(task, streams, first, last)
    for i in which[: 0 if last > first else which.shape[0]]:
        pass_frame(task, streams, i, i + 1)
    for row in range(newest - 1, -1, -1):
        copy_within(frames, row + channels, row, which)


@borrowing_kernel
def rest(lanes, actions, which, first, last):
    """Let the lanes listed rest at zero, unless an action is not finite; return the status."""
    if not finite(actions):
        return layout.NOT_FINITE
    own = which[place_of(first, which) : place_of(last, which)]
    for row in range(4):
        set_row(lanes, row, 0.0, own)
    return layout.OK


def lists_of_start(
    template: Array, draws: Array, model: Array, task: Array, count: int
) -> NDArray[np.int64]:
    """Return the lists of `restart_gathered`: of rows read and rows written, and 0 .. count - 1.

    The first two are the rows that `start` reads, of those before it, and writes; their lengths
    come first.
    """
    drawn = [int(row) for row in draws[:, 0]]
    read, written = [], [*range(layout.DAMPING + 1), *drawn]
    sensors = int(task[layout.SENSORS_ROW])
    if sensors:
        channels = int(task[layout.CHANNEL_COUNT])
        read += range(sensors, sensors + layout.SENSORS_SIZE + layout.ERRORS_SIZE * channels)
        written += [sensors + layout.DELAY, sensors + layout.AGE]
    for slot, _, asked, slot_own in ACTUATORS:
        own = int(task[slot_own])
        if own:
            read += [own + layout.LAG, own + layout.RATE_LIMIT]
            written += [own + layout.LAG_FACTOR, own + layout.TRAVEL]
        if task[slot + IS_RATE]:
            written.append(asked)
    if model[layout.DAMPED]:
        written.append(int(model[layout.DAMPED]))
    if template[layout.VR] or layout.VR in drawn:
        read += REGIMES_READ
        written += REGIMES_WRITTEN
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        read += [harmonic + layout.FREQUENCY, harmonic + layout.PHASE]
        written += range(harmonic + layout.COSINE, harmonic + layout.ROTATE_SINE + 1)
    read = [row for row in read if row not in drawn]
    written = sorted({*written})
    return np.array([len(read), len(written), *read, *written, *range(count)], np.int64)


@borrowing_kernel
def restart_gathered(template, draws, constants, lanes, streams, frames, lists, which, first, last):
    """Begin anew in lanes that are no neighbours, and fill their history.

    They are gathered, begun anew side by side and put back, which takes the time of loops that are
    vectorised. Not for scenes with sampled excitation, channels that show what follows from the
    state, or fields that follow from a ratio.

    Parameters
    ----------
    template, draws, constants, which, first, last
        As for `start`.
    lanes, streams, frames
        The lanes' rows, and behind them as many for the lanes gathered, of the frames one.
    lists
        Read: see `lists_of_start`.
    """
    task, model = task_and_model(constants)
    begin, end = place_of(first, which), place_of(last, which)
    after_read = 2 + lists[0]
    read, written = lists[2:after_read], lists[after_read : after_read + lists[1]]
    listed, own = which[begin:end], lists[after_read + lists[1] :][begin:end]
    own_lanes, own_streams = lanes[template.shape[0] :], streams[COUNT + 1 :]
    stored = frames.shape[0] - int(task[layout.CHANNEL_COUNT])
    own_frame = frames[stored:]
    gather_row(streams, KEY, own_streams, listed, begin)
    gather_row(streams, COUNT, own_streams, listed, begin)
    for row in read:
        gather_row(lanes, row, own_lanes, listed, begin)
    draw(template, draws, own_lanes, own_streams, own)
    complete(model, task, own_lanes, own)
    fill_history(task, own_lanes, own_frame, own_streams, own)
    scatter_row(own_streams, COUNT, streams, COUNT, listed, begin)
    for row in written:
        scatter_row(own_lanes, row, lanes, row, listed, begin)
    for k in span(0, listed.shape[0]):
        i = np.uintp(listed[k])
        lanes[layout.BEGAN, i] = lanes[layout.NOW, i - i % np.uintp(layout.BLOCK)]
    for row in range(stored):
        scatter_row(own_frame, row % own_frame.shape[0], frames, row, listed, begin)
    return layout.OK
