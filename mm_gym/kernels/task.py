"""What a control step does around the physics: command, score, observe.

Each kernel works on the lanes first .. last - 1. Loops run over lanes innermost, without calls or
early exits, so that the compiler vectorises them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import clip, fma, prefer_widest_vectors
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.memory import fill, span


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
    share = task[at.FORCE_LAG_FACTOR]
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
    share, weight = task[at.STRETCH_LAG_FACTOR], task[at.WEIGHT_EFFORT]
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
def check_termination(task, lanes, ends, first, last):
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
