"""Outputs of a control step: observed channels, and copies of what it shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation.jets import jet_value
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import clip, fma, prefer_widest_vectors
from mm_gym.lanes.listed import place_of
from mm_gym.lanes.memory import copy_row, copy_rows, fill, span
from mm_gym.lanes.random import chance_of_sensors, count_draws, normals_ahead, normals_of_sensors
from mm_gym.lanes.transposition import copy_as_columns
from mm_gym.law.carriage_spring import carriage_force
from mm_gym.law.dry_friction import interface_force
from mm_gym.law.interface import LINE, Interface, force_of, own_at, own_states_of, springs_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import spring_force


@inlined_kernel
def _line(model, lanes, i):  # noqa: ARG001 - other interfaces look up their row in the model
    """Return the force [N] of a viscous interface or of dry friction on a lane's carriage."""
    c, vr, kinetic = lanes[layout.C, i], lanes[layout.VR, i], lanes[layout.KINETIC_FORCE, i]
    w = lanes[layout.V2, i] - lanes[layout.V1, i]
    return interface_force(c, vr, kinetic, lanes[layout.CHI, i], w), 0.0


def link_of(interface: Interface) -> Callable[..., tuple[float, float]]:
    """Return the kernel (model, lanes, i) -> force [N] of an interface on a lane's carriage.

    Also returned is what of it is the springs'.
    """
    if interface is LINE:
        return _line

    @borrowing_kernel
    def link(model, lanes, i):
        first = int(model[layout.INTERFACE])
        own = own_at(interface, lanes[:, i], first - own_states_of(interface))
        offset = lanes[layout.X2, i] - lanes[layout.X1, i]
        w = lanes[layout.V2, i] - lanes[layout.V1, i]
        p = lanes[first:, i]
        force = force_of(interface, p, offset, w, own)
        return force, springs_of(interface, p, offset, w, own)

    return link


@cache
def deriving(interface: Interface) -> Callable[..., int]:
    """Return the kernel that writes what follows from the state, and its status.

    It is called only where a task shows or scores that.
    """
    link = link_of(interface)

    @borrowing_kernel
    def derive(task, model, lanes, first, last):
        """Write rows from CARRIAGE_ACCELERATION to GROUND_ACCELERATION.

        The first three of them are written only if one of the three is, DISTURBANCE only then or
        if a channel shows it.
        """
        has_reactions, is_pushed = task[layout.HAS_REACTIONS] > 0.0, False
        for k in range(int(task[layout.CHANNEL_COUNT])):
            is_pushed |= rows_of(task, k)[0] == layout.DISTURBANCE
        if has_reactions or is_pushed:
            write_excitation(model, lanes, layout.DISTURBANCE, False, first, last)
        write_excitation(model, lanes, layout.GROUND_ACCELERATION, True, first, last)
        if has_reactions:
            for i in range(first, last):
                write_reactions(model, lanes, link(model, lanes, i), i)
        return layout.OK

    return derive


@borrowing_kernel
def write_reactions(model, lanes, link, i):
    """Write accelerations and spring force of a lane, given what its `link_of` returns [N]."""
    x1, offset = lanes[layout.X1, i], lanes[layout.X2, i] - lanes[layout.X1, i]
    springs = spring_force(
        lanes[layout.K0, i], lanes[layout.L0, i], lanes[layout.STRETCH, i], offset
    )
    pair, held = control_forces(model, lanes[layout.FORCE, i])
    inner = link[0] + springs + pair
    spring = carriage_force(lanes[layout.K1, i], lanes[layout.ALPHA, i], lanes[layout.BETA, i], x1)
    outer = lanes[layout.DISTURBANCE, i] + held - lanes[layout.D, i] * lanes[layout.V1, i]
    lanes[layout.CARRIAGE_ACCELERATION, i] = (inner + outer - spring) / lanes[layout.M1, i]  # (1)
    lanes[layout.SPHERE_ACCELERATION, i] = -inner / lanes[layout.M2, i]  # (2) of docs/model.md
    lanes[layout.SPRING_FORCE, i] = springs + link[1]


@borrowing_kernel
def write_excitation(model, lanes, row, ground, first, last):
    """Write into a row the disturbing force [N] or the ground's acceleration [m/s^2].

    They are those at the sample interval's end.
    """
    if last - first == 1:  # a lone lane does without what loops prepare
        lanes[row, first] = excitation(model, lanes, ground, first)
        return
    fill(lanes, row, 0.0, first, last)
    terms = int(model[layout.TERMS])
    jet = int(model[layout.JETS]) + (terms if ground else 0)
    for n in range(terms - 1, -1, -1):
        for i in span(first, last):
            lanes[row, i] += lanes[jet + n, i]
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        if is_of(model, j, ground):
            for i in span(first, last):
                lanes[row, i] += (
                    lanes[harmonic + layout.AMPLITUDE, i] * lanes[harmonic + layout.SINE, i]
                )


@borrowing_kernel
def is_of(model, j, ground):
    """Tell whether harmonic j shakes the ground, or if not `ground`, pushes the carriage."""
    return ((int(model[layout.GROUND]) >> j) & 1 == 1) == ground


@borrowing_kernel
def excitation(model, lanes, ground, i):
    """Return the disturbing force [N] or the ground's acceleration [m/s^2] at an interval's end."""
    terms = int(model[layout.TERMS])
    total = jet_value(lanes, int(model[layout.JETS]) + (terms if ground else 0), terms, 1.0, i)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        if is_of(model, j, ground):
            total += lanes[harmonic + layout.AMPLITUDE, i] * lanes[harmonic + layout.SINE, i]
    return total


BOUND = np.float32(layout.OBSERVATION_BOUND)

STATE = (
    (layout.X1, layout.NO_ROW),
    (layout.X2, layout.X1),
    (layout.V1, layout.NO_ROW),
    (layout.V2, layout.NO_ROW),
)
"""Rows shown and subtracted by the channels of x1, x2 - x1, v1 and v2."""


@borrowing_kernel
def observe(task, lanes, frames, streams, first, last):
    """Append the newest frame to the history, and drop the oldest.

    The streams advance by what is reserved for a frame.
    """
    channels = int(task[layout.CHANNEL_COUNT])
    newest, behind = frames.shape[0] - channels, 0
    if task[layout.SENSORS_ROW] > 0.0:
        behind = int(task[layout.HISTORY]) * channels
        move_frames(frames, channels, 0, behind - channels, first, last)
    move_frames(frames, channels, behind, newest, first, last)
    write_channels(task, lanes, frames, newest, first, last)
    if task[layout.IS_NOISY] > 0.0:
        blur(task, lanes, frames, newest, streams, first, last)
    if behind > 0:
        receive(task, lanes, frames, streams, first, last)
    pass_frame(task, streams, first, last)


@borrowing_kernel
def move_frames(frames, channels, begin, end, first, last):
    """Move rows from `begin` to before `end` on by a frame: each takes what the next frame has."""
    if last - first == 1:  # a lone lane does without what loops prepare
        for row in range(begin, end):
            frames[row, first] = frames[row + channels, first]
    else:
        for row in range(begin, end):
            copy_row(frames, row + channels, row, first, last)


@borrowing_kernel
def receive(task, lanes, frames, streams, first, last):
    """Let the frame of each lane's own delay arrive, or hold the last one where it is lost.

    A frame that is held grows older. None is older than its episode, so that the first one, which
    stands for those before it, arrives without being lost.
    """
    channels, sensors = int(task[layout.CHANNEL_COUNT]), int(task[layout.SENSORS_ROW])
    newest, shown_at = frames.shape[0] - channels, (int(task[layout.HISTORY]) - 1) * channels
    delays = lanes[sensors + layout.DELAY, first:last]
    ages = lanes[sensors + layout.AGE, first:last]
    if task[layout.HAS_DROPOUT] > 0.0:
        noisy = 0
        for k in range(channels):
            noisy += int(noise_of(task, k) > 0.0)
        noisy += noisy % 2  # normal numbers come in pairs
        chances = lanes[sensors + layout.DROPOUT, first:last]
        for i in range(last - first):
            held = ages[i] + 1.0
            is_lost = chance_of_sensors(streams, noisy, first + i) < chances[i]
            ages[i] = held if is_lost else min(held, delays[i])
    else:
        for i in range(last - first):
            ages[i] = min(ages[i] + 1.0, delays[i])
    for delay in range(int(task[layout.MOST_DELAY]) + 1):  # side by side, which a look-up is not
        wanted = float(delay)
        for k in range(channels):
            arriving = frames[newest - channels * delay + k, first:last]
            observed = frames[shown_at + k, first:last]
            for i in range(last - first):
                new, old, late = arriving[i], observed[i], delays[i]
                observed[i] = new if (late == wanted) & (ages[i] <= late) else old


@borrowing_kernel
def begin_sensors(task, lanes, which):
    """Begin with a frame that is not late, and a delay of whole steps, in the lanes listed."""
    sensors = int(task[layout.SENSORS_ROW])
    if sensors > 0:
        for i in which:
            delay = math.floor(lanes[sensors + layout.DELAY, i])
            lanes[sensors + layout.DELAY, i] = min(delay, task[layout.MOST_DELAY])
            lanes[sensors + layout.AGE, i] = 0.0


@borrowing_kernel
def errors_row_of(task, k):
    """Return the first row of channel k's noise and bias; `NO_ROW` if all lanes have the same."""
    sensors = int(task[layout.SENSORS_ROW])
    return sensors + layout.SENSORS_SIZE + layout.ERRORS_SIZE * k if sensors > 0 else layout.NO_ROW


@borrowing_kernel
def bias_row_of(task, k):
    """Return the row of what channel k shows too much [SI], or `NO_ROW`."""
    row = errors_row_of(task, k)
    return row + layout.BIAS if row != layout.NO_ROW else layout.NO_ROW


@borrowing_kernel
def pass_frame(task, streams, first, last):
    """Pass over the numbers that are reserved for a frame's noise, also where it is not drawn."""
    reserved = int(task[layout.RESERVED])
    if reserved > 0:
        for i in span(first, last):
            count_draws(streams, reserved, i)


@borrowing_kernel
def write_channels(task, lanes, frames, newest, first, last):
    """Write the scaled channels of the newest frame."""
    prefer_widest_vectors()
    for k in range(int(task[layout.CHANNEL_COUNT])):
        scale, shift = scaling(task, k)
        row, subtracted_row = rows_of(task, k)
        frame, values = frames[newest + k, first:last], lanes[row, first:last]
        bias_row = bias_row_of(task, k)
        if bias_row != layout.NO_ROW:
            biases, is_relative = lanes[bias_row, first:last], subtracted_row != layout.NO_ROW
            subtracted = lanes[subtracted_row if is_relative else bias_row, first:last]
            for i in range(last - first):
                value = values[i] - subtracted[i] if is_relative else values[i]
                frame[i] = shown(value + biases[i], scale, shift)
        elif subtracted_row != layout.NO_ROW:
            subtracted = lanes[subtracted_row, first:last]
            for i in range(last - first):
                frame[i] = shown(values[i] - subtracted[i], scale, shift)
        else:
            for i in range(last - first):
                frame[i] = shown(values[i], scale, shift)


@borrowing_kernel
def blur(task, lanes, frames, newest, streams, first, last):
    """Add the sensors' noise to the newest frame; the streams are read, and do not advance."""
    prefer_widest_vectors()
    is_reserved, ahead = task[layout.HAS_RESERVED_NOISE] > 0.0, 0
    channels, k = int(task[layout.CHANNEL_COUNT]), next_noisy(task, 0)
    while k < channels:
        other = next_noisy(task, k + 1)
        spreads = noise_of(task, k), noise_of(task, other) if other < channels else 0.0
        # Of an odd number the last takes the second normal number too, times zero.
        second = other if other < channels else k
        rows = newest + k, newest + second
        if task[layout.SENSORS_ROW] > 0.0:
            blur_own(task, lanes, frames, newest, streams, (k, second), ahead, first, last)
        elif last - first == 1:  # a lone lane does without what a loop prepares
            blur_pair(frames, rows, spreads, streams, is_reserved, ahead, first)
        elif is_reserved:
            for i in span(first, last):
                blur_pair(frames, rows, spreads, streams, True, ahead, i)
        else:
            for i in span(first, last):
                blur_pair(frames, rows, spreads, streams, False, ahead, i)
        k, ahead = next_noisy(task, other + 1), ahead + 2


@borrowing_kernel
def blur_own(task, lanes, frames, newest, streams, pair, ahead, first, last):
    """Add noise to two channels, of each lane's own standard deviations.

    Arguments as of `blur`, the channels, and how many numbers come before theirs. If it is one
    channel twice, it takes the first number only.
    """
    one, other = pair
    is_reserved, both = task[layout.HAS_RESERVED_NOISE] > 0.0, other != one
    scales = scaling(task, one)[0], scaling(task, other)[0] if both else 0.0
    row = errors_row_of(task, one) + layout.SPREAD
    row_of_other = errors_row_of(task, other) + layout.SPREAD
    rows = newest + one, newest + other
    if is_reserved:
        for i in span(first, last):
            own = lanes[row, i] * scales[0], lanes[row_of_other, i] * scales[1]
            blur_pair(frames, rows, own, streams, True, ahead, i)
    else:
        for i in span(first, last):
            own = lanes[row, i] * scales[0], lanes[row_of_other, i] * scales[1]
            blur_pair(frames, rows, own, streams, False, ahead, i)


@inlined_kernel
def blur_pair(frames, rows, spreads, streams, is_reserved, ahead, i):
    """Add noise of two standard deviations to two rows of a lane, from numbers after `ahead`."""
    if is_reserved:
        pair = normals_ahead(streams, ahead, i)
    else:
        pair = normals_of_sensors(streams, ahead, i)
    for side in range(2):
        noisy = np.float32(frames[rows[side], i] + spreads[side] * pair[side])
        frames[rows[side], i] = bounded(noisy)


@borrowing_kernel
def noise_of(task, k):
    """Return the scaled standard deviation of the noise of channel k."""
    return task[layout.CHANNELS + layout.CHANNEL_SIZE * k + layout.NOISE]


@borrowing_kernel
def next_noisy(task, k):
    """Return the first channel from the k-th on that has noise, or the number of channels."""
    while k < int(task[layout.CHANNEL_COUNT]) and noise_of(task, k) == 0.0:
        k += 1
    return k


@borrowing_kernel
def scaling(task, k):
    """Return the factor of a channel, and what is added to the product."""
    slot = layout.CHANNELS + layout.CHANNEL_SIZE * k
    scale = task[slot + layout.SCALE]
    return scale, -task[slot + layout.ZERO] * scale


@borrowing_kernel
def rows_of(task, k):
    """Return the row that channel k shows and the row subtracted from it, or `NO_ROW`."""
    slot = layout.CHANNELS + layout.CHANNEL_SIZE * k
    return int(task[slot + layout.SHOWN]), int(task[slot + layout.SUBTRACTED])


@borrowing_kernel
def shows_state(task, frames):
    """Tell whether one frame of x1, x2 - x1, v1 and v2 without noise is all that is observed."""
    count = len(STATE)
    if (
        frames.shape[0] != count
        or task[layout.CHANNEL_COUNT] != count
        or task[layout.IS_NOISY] > 0.0
    ):
        return False
    same = True
    for k in range(count):
        same &= rows_of(task, k) == STATE[k]
    return same


@borrowing_kernel
def shown(value, scale, shift):
    """Return a channel's value as observed."""
    return bounded(np.float32(fma(value, scale, shift)))


@borrowing_kernel
def bounded(value):
    """Return the value, or the largest finite one for an infinite one."""
    return clip(value, -BOUND, BOUND)


@borrowing_kernel
def copy_observed(frames, observed, first, last):
    """Copy the observed frames, of each lane side by side, to (lanes, k) float32."""
    copy_as_columns(frames, observed, first, last)
    return layout.OK


@borrowing_kernel
def copy_outputs(lanes, frames, ends, held, observed, ended, states, applied, first, last):
    """Copy the outputs of a control step.

    Parameters
    ----------
    held
        (2,) int64, read: first row of what the actuators applied, and the distance of these rows.
    observed, ended
        (lanes, k) float32 and (2, lanes) bool, written: frames observed; terminated, truncated.
    states, applied
        (4, lanes) [m, m, m/s, m/s] and (actuators, lanes) [N, -, N s/m], written.
    """
    row, distance = held[0], held[1]
    copy_observed(frames, observed, first, last)
    copy_rows(lanes, layout.X1, states, first, last)
    for k in range(applied.shape[0]):
        for i in span(first, last):
            applied[k, i] = lanes[row + distance * k, i]
    copy_rows(ends, layout.TERMINATED, ended, first, last)
    return layout.OK


@borrowing_kernel
def copy_ends(lanes, frames, held, which, former, observed, values, first, last):
    """Copy the last outputs of the lanes listed.

    Parameters
    ----------
    held
        As for `copy_outputs`.
    former
        (c,) int64, read: lanes whose values are set to zero first.
    observed
        (n, k) float32, written: the frames observed, of a lane listed in each row.
    values
        (lanes, 4 + actuators) float64, written: states [m, m, m/s, m/s] and what was applied
        [N, -, N s/m], of each lane side by side, so that few cache lines are written.
    """
    for k in span(place_of(first, former), place_of(last, former)):
        values[former[k], :] = 0.0
    for k in span(place_of(first, which), place_of(last, which)):
        i = np.uintp(which[k])
        for row in span(0, observed.shape[1]):
            observed[k, row] = frames[row, i]
        for row in span(0, 4):
            values[i, row] = lanes[row, i]
        for row in span(4, values.shape[1]):
            values[i, row] = lanes[held[0] + held[1] * (row - 4), i]
    return layout.OK
