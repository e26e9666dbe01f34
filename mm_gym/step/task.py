"""The task in a control step: commands to the actuators, the reward, the end of an episode.

Each kernel works on the lanes first .. last - 1. The innermost loops run over lanes, without calls
or early exits, so that the compiler vectorises them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import clip, fma, prefer_widest_vectors
from mm_gym.lanes.elementary import exponential
from mm_gym.lanes.memory import copy_row, fill, span

LOW, HIGH, RATE, IS_RATE, LAG_FACTOR = 1, 2, 3, 4, 5
"""Slots of an actuated parameter, behind `HAS_STRETCH` or `HAS_DAMPING`."""


@borrowing_kernel
def task_and_model(constants):
    """Return the constants of the task and those of the model, which stand behind one another.

    They are one array where Python calls, because every argument adds call overhead.
    """
    behind = at.CHANNELS + at.CHANNEL_SIZE * int(constants[at.CHANNEL_COUNT])
    return constants, constants[behind:]


@borrowing_kernel
def finite(actions):
    """Tell whether all actions are finite."""
    prefer_widest_vectors()
    wrong = False
    for i in range(actions.shape[0]):
        wrong |= not abs(actions[i]) < np.inf
    return not wrong


@borrowing_kernel
def command(task, lanes, actions, rewards, first, last):
    """Apply actions: set what actuators hold, and begin the rewards with the actions' cost.

    Parameters
    ----------
    task
        (t,) float64, read.
    lanes
        (rows, lanes) float64; force [N], stretch and damping [N s/m] are written.
    actions
        (actuators * lanes,) float32 or float64, read: those of the force, of the stretch, then of
        the damping; clipped to [-1, 1].
    rewards
        (lanes,) float64, written.
    first, last
        The lanes first .. last - 1.
    """
    has_force, has_stretch = task[at.HAS_FORCE] > 0.0, task[at.HAS_STRETCH] > 0.0
    has_damping, next_one = task[at.HAS_DAMPING] > 0.0, 0
    count = actions.shape[0] // max(int(has_force) + int(has_stretch) + int(has_damping), 1)
    if has_force:
        push(task, lanes, actions, rewards, first, last)
        next_one += count
    if has_stretch:
        tune(task, lanes, STRETCH, actions[next_one:], rewards, has_force, first, last)
        next_one += count
    if has_damping:
        begun = has_force or has_stretch
        tune(task, lanes, DAMPING, actions[next_one:], rewards, begun, first, last)
    elif not (has_force or has_stretch):
        for i in span(first, last):
            rewards[i] = 0.0


STRETCH = at.HAS_STRETCH, at.STRETCH, at.STRETCH_ASKED, at.STRETCH_ROW
DAMPING = at.HAS_DAMPING, at.DAMPING, at.DAMPING_ASKED, at.DAMPING_ROW
"""Of an actuated parameter: its first slot of the task, its row, that of what is asked, and the
slot of the first row of a lane's own actuator."""


@borrowing_kernel
def hold(model, lanes, first, last):
    """Let a damper have the damping [N s/m] that its actuator holds."""
    damped = int(model[at.DAMPED])
    if damped > 0:
        copy_row(lanes, at.DAMPING, damped, first, last)


@borrowing_kernel
def push(task, lanes, actions, rewards, first, last):
    """Apply a force [N] and begin the rewards with the cost of its action."""
    prefer_widest_vectors()
    limit, rate, weight = task[at.FORCE_LIMIT], task[at.FORCE_RATE], task[at.WEIGHT_EFFORT]
    lag_factor, own = task[at.FORCE_LAG_FACTOR], int(task[at.FORCE_ROW])
    is_rate = task[at.FORCE_IS_RATE] > 0.0
    if own > 0:
        rows, limits = (at.FORCE, at.FORCE_ASKED, own), (-limit, limit)
        move_own(lanes, rows, limits, actions, is_rate, first, last)
        for i in span(first, last):
            a = clip(actions[i], -1.0, 1.0)
            rewards[i] = 0.0 - weight * a * a
    elif is_rate:
        integrate(lanes, at.FORCE_ASKED, actions, rate, -limit, limit, first, last)
        for i in span(first, last):
            a, present, wanted = (
                clip(actions[i], -1.0, 1.0),
                lanes[at.FORCE, i],
                lanes[at.FORCE_ASKED, i],
            )
            lanes[at.FORCE, i] = approach(present, wanted, lag_factor, rate, -limit, limit)
            rewards[i] = 0.0 - weight * a * a
    elif is_at_once(rate, lag_factor):
        for i in span(first, last):
            a = clip(actions[i], -1.0, 1.0)
            lanes[at.FORCE, i] = limit * a
            rewards[i] = 0.0 - weight * a * a
    else:
        for i in span(first, last):
            a, present = clip(actions[i], -1.0, 1.0), lanes[at.FORCE, i]
            lanes[at.FORCE, i] = approach(present, limit * a, lag_factor, rate, -limit, limit)
            rewards[i] = 0.0 - weight * a * a


@borrowing_kernel
def tune(task, lanes, actuator, asked, rewards, begun, first, last):
    """Set an actuated parameter and subtract the cost of its action from the rewards.

    Parameters
    ----------
    task
        (t,) float64, read.
    lanes
        (rows, lanes) float64; the parameter is written.
    actuator
        `STRETCH` or `DAMPING`.
    asked
        (lanes,) float32 or float64, read: the actions; clipped to [-1, 1].
    rewards
        (lanes,) float64, written.
    begun
        Whether the rewards hold the cost of another action already, or nothing yet.
    first, last
        The lanes first .. last - 1.
    """
    prefer_widest_vectors()
    (slot, row, row_asked, slot_own), weight = actuator, task[at.WEIGHT_EFFORT]
    low, high, rate = task[slot + LOW], task[slot + HIGH], task[slot + RATE]
    lag_factor, middle, half = task[slot + LAG_FACTOR], 0.5 * (high + low), 0.5 * (high - low)
    is_rate, own = task[slot + IS_RATE] > 0.0, int(task[slot_own])
    if own > 0:
        rows, limits = (row, row_asked, own), (low, high)
        move_own(lanes, rows, limits, asked, is_rate, first, last)
        for i in span(first, last):
            a = clip(asked[i], -1.0, 1.0)
            rewards[i] = (rewards[i] if begun else 0.0) - weight * a * a
    elif is_rate:
        integrate(lanes, row_asked, asked, rate, low, high, first, last)
        for i in span(first, last):
            a, present, wanted = (
                clip(asked[i], -1.0, 1.0),
                lanes[row, i],
                lanes[row_asked, i],
            )
            lanes[row, i] = approach(present, wanted, lag_factor, rate, low, high)
            rewards[i] = (rewards[i] if begun else 0.0) - weight * a * a
    else:
        for i in span(first, last):
            a, present = clip(asked[i], -1.0, 1.0), lanes[row, i]
            lanes[row, i] = approach(present, middle + half * a, lag_factor, rate, low, high)
            rewards[i] = (rewards[i] if begun else 0.0) - weight * a * a


@borrowing_kernel
def move_own(lanes, rows, limits, actions, is_rate, first, last):
    """Move actuators, each with the lag and the rate limit of its lane.

    Parameters
    ----------
    lanes
        (rows, lanes) float64; what is applied, and asked if by rate, is written.
    rows
        Rows of what it applies and of what it is asked for, and the first of its own.
    limits
        Least and largest value.
    actions
        (lanes,) float32 or float64, read; clipped to [-1, 1].
    is_rate
        Whether an action commands a rate.
    first, last
        The lanes first .. last - 1.
    """
    (row, row_asked, own), (low, high) = rows, limits
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    for i in span(first, last):
        a, travel = clip(actions[i], -1.0, 1.0), lanes[own + at.TRAVEL, i]
        if is_rate:
            wanted = clip(lanes[row_asked, i] + travel * a, low, high)
            lanes[row_asked, i] = wanted
        else:
            wanted = middle + half * a
        lag_factor = lanes[own + at.LAG_FACTOR, i]
        lanes[row, i] = approach(lanes[row, i], wanted, lag_factor, travel, low, high)


@borrowing_kernel
def begin_own(task, lanes, which):
    """Write what follows from the lag and rate limit of each lane listed, in a control step."""
    for slot in (at.FORCE_ROW, at.STRETCH_ROW, at.DAMPING_ROW):
        own = int(task[slot])
        if own > 0:
            for i in which:
                lag = lanes[own + at.LAG, i]
                share = 1.0 if lag == 0.0 else part_of_way(task[at.TIME_STEP] / lag)
                lanes[own + at.LAG_FACTOR, i] = share
                lanes[own + at.TRAVEL, i] = lanes[own + at.RATE_LIMIT, i] * task[at.TIME_STEP]


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
def integrate(lanes, row, actions, rate, low, high, first, last):
    """Integrate the rates that actions command, within the actuator's limits.

    Parameters
    ----------
    lanes
        (rows, lanes) float64; the row is written.
    row
        `FORCE_ASKED`, `STRETCH_ASKED` or `DAMPING_ASKED`: the values commanded so far.
    actions
        (lanes,) float32 or float64, read; clipped to [-1, 1].
    rate
        What an action of 1 adds in a control step.
    low, high
        The actuator's limits.
    first, last
        The lanes first .. last - 1.
    """
    for i in span(first, last):
        lanes[row, i] = clip(lanes[row, i] + rate * clip(actions[i], -1.0, 1.0), low, high)


@borrowing_kernel
def approach(present, wanted, lag_factor, rate, low, high):
    """Return what an actuator reaches in a control step [N], [-] or [N s/m].

    Parameters
    ----------
    present, wanted
        What it has and what it is commanded.
    lag_factor
        Fraction of the way that its lag lets it go, 1 - exp(-time_step / lag).
    rate
        Largest change in a control step.
    low, high
        Its limits.
    """
    aim = wanted if lag_factor == 1.0 else fma(lag_factor, wanted - present, present)
    return clip(clip(aim, present - rate, present + rate), low, high)


@borrowing_kernel
def score(task, lanes, rewards, first, last):
    """Subtract the state's cost from the rewards; return the status."""
    prefer_widest_vectors()
    weights, lost = state_weights(task), False
    for i in span(first, last):
        cost = state_cost(weights, lanes[at.X1, i], lanes[at.X2, i], lanes[at.V1, i])
        reward = rewards[i] - cost
        rewards[i] = reward
        lost |= is_lost(reward)
    return at.DIVERGED if lost else at.OK


@borrowing_kernel
def score_derived(task, lanes, rewards, first, last):
    """Subtract the cost of accelerations and of the force between the masses; return the status.

    They are those at the control step's end, which `mm_gym.step.outputs` has derived.
    """
    prefer_widest_vectors()
    carriage, sphere = task[at.WEIGHT_CARRIAGE_ACCELERATION], task[at.WEIGHT_SPHERE_ACCELERATION]
    coupling, lost = task[at.WEIGHT_COUPLING_FORCE], False
    for i in span(first, last):
        # Without mass the carriage's is not finite, and has no weight.
        a1 = lanes[at.CARRIAGE_ACCELERATION, i] if carriage > 0.0 else 0.0
        a2 = lanes[at.SPHERE_ACCELERATION, i]
        force = lanes[at.M2, i] * a2  # (2) of docs/model.md: nothing else accelerates the sphere
        cost = fma(carriage * a1, a1, fma(sphere * a2, a2, coupling * force * force))
        reward = rewards[i] - cost
        rewards[i] = reward
        lost |= is_lost(reward)
    return at.DIVERGED if lost else at.OK


@borrowing_kernel
def state_weights(task):
    """Return the weights of x1^2, v1^2 and (x2 - x1)^2."""
    return task[at.WEIGHT_DISPLACEMENT], task[at.WEIGHT_VELOCITY], task[at.WEIGHT_STROKE]


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
    """Count a block's step and mark the episodes that it ends; return the status.

    Parameters
    ----------
    task
        (t,) float64, read.
    lanes
        (rows, lanes) float64; state and start are read, the block's clock is written.
    ends
        (3, lanes) bool, written: terminated, truncated, and whether one of the block is marked.
    first, last
        The lanes first .. last - 1, of one block.
    """
    furthest, rail = task[at.DISPLACEMENT_LIMIT], task[at.RAIL_LIMIT]
    now = lanes[at.NOW, first] + 1.0
    lanes[at.NOW, first] = now
    ended = now >= lanes[at.DUE, first]
    if furthest < np.inf or rail < np.inf:
        for i in span(first, last):
            x1 = lanes[at.X1, i]
            ended |= (abs(x1) > furthest) | (abs(lanes[at.X2, i] - x1) > rail)
    if not ended:  # the common case
        if ends[at.MARKED, first]:
            fill(ends, at.TERMINATED, False, first, last)
            fill(ends, at.TRUNCATED, False, first, last)
            ends[at.MARKED, first] = False
        return at.OK
    ended, steps, due = False, task[at.STEPS], now + 1.0
    x1s, x2s, began = (
        lanes[at.X1, first:last],
        lanes[at.X2, first:last],
        lanes[at.BEGAN, first:last],
    )
    over, late = ends[at.TERMINATED, first:last], ends[at.TRUNCATED, first:last]
    if furthest < np.inf or rail < np.inf:
        for i in range(last - first):
            over[i] = (abs(x1s[i]) > furthest) | (abs(x2s[i] - x1s[i]) > rail)
    else:
        fill(ends, at.TERMINATED, False, first, last)
    for i in range(last - first):
        late[i] = now - began[i] >= steps
    for i in range(last - first):  # apart: bytes alone fill longer vectors
        ended |= over[i] | late[i]
    if not ends[at.MARKED, first]:  # else episodes may end in the next step too
        oldest = 0
        for i in range(last - first):  # integers: a maximum of doubles would not vectorise
            oldest = max(oldest, int(now - began[i]))
        due = now - oldest + steps
    lanes[at.DUE, first] = due
    ends[at.MARKED, first] = ended
    return at.ENDED if ended else at.OK
