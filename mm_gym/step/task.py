"""The task in a control step: commands to the actuators, the reward, the end of an episode.

The innermost loops run over lanes, without calls
or early exits, so that the compiler vectorises them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import clip, fma, prefer_widest_vectors
from mm_gym.lanes.elementary import exponential
from mm_gym.lanes.memory import copy_row, fill, span

LOW, HIGH, RATE, IS_RATE, LAG_FACTOR = 1, 2, 3, 4, 5
"""Slots of an actuator, behind the first one."""


@borrowing_kernel
def task_and_model(constants):
    """Return the constants of the task and those of the model, which stand behind one another.

    They are one array where Python calls, because every argument adds call overhead.
    """
    behind = layout.CHANNELS + layout.CHANNEL_SIZE * int(constants[layout.CHANNEL_COUNT])
    return constants, constants[behind:]


@borrowing_kernel
def finite(actions):
    """Tell whether all actions are finite."""
    prefer_widest_vectors()
    wrong = False
    for i in range(actions.shape[0]):
        wrong |= not abs(actions[i]) < np.inf
    return not wrong


FORCE = layout.HAS_FORCE, layout.FORCE, layout.FORCE_ASKED, layout.FORCE_ROW
STRETCH = layout.HAS_STRETCH, layout.STRETCH, layout.STRETCH_ASKED, layout.STRETCH_ROW
DAMPING = layout.HAS_DAMPING, layout.DAMPING, layout.DAMPING_ASKED, layout.DAMPING_ROW
ACTUATORS = FORCE, STRETCH, DAMPING
"""Of each actuator, in the order of the action: its first slot of the task, the row of what it
applies [N], [-] or [N s/m], that of what it is asked for, and the slot of the first row of a lane's
own actuator."""


@borrowing_kernel
def command(task, lanes, actions, rewards, first, last):
    """Apply actions: set what actuators hold, and begin the rewards with the actions' cost."""
    prefer_widest_vectors()
    weight, next_one, many = task[layout.WEIGHT_EFFORT], 0, 0
    for actuator in ACTUATORS:
        many += int(task[actuator[0]] > 0.0)
    count = actions.shape[0] // max(many, 1)
    for actuator in ACTUATORS:
        if task[actuator[0]] > 0.0:
            asked, begun = actions[next_one:], next_one > 0
            move(task, lanes, actuator, asked, first, last)
            for i in span(first, last):
                a = clip(asked[i], -1.0, 1.0)
                rewards[i] = (rewards[i] if begun else 0.0) - weight * a * a
            next_one += count
    if many == 0:
        for i in span(first, last):
            rewards[i] = 0.0


@borrowing_kernel
def move(task, lanes, actuator, asked, first, last):
    """Let one of `ACTUATORS` follow the actions that ask it, (lanes,)."""
    prefer_widest_vectors()
    slot, row, row_asked, slot_own = actuator
    low, high, rate = task[slot + LOW], task[slot + HIGH], task[slot + RATE]
    lag_factor, middle, half = task[slot + LAG_FACTOR], 0.5 * (high + low), 0.5 * (high - low)
    is_rate, own = task[slot + IS_RATE] > 0.0, int(task[slot_own])
    if own > 0:  # each lane has a lag and a rate limit of its own
        for i in span(first, last):
            a, travel = clip(asked[i], -1.0, 1.0), lanes[own + layout.TRAVEL, i]
            if is_rate:
                wanted = clip(lanes[row_asked, i] + travel * a, low, high)
                lanes[row_asked, i] = wanted
            else:
                wanted = middle + half * a
            factor = lanes[own + layout.LAG_FACTOR, i]
            lanes[row, i] = approach(lanes[row, i], wanted, factor, travel, low, high)
    elif is_rate:
        for i in span(first, last):
            change = rate * clip(asked[i], -1.0, 1.0)
            lanes[row_asked, i] = clip(lanes[row_asked, i] + change, low, high)
        for i in span(first, last):
            present, wanted = lanes[row, i], lanes[row_asked, i]
            lanes[row, i] = approach(present, wanted, lag_factor, rate, low, high)
    elif is_at_once(rate, lag_factor):
        for i in span(first, last):
            lanes[row, i] = clip(middle + half * clip(asked[i], -1.0, 1.0), low, high)
    else:
        for i in span(first, last):
            wanted = middle + half * clip(asked[i], -1.0, 1.0)
            lanes[row, i] = approach(lanes[row, i], wanted, lag_factor, rate, low, high)


@borrowing_kernel
def steer(task, lanes, wanted):
    """Let the actuators of lane 0 go towards force [N], stretch and damping [N s/m] wanted."""
    for k in range(wanted.shape[0]):
        slot, row, _, slot_own = ACTUATORS[k]
        if task[slot] > 0.0:
            own = int(task[slot_own])
            factor, rate = task[slot + LAG_FACTOR], task[slot + RATE]
            if own > 0:
                factor, rate = lanes[own + layout.LAG_FACTOR, 0], lanes[own + layout.TRAVEL, 0]
            low, high = task[slot + LOW], task[slot + HIGH]
            within = clip(wanted[k], low, high)
            lanes[row, 0] = approach(lanes[row, 0], within, factor, rate, low, high)


@borrowing_kernel
def hold(model, lanes, first, last):
    """Let a damper have the damping [N s/m] that its actuator holds."""
    damped = int(model[layout.DAMPED])
    if damped > 0:
        copy_row(lanes, layout.DAMPING, damped, first, last)


@borrowing_kernel
def begin_own(task, lanes, which):
    """Write what follows from the lag and rate limit of each lane listed, in a control step."""
    for actuator in ACTUATORS:
        own = int(task[actuator[3]])
        if own > 0:
            for i in which:
                lag = lanes[own + layout.LAG, i]
                share = 1.0 if lag == 0.0 else part_of_way(task[layout.TIME_STEP] / lag)
                lanes[own + layout.LAG_FACTOR, i] = share
                lanes[own + layout.TRAVEL, i] = (
                    lanes[own + layout.RATE_LIMIT, i] * task[layout.TIME_STEP]
                )


SMALL, TERMS = 0.25, 12
"""Below it 1 - exp(-x) is a power series of so many terms, the next of which is 1e-17 of it."""


@borrowing_kernel
def part_of_way(x):
    """Return 1 - exp(-x) for x > 0, to the last digits for small x too."""
    if x > SMALL:
        return 1.0 - exponential(-x)
    value = 1.0
    for n in range(TERMS, 1, -1):
        value = 1.0 - x / n * value
    return x * value


@borrowing_kernel
def is_at_once(rate, lag_factor):
    """Tell whether an actuator has neither a rate limit nor a lag."""
    return rate == np.inf and lag_factor == 1.0


@borrowing_kernel
def approach(present, wanted, lag_factor, rate, low, high):
    """Return what an actuator reaches in a control step from what it has and what it is commanded.

    Its lag lets it go a fraction 1 - exp(-time_step / lag) of the way, within rate and limits.
    """
    aim = wanted if lag_factor == 1.0 else fma(lag_factor, wanted - present, present)
    return clip(clip(aim, present - rate, present + rate), low, high)


@borrowing_kernel
def score(task, lanes, rewards, first, last):
    """Subtract the state's cost from the rewards; return the status."""
    prefer_widest_vectors()
    weights, lost = state_weights(task), False
    for i in span(first, last):
        cost = state_cost(weights, lanes[layout.X1, i], lanes[layout.X2, i], lanes[layout.V1, i])
        reward = rewards[i] - cost
        rewards[i] = reward
        lost |= is_lost(reward)
    return layout.DIVERGED if lost else layout.OK


@borrowing_kernel
def score_derived(task, lanes, rewards, first, last):
    """Subtract the cost of accelerations and of the force between the masses; return the status.

    They are those at the control step's end, which `mm_gym.step.outputs` has derived.
    """
    prefer_widest_vectors()
    carriage = task[layout.WEIGHT_CARRIAGE_ACCELERATION]
    sphere = task[layout.WEIGHT_SPHERE_ACCELERATION]
    coupling, lost = task[layout.WEIGHT_COUPLING_FORCE], False
    for i in span(first, last):
        # Without mass the carriage's is not finite, and has no weight.
        a1 = lanes[layout.CARRIAGE_ACCELERATION, i] if carriage > 0.0 else 0.0
        a2 = lanes[layout.SPHERE_ACCELERATION, i]
        force = lanes[layout.M2, i] * a2  # (2): nothing else accelerates the sphere
        cost = fma(carriage * a1, a1, fma(sphere * a2, a2, coupling * force * force))
        reward = rewards[i] - cost
        rewards[i] = reward
        lost |= is_lost(reward)
    return layout.DIVERGED if lost else layout.OK


@borrowing_kernel
def state_weights(task):
    """Return the weights of x1^2, v1^2 and (x2 - x1)^2."""
    return (
        task[layout.WEIGHT_DISPLACEMENT],
        task[layout.WEIGHT_VELOCITY],
        task[layout.WEIGHT_STROKE],
    )


@borrowing_kernel
def state_cost(weights, x1, x2, v1):
    """Return the cost of a state [-]."""
    wx, wv, ws = weights
    offset = x2 - x1
    return fma(wx * x1, x1, fma(wv * v1, v1, ws * offset * offset))


@borrowing_kernel
def is_lost(reward):
    """Tell whether the state is no longer finite.

    The reward shows it for all weights, because 0 times infinity is NaN.
    """
    return not reward > -np.inf


@borrowing_kernel
def check_termination(task, lanes, ends, first, last):
    """Count a block's step and mark the episodes that it ends; return the status."""
    furthest, rail = task[layout.DISPLACEMENT_LIMIT], task[layout.RAIL_LIMIT]
    now = lanes[layout.NOW, first] + 1.0
    lanes[layout.NOW, first] = now
    ended = now >= lanes[layout.DUE, first]
    if furthest < np.inf or rail < np.inf:
        for i in span(first, last):
            x1 = lanes[layout.X1, i]
            ended |= (abs(x1) > furthest) | (abs(lanes[layout.X2, i] - x1) > rail)
    if not ended:  # the common case
        if ends[layout.MARKED, first]:
            fill(ends, layout.TERMINATED, False, first, last)
            fill(ends, layout.TRUNCATED, False, first, last)
            ends[layout.MARKED, first] = False
        return layout.OK
    ended, steps, due = False, task[layout.STEPS], now + 1.0
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    began = lanes[layout.BEGAN, first:last]
    over, late = ends[layout.TERMINATED, first:last], ends[layout.TRUNCATED, first:last]
    if furthest < np.inf or rail < np.inf:
        for i in range(last - first):
            over[i] = (abs(x1s[i]) > furthest) | (abs(x2s[i] - x1s[i]) > rail)
    else:
        fill(ends, layout.TERMINATED, False, first, last)
    for i in range(last - first):
        late[i] = now - began[i] >= steps
    for i in range(last - first):  # apart: bytes alone fill longer vectors
        ended |= over[i] | late[i]
    if not ends[layout.MARKED, first]:  # else episodes may end in the next step too
        oldest = 0
        for i in range(last - first):  # integers: a maximum of doubles would not vectorise
            oldest = max(oldest, int(now - began[i]))
        due = now - oldest + steps
    lanes[layout.DUE, first] = due
    ends[layout.MARKED, first] = ended
    return layout.ENDED if ended else layout.OK
