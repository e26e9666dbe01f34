"""The backward sweep of an optimal-control problem along a trajectory, over lanes.

Gauss-Newton: the motion is linear about the trajectory, the cost quadratic. Tassa, Mansard and
Todorov, *Control-limited differential dynamic programming*, ICRA 2014, section III.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, kernel

ROUND_OFF = 1e-12
"""How close to -1 and 1 a control counts as at its own bound."""


@kernel
def sweep(trajectory, actuators, weights, effort, stiffness, change, gain):
    """Write a change of the controls and its feedback gains, from the last step to the first.

    The cost is the sum of the weighted squares of x1, v1 and offset at each step's end, and of the
    controls u. What actuators apply is p_next = kept p + step u. In a step it goes no further than
    a share of the way to its limits.

    Parameters
    ----------
    trajectory
        Four arrays, read: derivatives (steps, s, s + k, lanes) of the motion after a step with
        respect to that before it, and to what is applied; states (steps + 1, s + k, lanes), x1, x2
        [m], v1, v2 [m/s], z [-] if the interface has a state of its own, and what is applied [N,
        -]; controls (steps, k, lanes) [-]; what else the cost squares after each step, (steps, m,
        1 + s + k, lanes): values, and their derivatives with respect to the state then.
    actuators
        (5, k, lanes) read: the least and the most that is applied, kept [-], step [N, -] and share
        [-]. Controls are also within -1 and 1.
    weights, effort
        (3,) read: of x1**2, v1**2 and offset**2; of the controls' squares.
    stiffness
        (lanes,) read: what is added to the curvature over each control (Levenberg).
    change, gain
        (steps, k, lanes) and (steps, k, s + k, lanes), written: changes of the controls, and more
        per change of the states.
    """
    motion, states, controls, squared = trajectory
    k = controls.shape[1]
    n = motion.shape[1] + k
    # The cost to come after a step, curvature and slope; the step's derivatives over states and
    # controls; the cost over those, and what it has on the way.
    cost, step = np.zeros((n, n + 1)), np.zeros((n, n + k))
    expanded, moved = np.zeros((n + k, n + k + 1)), np.zeros((n, n + k + 1))
    # Of each control the change, behind its changes per change of the states.
    found, bounds = np.zeros((k, n + 1)), np.zeros((k, 2))
    gains, inputs, slope = found[:, :n], expanded[:, n : n + k], expanded[:, n + k :]
    for lane in range(states.shape[2]):
        cost[:] = 0.0
        for m in range(controls.shape[0] - 1, -1, -1):
            _add_cost(cost, states, weights, m + 1, lane)
            _add_squares(cost, squared, m, lane)
            _linearise(motion, actuators, step, m, lane)
            moved[:] = 0.0
            expanded[:] = 0.0
            _add_product(moved, cost[:, :n], step)
            for row in range(n):
                moved[row, n + k] = cost[row, n]
            _add_product(expanded, step.T, moved)
            for j in range(k):
                expanded[n + j, n + j] += 2.0 * effort + stiffness[lane]
                expanded[n + j, n + k] += 2.0 * effort * controls[m, j, lane]
                _bound(actuators, states, controls, bounds[j], m, j, lane)
            _minimise(expanded[n:], bounds, found)
            _hold_limits(actuators, controls, bounds, found, m, lane)
            for j in range(k):
                change[m, j, lane] = found[j, n]
                for i in range(n):
                    gain[m, j, i, lane] = found[j, i]
            _add_product(expanded[:, :n], inputs, gains)
            _add_product(slope, inputs, found[:, n:])
            _add_product(expanded[:n, :n], gains.T, expanded[n:, :n])
            _add_product(slope[:n], gains.T, slope[n:])
            for row in range(n):
                cost[row, n] = slope[row, 0]
                for column in range(n):
                    cost[row, column] = 0.5 * (expanded[row, column] + expanded[column, row])


@borrowing_kernel
def _add_product(total, a, b):
    """Add the product of two matrices to the first columns of another."""
    for row in range(a.shape[0]):
        for column in range(b.shape[1]):
            term = 0.0
            for i in range(b.shape[0]):
                term += a[row, i] * b[i, column]
            total[row, column] += term


@borrowing_kernel
def _add_cost(cost, states, weights, m, lane):
    """Add the state's cost after a step to what is to come."""
    n = cost.shape[0]
    x1, offset, v1 = states[m, 0, lane], states[m, 1, lane] - states[m, 0, lane], states[m, 2, lane]
    wx, wv, ws = 2.0 * weights[0], 2.0 * weights[1], 2.0 * weights[2]
    cost[0, 0] += wx + ws
    cost[1, 1] += ws
    cost[0, 1] -= ws
    cost[1, 0] -= ws
    cost[2, 2] += wv
    cost[0, n] += wx * x1 - ws * offset
    cost[1, n] += ws * offset
    cost[2, n] += wv * v1


@borrowing_kernel
def _add_squares(cost, squared, m, lane):
    """Add what else is squared after a step, which is linear about the trajectory."""
    n = cost.shape[0]
    for j in range(squared.shape[1]):
        value = squared[m, j, 0, lane]
        for row in range(n):
            slope = 2.0 * squared[m, j, 1 + row, lane]
            cost[row, n] += slope * value
            for column in range(n):
                cost[row, column] += slope * squared[m, j, 1 + column, lane]


@borrowing_kernel
def _linearise(motion, actuators, step, m, lane):
    """Write the derivatives of a step over states and controls, actuators included."""
    s, n = motion.shape[1], step.shape[0]
    for row in range(s):
        for column in range(s):
            step[row, column] = motion[m, row, column, lane]
        for j in range(n - s):
            through = motion[m, row, s + j, lane]
            step[row, s + j] = through * actuators[2, j, lane]
            step[row, n + j] = through * actuators[3, j, lane]
    for j in range(n - s):
        step[s + j, s + j], step[s + j, n + j] = actuators[2, j, lane], actuators[3, j, lane]


@borrowing_kernel
def _bound(actuators, states, controls, bounds, m, j, lane):
    """Write the bounds of a control's change: those of itself and of what is applied."""
    low, high, share = actuators[0, j, lane], actuators[1, j, lane], actuators[4, j, lane]
    step, present = actuators[3, j, lane], states[m, states.shape[1] - controls.shape[1] + j, lane]
    least = max(-1.0, share * (low - present) / step)
    most = min(1.0, share * (high - present) / step)
    u = controls[m, j, lane]
    bounds[0], bounds[1] = min(least - u, 0.0), max(most - u, 0.0)


@borrowing_kernel
def _minimise(over, bounds, found):
    """Minimise over the controls' changes within their bounds; write changes and gains.

    A control at a bound has no gains. Of two controls all cases are tried: none at a bound, or one
    of them, while the other is clipped.
    """
    k, n = bounds.shape[0], found.shape[1] - 1
    slope = n + k
    for j in range(k):
        for i in range(n):
            found[j, i] = 0.0
    if k == 1:
        found[0, n] = min(max(-over[0, slope] / over[0, n], bounds[0, 0]), bounds[0, 1])
        _write_gain(over[0], over[0, n], bounds[0], found[0])
        return
    one, two = over[0], over[1]
    determinant = one[n] * two[n + 1] - one[n + 1] * two[n]
    first = (two[slope] * one[n + 1] - one[slope] * two[n + 1]) / determinant
    second = (one[slope] * two[n] - two[slope] * one[n]) / determinant
    if bounds[0, 0] < first < bounds[0, 1] and bounds[1, 0] < second < bounds[1, 1]:
        found[0, n], found[1, n] = first, second
        for i in range(n):
            found[0, i] = (two[i] * one[n + 1] - one[i] * two[n + 1]) / determinant
            found[1, i] = (one[i] * two[n] - two[i] * one[n]) / determinant
        return
    best = np.inf
    for j in range(2):
        fixed, free = over[j], over[1 - j]
        low, high = bounds[1 - j, 0], bounds[1 - j, 1]
        for side in range(2):
            x, curvature = bounds[j, side], free[n + 1 - j]
            y = min(max(-(free[slope] + free[n + j] * x) / curvature, low), high)
            cost = fixed[slope] * x + free[slope] * y + fixed[n + 1 - j] * x * y
            cost += 0.5 * fixed[n + j] * x * x + 0.5 * curvature * y * y
            if cost < best:
                best, found[j, n], found[1 - j, n] = cost, x, y
    for j in range(2):
        _write_gain(over[j], over[j, n + j], bounds[j], found[j])


@borrowing_kernel
def _write_gain(over, curvature, bounds, found):
    """Write the gains of a control that is alone in not being at a bound, if it is not."""
    n = found.shape[0] - 1
    if bounds[0] < found[n] < bounds[1]:
        for i in range(n):
            found[i] = -over[i] / curvature


@borrowing_kernel
def _hold_limits(actuators, controls, bounds, found, m, lane):
    """Let a change of what is applied be taken back where that is at its limit."""
    k, n = bounds.shape[0], found.shape[1] - 1
    for j in range(k):
        change = found[j, n]
        at_bound = change == bounds[j, 0] or change == bounds[j, 1]
        if at_bound and abs(controls[m, j, lane] + change) < 1.0 - ROUND_OFF:
            found[j, n - k + j] = -actuators[4, j, lane] / actuators[3, j, lane]
