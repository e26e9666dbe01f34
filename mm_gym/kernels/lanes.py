"""What a control step does around the physics: command, score, observe.

Each kernel works on the lanes first .. last - 1. Loops run over lanes innermost, without calls or
early exits, so that the compiler vectorises them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import clip, fma, prefer_widest_vectors, span
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.random import normals

BOUND = np.float32(at.OBSERVATION_BOUND)


@borrowing_kernel
def finite(actions):
    """Tell whether all actions are finite."""
    prefer_widest_vectors()
    wrong = False
    for i in range(actions.shape[0]):
        wrong |= not abs(actions[i]) < np.inf
    return not wrong


@borrowing_kernel
def command(task, lanes, actions, first, last):
    """Turn actions in [-1, 1] into force [N] and stretch; begin the rewards with their cost."""
    has_force = task[at.HAS_FORCE] > 0.0
    if has_force:
        push(task, lanes, actions, first, last)
    else:
        fill(lanes, at.REWARD, 0.0, first, last)
    if task[at.HAS_STRETCH] > 0.0:
        behind_forces = actions.shape[0] // 2 if has_force else 0
        tune(task, lanes, actions[behind_forces:], first, last)


@borrowing_kernel
def push(task, lanes, actions, first, last):
    """Apply a force [N] and begin the rewards with its cost."""
    limit, rate, weight = task[at.FORCE_LIMIT], task[at.FORCE_RATE], task[at.WEIGHT_EFFORT]
    share = task[at.FORCE_SHARE]
    if task[at.FORCE_IS_RATE] > 0.0:
        integrate(lanes, at.FORCE_ASKED, actions, rate, -limit, limit, first, last)
        for i in span(first, last):
            a, present, wanted = (
                clip(actions[i], -1.0, 1.0),
                lanes[at.FORCE, i],
                lanes[at.FORCE_ASKED, i],
            )
            lanes[at.FORCE, i] = approach(present, wanted, share, rate, -limit, limit)
            lanes[at.REWARD, i] = 0.0 - weight * a * a
    elif is_at_once(rate, share):
        for i in span(first, last):
            a = clip(actions[i], -1.0, 1.0)
            lanes[at.FORCE, i] = limit * a
            lanes[at.REWARD, i] = 0.0 - weight * a * a
    else:
        for i in span(first, last):
            a, present = clip(actions[i], -1.0, 1.0), lanes[at.FORCE, i]
            lanes[at.FORCE, i] = approach(present, limit * a, share, rate, -limit, limit)
            lanes[at.REWARD, i] = 0.0 - weight * a * a


@borrowing_kernel
def tune(task, lanes, asked, first, last):
    """Set the stretch [-] within its limits; add its cost."""
    low, high, rate = task[at.STRETCH_LOW], task[at.STRETCH_HIGH], task[at.STRETCH_RATE]
    share, weight = task[at.STRETCH_SHARE], task[at.WEIGHT_EFFORT]
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    if task[at.STRETCH_IS_RATE] > 0.0:
        integrate(lanes, at.STRETCH_ASKED, asked, rate, low, high, first, last)
        for i in span(first, last):
            a, present, wanted = (
                clip(asked[i], -1.0, 1.0),
                lanes[at.STRETCH, i],
                lanes[at.STRETCH_ASKED, i],
            )
            lanes[at.STRETCH, i] = approach(present, wanted, share, rate, low, high)
            lanes[at.REWARD, i] -= weight * a * a
    else:
        for i in span(first, last):
            a, present = clip(asked[i], -1.0, 1.0), lanes[at.STRETCH, i]
            lanes[at.STRETCH, i] = approach(present, middle + half * a, share, rate, low, high)
            lanes[at.REWARD, i] -= weight * a * a


@borrowing_kernel
def is_at_once(rate, share):
    """Tell whether an actuator reaches within the control step whatever it is commanded."""
    return rate == np.inf and share == 1.0


@borrowing_kernel
def integrate(lanes, row, actions, rate, low, high, first, last):
    """Add up what a rate commands, within the actuator's limits."""
    for i in span(first, last):
        lanes[row, i] = clip(lanes[row, i] + rate * clip(actions[i], -1.0, 1.0), low, high)


@borrowing_kernel
def approach(present, wanted, share, rate, low, high):
    """Return what an actuator reaches in a control step, as near to wanted as it can.

    Its lag lets it go a share of the way; then the rate limit and the limits hold.
    """
    aim = wanted if share == 1.0 else fma(share, wanted - present, present)
    return clip(clip(aim, present - rate, present + rate), low, high)


@borrowing_kernel
def score(task, lanes, first, last):
    """Take the state's cost off the rewards; return the status."""
    weights, lost = state_weights(task), False
    for i in span(first, last):
        cost = state_cost(weights, lanes[at.X1, i], lanes[at.X2, i], lanes[at.V1, i])
        reward = lanes[at.REWARD, i] - cost
        lanes[at.REWARD, i] = reward
        lost |= is_lost(reward)
    return at.DIVERGED if lost else at.OK


@borrowing_kernel
def state_weights(task):
    """Return the weights of x1^2, v1^2 and (x2 - x1)^2."""
    return task[at.WEIGHT_DISPLACEMENT], task[at.WEIGHT_VELOCITY], task[at.WEIGHT_STROKE]


@borrowing_kernel
def state_cost(weights, x1, x2, v1):
    """Return what a state costs."""
    wx, wv, ws = weights
    offset = x2 - x1
    return fma(wx * x1, x1, fma(wv * v1, v1, ws * offset * offset))


@borrowing_kernel
def is_lost(reward):
    """Tell whether the state is no longer finite.

    That shows in the reward, whatever the weights: 0 times infinity is NaN.
    """
    return not reward > -np.inf


@borrowing_kernel
def judge(task, lanes, ends, first, last):
    """Count a block's step and mark the episodes that end with it; return the status."""
    furthest, rail = task[at.DISPLACEMENT_LIMIT], task[at.RAIL_LIMIT]
    now = lanes[at.NOW, first] + 1.0
    lanes[at.NOW, first] = now
    ended = now >= lanes[at.DUE, first]
    if furthest < np.inf or rail < np.inf:
        for i in span(first, last):
            x1 = lanes[at.X1, i]
            ended |= (abs(x1) > furthest) | (abs(lanes[at.X2, i] - x1) > rail)
    if not ended:  # as nearly always
        if ends[at.MARKED, first]:
            fill(ends, at.TERMINATED, False, first, last)
            fill(ends, at.TRUNCATED, False, first, last)
            ends[at.MARKED, first] = False
        return at.OK
    ended, steps, oldest = False, task[at.STEPS], 0
    x1s, x2s, began = (
        lanes[at.X1, first:last],
        lanes[at.X2, first:last],
        lanes[at.BEGAN, first:last],
    )
    over, late = ends[at.TERMINATED, first:last], ends[at.TRUNCATED, first:last]
    for i in range(last - first):
        over[i] = (abs(x1s[i]) > furthest) | (abs(x2s[i] - x1s[i]) > rail)
        late[i] = now - began[i] >= steps
    for i in range(last - first):
        ended |= over[i] | late[i]
    for i in range(last - first):  # an integer: the largest double is not found side by side
        oldest = max(oldest, int(now - began[i]))
    lanes[at.DUE, first] = now - oldest + steps
    ends[at.MARKED, first] = ended
    return at.ENDED if ended else at.OK


@borrowing_kernel
def fill(rows, row, value, first, last):
    """Set a row's lanes to a value."""
    for i in span(first, last):
        rows[row, i] = value


@borrowing_kernel
def observe(task, lanes, frames, streams, first, last):
    """Append the newest frame of every channel to the history, the oldest frame falling off."""
    channels = int(task[at.CHANNEL_COUNT])
    newest = frames.shape[0] - channels
    for row in range(newest):
        for i in span(first, last):
            frames[row, i] = frames[row + channels, i]
    write_channels(task, lanes, frames, newest, first, last)
    if task[at.IS_NOISY] > 0.0:
        blur(task, frames, newest, streams, first, last)


@borrowing_kernel
def write_channels(task, lanes, frames, newest, first, last):
    """Write the channels, scaled."""
    prefer_widest_vectors()
    for k in range(int(task[at.CHANNEL_COUNT])):
        scale, shift = scaling(task, k)
        plus, minus = channel_rows(code_of(task, k))
        frame, values = frames[newest + k, first:last], lanes[plus, first:last]
        if minus >= 0:
            subtracted = lanes[minus, first:last]
            for i in range(last - first):
                frame[i] = shown(values[i] - subtracted[i], scale, shift)
        else:
            for i in range(last - first):
                frame[i] = shown(values[i], scale, shift)


@borrowing_kernel
def blur(task, frames, newest, streams, first, last):
    """Add the sensors' noise to the newest frame."""
    channels = int(task[at.CHANNEL_COUNT])
    for i in range(first, last):
        for k in range(0, channels, 2):
            pair = normals(streams, i)
            for side in range(min(2, channels - k)):
                spread = task[at.CHANNELS + at.CHANNEL_SIZE * (k + side) + at.NOISE]
                row = newest + k + side
                frames[row, i] = bounded(np.float32(frames[row, i] + spread * pair[side]))


@borrowing_kernel
def scaling(task, k):
    """Return what a channel is multiplied by, and what is then added."""
    slot = at.CHANNELS + at.CHANNEL_SIZE * k
    scale = task[slot + at.SCALE]
    return scale, -task[slot + at.ZERO] * scale


@borrowing_kernel
def code_of(task, k):
    """Return a channel's code."""
    return int(task[at.CHANNELS + at.CHANNEL_SIZE * k + at.CODE])


@borrowing_kernel
def shows_state(task, frames):
    """Tell whether the newest frame is all that is observed: x1, offset, v1 and v2, noiseless."""
    count = len(at.STATE_CHANNELS)
    if frames.shape[0] != count or task[at.CHANNEL_COUNT] != count or task[at.IS_NOISY] > 0.0:
        return False
    same = True
    for k in range(count):
        same &= code_of(task, k) == at.STATE_CHANNELS[k]
    return same


@borrowing_kernel
def shown(value, scale, shift):
    """Return a channel's value as observed."""
    return bounded(np.float32(fma(value, scale, shift)))


@borrowing_kernel
def bounded(value):
    """Return the value within the bounds of the observation space."""
    return clip(value, -BOUND, BOUND)


@borrowing_kernel
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
    if code == at.STRETCH_CHANNEL:
        return at.STRETCH, -1
    return at.CARRIAGE_ACCELERATION + code - at.DERIVED_CHANNELS, -1


@borrowing_kernel
def rotate(model, lanes, first, last):
    """Advance the phase of every tone by one substep."""
    for j in range(int(model[at.TONE_COUNT])):
        tone = at.TONES + at.TONE_ROWS * j
        for i in span(first, last):
            c, s = lanes[tone + at.COSINE, i], lanes[tone + at.SINE, i]
            rc, rs = lanes[tone + at.ROTATE_COSINE, i], lanes[tone + at.ROTATE_SINE, i]
            cosine, sine = fma(c, rc, -s * rs), fma(s, rc, c * rs)
            # One Newton step for 1/norm: without it the amplitude would drift by an ulp a step.
            norm = fma(-0.5, fma(cosine, cosine, sine * sine), 1.5)
            lanes[tone + at.COSINE, i], lanes[tone + at.SINE, i] = cosine * norm, sine * norm


@borrowing_kernel
def hand_out(
    lanes,
    frames,
    ends,
    applied_row,
    observed,
    rewards,
    terminated,
    truncated,
    states,
    applied,
    first,
    last,
):
    """Copy what a control step shows."""
    copy_rows(frames, 0, observed, first, last)
    copy_rows(lanes, at.X1, states, first, last)
    copy_rows(lanes, applied_row, applied, first, last)
    for i in span(first, last):
        rewards[i] = lanes[at.REWARD, i]
    for i in span(first, last):
        terminated[i], truncated[i] = ends[at.TERMINATED, i], ends[at.TRUNCATED, i]
    return at.OK


@borrowing_kernel
def copy_rows(rows, row, target, first, last):
    """Copy rows from the given one on, as many as the target has."""
    for k in range(target.shape[0]):
        for i in span(first, last):
            target[k, i] = rows[row + k, i]
