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
    controls u. What actuators apply is p_next = kept p + step u.

    Parameters
    ----------
    trajectory
        Four arrays, read: derivatives (steps, s, s + k, lanes) of the motion after a step with
        respect to that before it, and to what is applied; states (steps + 1, s + k, lanes), x1, x2
        [m], v1, v2 [m/s], z [-] if the interface has a state of its own, and what is applied [N,
        -]; controls (steps, k, lanes) [-]; what else the cost squares after each step, (steps, m,
        1 + s + k, lanes): values, and their derivatives with respect to the state then.
    actuators
        (4, k) read: the least and the most that is applied, kept [-] and step [N, -]. Controls are
        also within -1 and 1.
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
    matrices, vectors = np.zeros((4, n, n)), np.zeros((2, n))
    by_control, of_control = np.zeros((2, n, k)), np.zeros((k, 2 * n + k + 4))
    for lane in range(states.shape[2]):
        matrices[:] = 0.0
        vectors[:] = 0.0
        for m in range(controls.shape[0] - 1, -1, -1):
            _add_cost(matrices[0], vectors[0], states, weights, m + 1, lane)
            _add_squares(matrices[0], vectors[0], squared, m, lane)
            _linearise(motion, actuators, matrices[1], by_control[0], m, lane)
            _expand(matrices, vectors[0], by_control, of_control)
            for j in range(k):
                of_control[j, n + j] += 2.0 * effort + stiffness[lane]
                of_control[j, n + k] += 2.0 * effort * controls[m, j, lane]
                _bound(actuators, states, controls, of_control[j, n + k + 1 :], m, j, lane)
            _minimise(of_control, n)
            _hold_limits(actuators, controls, of_control, n, m, lane)
            _step_back(matrices, vectors, of_control)
            for j in range(k):
                change[m, j, lane] = of_control[j, n + k + 3]
                for i in range(n):
                    gain[m, j, i, lane] = of_control[j, n + k + 4 + i]


@borrowing_kernel
def _add_cost(p, q, states, weights, m, lane):
    """Add the state's cost after a step to the quadratic of what is to come."""
    x1, offset, v1 = states[m, 0, lane], states[m, 1, lane] - states[m, 0, lane], states[m, 2, lane]
    wx, wv, ws = 2.0 * weights[0], 2.0 * weights[1], 2.0 * weights[2]
    p[0, 0] += wx + ws
    p[1, 1] += ws
    p[0, 1] -= ws
    p[1, 0] -= ws
    p[2, 2] += wv
    q[0] += wx * x1 - ws * offset
    q[1] += ws * offset
    q[2] += wv * v1


@borrowing_kernel
def _add_squares(p, q, squared, m, lane):
    """Add what else is squared after a step, which is linear about the trajectory."""
    n = p.shape[0]
    for j in range(squared.shape[1]):
        value = squared[m, j, 0, lane]
        for row in range(n):
            slope = 2.0 * squared[m, j, 1 + row, lane]
            q[row] += slope * value
            for column in range(n):
                p[row, column] += slope * squared[m, j, 1 + column, lane]


@borrowing_kernel
def _linearise(motion, actuators, a, b, m, lane):
    """Write the derivatives a (n, n) and b (n, k) of a step, actuators included."""
    s = motion.shape[1]
    for j in range(b.shape[1]):
        kept, step = actuators[2, j], actuators[3, j]
        for row in range(s):
            through = motion[m, row, s + j, lane]
            a[row, s + j], b[row, j] = through * kept, through * step
        a[s + j, s + j], b[s + j, j] = kept, step
    for row in range(s):
        for column in range(s):
            a[row, column] = motion[m, row, column, lane]


@borrowing_kernel
def _expand(matrices, q, by_control, of_control):
    """Write the quadratic of the cost to come over states and controls before a step.

    Of the matrices (4, n, n), the quadratic p after the step and the derivatives a are read, and p
    a is written; of (2, n, k), the derivatives b and p b; q (n,) is the slope after the step. Of
    each control the curvature over the states and over the controls and the slope are written;
    behind them are bounds, change and gains, (k, 2 n + k + 4).
    """
    p, a, pa = matrices[0], matrices[1], matrices[2]
    b, pb = by_control[0], by_control[1]
    n, k = b.shape
    for row in range(n):
        for column in range(n):
            total = 0.0
            for i in range(n):
                total += p[row, i] * a[i, column]
            pa[row, column] = total
        for j in range(k):
            total = 0.0
            for i in range(n):
                total += p[row, i] * b[i, j]
            pb[row, j] = total
    for j in range(k):
        for column in range(n + k + 1):
            of_control[j, column] = 0.0
        for i in range(n):
            for column in range(n):
                of_control[j, column] += b[i, j] * pa[i, column]
            for other in range(k):
                of_control[j, n + other] += b[i, j] * pb[i, other]
            of_control[j, n + k] += b[i, j] * q[i]


@borrowing_kernel
def _bound(actuators, states, controls, bounds, m, j, lane):
    """Write the bounds of a control's change: those of itself and of what is applied."""
    low, high, kept, step = actuators[0, j], actuators[1, j], actuators[2, j], actuators[3, j]
    least, most = -1.0, 1.0
    if kept > 0.0:
        present = kept * states[m, states.shape[1] - controls.shape[1] + j, lane]
        least, most = max(least, (low - present) / step), min(most, (high - present) / step)
    u = controls[m, j, lane]
    bounds[0], bounds[1] = min(least - u, 0.0), max(most - u, 0.0)


@borrowing_kernel
def _minimise(of_control, n):
    """Minimise over the controls' changes within their bounds; write changes and gains.

    A control at a bound has no gains. Of two controls all cases are tried: none at a bound, or one
    of them, while the other is clipped.
    """
    k = of_control.shape[0]
    slope, low, high, change, gain = n + k, n + k + 1, n + k + 2, n + k + 3, n + k + 4
    for j in range(k):
        for i in range(n):
            of_control[j, gain + i] = 0.0
    if k == 1:
        row = of_control[0]
        row[change] = min(max(-row[slope] / row[n], row[low]), row[high])
        _write_gain(row, row[n], n, k)
        return
    one, two = of_control[0], of_control[1]
    determinant = one[n] * two[n + 1] - one[n + 1] * two[n]
    first = (two[slope] * one[n + 1] - one[slope] * two[n + 1]) / determinant
    second = (one[slope] * two[n] - two[slope] * one[n]) / determinant
    if one[low] < first < one[high] and two[low] < second < two[high]:
        one[change], two[change] = first, second
        for i in range(n):
            one[gain + i] = (two[i] * one[n + 1] - one[i] * two[n + 1]) / determinant
            two[gain + i] = (one[i] * two[n] - two[i] * one[n]) / determinant
        return
    best = np.inf
    for j in range(2):
        fixed, free = of_control[j], of_control[1 - j]
        for side in range(2):
            x = fixed[high] if side else fixed[low]
            curvature = free[n + 1 - j]
            y = min(max(-(free[slope] + free[n + j] * x) / curvature, free[low]), free[high])
            cost = fixed[slope] * x + free[slope] * y + fixed[n + 1 - j] * x * y
            cost += 0.5 * fixed[n + j] * x * x + 0.5 * curvature * y * y
            if cost < best:
                best, fixed[change], free[change] = cost, x, y
    for j in range(2):
        _write_gain(of_control[j], of_control[j, n + j], n, k)


@borrowing_kernel
def _write_gain(row, curvature, n, k):
    """Write the gains of a control that is alone in not being at a bound, if it is not."""
    if row[n + k + 1] < row[n + k + 3] < row[n + k + 2]:
        for i in range(n):
            row[n + k + 4 + i] = -row[i] / curvature


@borrowing_kernel
def _hold_limits(actuators, controls, of_control, n, m, lane):
    """Let a change of what is applied be taken back where that is at its limit."""
    k = of_control.shape[0]
    for j in range(k):
        row, kept = of_control[j], actuators[2, j]
        change = row[n + k + 3]
        at_bound = change == row[n + k + 1] or change == row[n + k + 2]
        if kept > 0.0 and at_bound and abs(controls[m, j, lane] + change) < 1.0 - ROUND_OFF:
            row[2 * n + 4 + j] = -kept / actuators[3, j]


@borrowing_kernel
def _step_back(matrices, vectors, of_control):
    """Turn the quadratic of the cost to come after a step into that before it: see `_expand`."""
    a, pa, following = matrices[1], matrices[2], matrices[3]
    n, k = a.shape[0], of_control.shape[0]
    slope, change, gain = n + k, n + k + 3, n + k + 4
    for row in range(n):
        total = 0.0
        for i in range(n):
            total += a[i, row] * vectors[0, i]
        for j in range(k):
            total += of_control[j, row] * of_control[j, change]
            total += of_control[j, gain + row] * of_control[j, slope]
            for i in range(k):
                bent = of_control[j, n + i] * of_control[i, change]
                total += of_control[j, gain + row] * bent
        vectors[1, row] = total
        for column in range(n):
            total = 0.0
            for i in range(n):
                total += a[i, row] * pa[i, column]
            for j in range(k):
                total += of_control[j, gain + row] * of_control[j, column]
                total += of_control[j, row] * of_control[j, gain + column]
                for i in range(k):
                    bent = of_control[j, n + i] * of_control[i, gain + column]
                    total += of_control[j, gain + row] * bent
            following[row, column] = total
    for row in range(n):
        vectors[0, row] = vectors[1, row]
        for column in range(n):
            matrices[0, row, column] = 0.5 * (following[row, column] + following[column, row])
