"""What a control step does around the physics: command, score, observe, begin an episode.

Each kernel works on the lanes first .. last - 1. Loops run over lanes innermost, without calls or early exits, so
that the compiler vectorises them.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel
from mm_gym.kernels.random import uniform


@kernel
def clip(value, low, high):
    """Return the value limited to [low, high]."""
    return min(max(value, low), high)


@kernel
def finite(actions, first, last):
    """Tell whether every action of the lanes is finite."""
    bad = False
    for j in range(actions.shape[1]):
        column = actions[first:last, j]
        for i in range(last - first):
            bad |= not abs(column[i]) < np.inf
    return not bad


@kernel
def command(task, lanes, actions, first, last):
    """Turn actions in [-1, 1] into the applied force [N] and stretch, within limits and rate limits."""
    column = 0
    if task[at.HAS_FORCE] > 0.0:
        asked, force = actions[first:last, 0], lanes[at.FORCE, first:last]
        limit, rate = task[at.FORCE_LIMIT], task[at.FORCE_RATE]
        for i in range(last - first):
            force[i] = approach(force[i], limit * clip(float(asked[i]), -1.0, 1.0), rate, -limit, limit)
        column = 1
    if task[at.HAS_STRETCH] > 0.0:
        asked, stretch = actions[first:last, column], lanes[at.STRETCH, first:last]
        low, high, rate = task[at.STRETCH_LOW], task[at.STRETCH_HIGH], task[at.STRETCH_RATE]
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        if task[at.STRETCH_IS_RATE] > 0.0:
            for i in range(last - first):
                wanted = stretch[i] + rate * clip(float(asked[i]), -1.0, 1.0)
                stretch[i] = approach(stretch[i], wanted, rate, low, high)
        else:
            for i in range(last - first):
                wanted = middle + half * clip(float(asked[i]), -1.0, 1.0)
                stretch[i] = approach(stretch[i], wanted, rate, low, high)


@kernel
def approach(present, wanted, rate, low, high):
    """Return what an actuator reaches in one control step: as near to the wanted value as rate and range allow."""
    return clip(clip(wanted, present - rate, present + rate), low, high)


@kernel
def score(task, lanes, actions, terminated, truncated, first, last):
    """Write the reward of the state reached, count the step, flag the ends of episodes; tell whether there is one."""
    wx, wv = task[at.WEIGHT_DISPLACEMENT], task[at.WEIGHT_VELOCITY]
    wu, ws = task[at.WEIGHT_EFFORT], task[at.WEIGHT_STROKE]
    x1s, x2s, v1s = lanes[at.X1, first:last], lanes[at.X2, first:last], lanes[at.V1, first:last]
    rewards = lanes[at.REWARD, first:last]
    for i in range(last - first):
        x1, v1 = x1s[i], v1s[i]
        offset = x2s[i] - x1
        rewards[i] = -(wx * x1 * x1 + wv * v1 * v1 + ws * offset * offset)
    if wu > 0.0:
        for j in range(actions.shape[1]):
            column = actions[first:last, j]
            for i in range(last - first):
                a = clip(float(column[i]), -1.0, 1.0)
                rewards[i] -= wu * a * a
    return flag_ends(task, lanes, terminated, truncated, first, last)


@kernel
def flag_ends(task, lanes, terminated, truncated, first, last):
    """Count the step and flag the ends of episodes; tell whether there is one."""
    furthest, rail, steps = task[at.DISPLACEMENT_LIMIT], task[at.RAIL_LIMIT], task[at.STEPS]
    x1s, x2s, counts = lanes[at.X1, first:last], lanes[at.X2, first:last], lanes[at.STEP, first:last]
    beyond, over = terminated[first:last], truncated[first:last]
    ended = False
    for i in range(last - first):
        counts[i] += 1.0
        over[i] = counts[i] >= steps
        ended |= over[i]
    for i in range(last - first):
        beyond[i] = (abs(x1s[i]) > furthest) | (abs(x2s[i] - x1s[i]) > rail)
        ended |= beyond[i]
    return ended


@kernel
def observe(task, lanes, frames, first, last):
    """Append the newest frame of every channel to the history, the oldest frame falling off."""
    channels = int(task[at.CHANNEL_COUNT])
    newest = frames.shape[0] - channels
    for row in range(newest):
        older, newer = frames[row, first:last], frames[row + channels, first:last]
        for i in range(last - first):
            older[i] = newer[i]
    for k in range(channels):
        slot = at.CHANNELS + 3 * k
        scale, zero = task[slot + 1], task[slot + 2]
        plus, minus = channel_rows(int(task[slot]))
        shown, frame = lanes[plus, first:last], frames[newest + k, first:last]
        if minus >= 0:
            subtracted = lanes[minus, first:last]
            for i in range(last - first):
                frame[i] = scaled(shown[i] - subtracted[i] - zero, scale)
        else:
            for i in range(last - first):
                frame[i] = scaled(shown[i] - zero, scale)


@kernel
def scaled(value, scale):
    """Return the value times its scale, within the bounds of the observation space."""
    return clip(value * scale, -at.OBSERVATION_BOUND, at.OBSERVATION_BOUND)


@kernel
def channel_rows(code):
    """Return the row that a channel shows and the row subtracted from it, -1 for none."""
    if code == at.CARRIAGE_DISPLACEMENT:
        return at.X1, -1
    if code == at.SPHERE_DISPLACEMENT:
        return at.X2, -1
    if code == at.SPHERE_OFFSET:
        return at.X2, at.X1
    if code == at.CARRIAGE_VELOCITY:
        return at.V1, -1
    if code == at.SPHERE_VELOCITY:
        return at.V2, -1
    if code == at.SLIP_VELOCITY:
        return at.V2, at.V1
    return at.STRETCH, -1


@kernel
def draw(template, draws, lanes, streams, mask):
    """Fill the lanes of the mask with the scene's values and draw the random ones: rows of (row, low, high)."""
    for i in range(mask.shape[0]):
        if mask[i]:
            for row in range(template.shape[0]):
                if row != at.REWARD:  # what the last step earned outlives an autoreset
                    lanes[row, i] = template[row]
            for j in range(draws.shape[0]):
                low, high = draws[j, 1], draws[j, 2]
                lanes[int(draws[j, 0]), i] = clip(low + (high - low) * uniform(streams, i), low, high)


@kernel
def begin(model, task, lanes, frames, mask):
    """Complete drawn lanes: absolute positions, phases, and a history filled with the first frame.

    Until here row X2 holds the sphere's offset, because that is what a scene states.
    """
    for i in range(mask.shape[0]):
        if mask[i]:
            lanes[at.X2, i] += lanes[at.X1, i]
            for j in range(int(model[at.TONE_COUNT])):
                tone = at.TONES + at.TONE_ROWS * j
                turn = lanes[tone + at.FREQUENCY, i] * model[at.TIME_STEP]
                lanes[tone + at.COSINE, i] = math.cos(lanes[tone + at.PHASE, i])
                lanes[tone + at.SINE, i] = math.sin(lanes[tone + at.PHASE, i])
                lanes[tone + at.ROTATE_COSINE, i] = math.cos(turn)
                lanes[tone + at.ROTATE_SINE, i] = math.sin(turn)
            for _ in range(frames.shape[0] // int(task[at.CHANNEL_COUNT])):
                observe(task, lanes, frames, i, i + 1)


@kernel
def rotate(model, lanes, first, last):
    """Advance the phase of every tone by one control step."""
    for j in range(int(model[at.TONE_COUNT])):
        tone = at.TONES + at.TONE_ROWS * j
        cosines, sines = lanes[tone + at.COSINE, first:last], lanes[tone + at.SINE, first:last]
        by_cosine, by_sine = lanes[tone + at.ROTATE_COSINE, first:last], lanes[tone + at.ROTATE_SINE, first:last]
        for i in range(last - first):
            c, s, rc, rs = cosines[i], sines[i], by_cosine[i], by_sine[i]
            cosine, sine = c * rc - s * rs, s * rc + c * rs
            # One Newton step for 1/norm: without it the amplitude would drift by an ulp a step.
            norm = 1.5 - 0.5 * (cosine * cosine + sine * sine)
            cosines[i], sines[i] = cosine * norm, sine * norm
