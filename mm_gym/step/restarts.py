"""Restarts of many lanes that are no neighbours: gathered, begun anew side by side, put back.

The loops over lanes side by side are vectorised, those over a list of lanes are not. Of sixteen
thousand lanes a few hundred, here and there, may begin an episode in each step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.listed import gather_row, place_of, scatter_row
from mm_gym.lanes.memory import span
from mm_gym.lanes.random import COUNT, KEY
from mm_gym.law.dry_friction import REGIMES_READ, REGIMES_WRITTEN
from mm_gym.step.episodes import complete, draw, fill_history
from mm_gym.step.task import task_and_model

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Values = NDArray[np.float64]
    Rows = NDArray[np.int64]


def rows_of_start(
    template: Values, draws: Values, model: Values, task: Values
) -> tuple[Rows, Rows]:
    """Return the rows that the start of an episode reads, of those before it, and writes.

    Arguments are those of `episodes.start`, whose kernels say which rows these are.
    """
    drawn = [int(row) for row in draws[:, 0]]
    read, written = [], [*range(at.DAMPING + 1), *drawn]
    sensors = int(task[at.SENSORS_ROW])
    if sensors:
        channels = int(task[at.CHANNEL_COUNT])
        read += range(sensors, sensors + at.SENSORS_SIZE + at.ERRORS_SIZE * channels)
        written += [sensors + at.DELAY, sensors + at.AGE]
    for own in (int(task[slot]) for slot in (at.FORCE_ROW, at.STRETCH_ROW, at.DAMPING_ROW)):
        if own:
            read += [own + at.LAG, own + at.RATE_LIMIT]
            written += [own + at.LAG_FACTOR, own + at.TRAVEL]
    if task[at.FORCE_IS_RATE]:
        written.append(at.FORCE_ASKED)
    if task[at.STRETCH_IS_RATE]:
        written.append(at.STRETCH_ASKED)
    if task[at.DAMPING_IS_RATE]:
        written.append(at.DAMPING_ASKED)
    if model[at.DAMPED]:
        written.append(int(model[at.DAMPED]))
    if template[at.VR] or at.VR in drawn:
        read += REGIMES_READ
        written += REGIMES_WRITTEN
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        read += [harmonic + at.FREQUENCY, harmonic + at.PHASE]
        written += range(harmonic + at.COSINE, harmonic + at.ROTATE_SINE + 1)
    read = [row for row in read if row not in drawn]
    return np.array(read, np.int64), np.array(sorted({*written}), np.int64)


@borrowing_kernel
def restart_gathered(
    template,
    draws,
    constants,
    lanes,
    streams,
    frames,
    read,
    written,
    own_lanes,
    own_streams,
    own_frame,
    places,
    which,
    first,
    last,
):
    """Begin anew in the lanes listed and fill their history: `start` and `show_first` in one.

    Not for scenes with sampled excitation, channels that show what follows from the state, or
    fields that follow from a ratio.

    Parameters
    ----------
    template, draws, constants, lanes, streams, which, first, last
        As for `start`.
    frames
        As for `show_first`.
    read, written
        (r,) and (w,) int64, read: see `rows_of_start`.
    own_lanes, own_streams, own_frame
        (rows, count), (2, count) and (channels, count), of the types of `lanes`, `streams` and
        `frames`, overwritten: the lanes listed, side by side.
    places
        (count,) int64, read: 0, 1, 2 and so on.
    """
    task, model = task_and_model(constants)
    begin, end = place_of(first, which), place_of(last, which)
    listed, own = which[begin:end], places[begin:end]
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
        lanes[at.BEGAN, i] = lanes[at.NOW, i - i % np.uintp(at.BLOCK)]
    for row in range(frames.shape[0]):
        scatter_row(own_frame, row % own_frame.shape[0], frames, row, listed, begin)
    return at.OK
