"""Adaptive Taylor series for every plant (Jorba and Zou, Experimental Mathematics 14, 2005).

The field is polynomial but for the finite stretch, a quotient, so the series follows from
recurrences: Cauchy products for the cubic spring, division for the neo-Hookean pair. Its order
follows from the tolerance, each step from its last terms. With dry friction the first exit of
the slip velocity from its regime is found on the series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma, span
from mm_gym.kernels.friction import NONE, excite, first_exit, sign_of
from mm_gym.kernels.jit import borrowing_kernel, inlined_kernel, kernel

# Slots of the model.
ORDER, TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE = (at.MODEL_OWN + i for i in range(5))

FEWEST = 8
"""Lowest order of a series."""

MOST_STEPS = 20_000
"""Series in one control step before giving up: some 0.01 s of work."""

_LOG_ZERO = -1.0e5  # what stands for the logarithm of zero
_ROUND_OFF = 2.0**-54
_FLOOR = 20.0  # binary digits between the velocities down to which the smaller one is resolved
_SAFETY = 0.9  # the logarithm that steps follow from is 6 % coarse

# Rows of the series in one array, WIDTH apart; the first eight are those of kernels/friction.py.
WIDTH = 32
_X1, _X2, _V1, _V2, _OFFSET, _W, _FORCE, _GROUND = (WIDTH * k for k in range(8))
_SQUARE, _LONG, _SHORT, _LONG_POWER, _SHORT_POWER, _SCALED, _SHARE = (
    WIDTH * k for k in range(8, 15)
)

# Unsigned: an index that might be negative costs a comparison.
_ONE, _SQUARES = np.uintp(1), np.uintp(_SQUARE)

# Behind them the state (x1, x2, v1, v2, w) and the coefficients of a lane. One array: handing over
# many costs time.
_STATE = WIDTH * 15
BY_M1, BY_M2, _K1, _BETA, _D, _K2, _K0, _L0, _STRETCH, _U, _C, _CHI, _SLIP_FORCE, _VR, SIZE = (
    _STATE + 5 + k for k in range(15)
)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step; force and stretch are held over it."""
    status = at.OK
    c = np.zeros(SIZE)
    for n in range(int(model[ORDER])):
        c[_SHARE + n] = 1.0 / (n + 1.0)
    for i in range(first, last):
        coefficients(lanes, i, model[HAS_FRICTION] > 0.0, c)
        status = max(status, _propagate_lane(model, lanes, i, c))
    return status


@borrowing_kernel
def coefficients(lanes, i, friction, c):
    """Write what the equations of lane i need."""
    mu1, mu2, vr = lanes[at.MU1, i], lanes[at.MU2, i], lanes[at.VR, i]
    normal, stretch, k0 = lanes[at.FN, i], lanes[at.STRETCH, i], lanes[at.K0, i]
    c[BY_M1], c[BY_M2] = 1.0 / lanes[at.M1, i], 1.0 / lanes[at.M2, i]
    c[_D], c[_C] = lanes[at.D, i], lanes[at.C, i]
    c[_K1], c[_BETA] = lanes[at.K1, i] * lanes[at.ALPHA, i], lanes[at.K1, i] * lanes[at.BETA, i]
    c[_K0], c[_L0], c[_STRETCH], c[_U] = k0, lanes[at.L0, i], stretch, lanes[at.FORCE, i]
    # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
    c[_K2] = 2.0 * k0 * (1.0 + 2.0 / (stretch * stretch * stretch)) if k0 > 0.0 else 0.0
    c[_VR], c[_CHI] = np.inf, 0.0
    if friction:
        c[_VR], c[_CHI], c[_C] = vr, lanes[at.CHI, i], mu1 * normal / vr
        c[_SLIP_FORCE] = mu2 * normal - c[_CHI] * vr


@borrowing_kernel
def interface_and_springs(c, offset, w, finite):
    """Return the force on the carriage from a viscous interface and the springs between the masses.

    See docs/model.md.
    """
    if not finite:
        return c[_C] * w + c[_K2] * offset
    long, short = c[_STRETCH] + offset / c[_L0], c[_STRETCH] - offset / c[_L0]
    pair = (long - 1.0 / (long * long)) - (short - 1.0 / (short * short))
    return c[_C] * w + c[_K0] * c[_L0] * pair


@borrowing_kernel
def outer_forces(c, x1, v1):
    """Return the resistance of the carriage's spring and damper less the held force."""
    return (c[_K1] + c[_BETA] * x1 * x1) * x1 + c[_D] * v1 - c[_U]


@borrowing_kernel
def _propagate_lane(model, lanes, i, c):
    """Advance one lane, series by series."""
    most, tolerance, duration = int(model[ORDER]), model[TOLERANCE], model[at.TIME_STEP]
    cubic, finite, friction, vr = (
        model[IS_CUBIC] > 0.0,
        model[IS_FINITE] > 0.0,
        model[HAS_FRICTION] > 0.0,
        c[_VR],
    )
    for row in range(4):
        c[_STATE + row] = lanes[row, i]
    w = c[_STATE + 4] = lanes[at.V2, i] - lanes[at.V1, i]
    regime = sign_of(vr, w)
    upper, lower = vr - w, vr + w  # how far the slip velocity is below v_r and above -v_r
    elapsed = 0.0
    unit = (
        duration  # the series' unit of time: about the length of a step, so that no term overflows
    )
    for _ in range(MOST_STEPS):
        excite(c, WIDTH, model, lanes, i, elapsed, unit, most)
        remaining = (duration - elapsed) / unit
        # Each series may use the share of the tolerance that it takes of the step: errors add up.
        share = max(tolerance * unit / duration, _ROUND_OFF)
        enough = share if remaining == 1.0 else -1.0
        order = _expand(c, cubic, finite, friction, regime, unit, most, enough)
        if order < FEWEST:
            return at.COLLAPSED
        theta = 1.0 if order < most else min(_step(c, _log2(share), order), remaining)
        direction = 0.0
        if friction:
            exit_at, direction = _exit(c, regime, upper, lower, theta, order)
            theta = theta if exit_at == NONE else theta * exit_at
        if not _evaluate(c, friction, theta, order):
            return at.DIVERGED
        if direction != 0.0:
            regime = direction - regime
            c[_STATE + 4] = direction * vr
            upper, lower = (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)
        else:
            upper, lower = vr - c[_STATE + 4], vr + c[_STATE + 4]
        elapsed += theta * unit
        if (theta == remaining and direction == 0.0) or elapsed >= duration:
            for row in range(4):
                lanes[row, i] = c[_STATE + row]
            return at.OK
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
    return at.TOO_MANY_SERIES


@borrowing_kernel
def _exit(series, regime, upper, lower, theta, order):
    """Return where in the step the regime ends, as a fraction of it, and at which boundary.

    The boundary is 1 or -1; NONE and 0 if the regime does not end.
    """
    power = 1.0
    for n in range(1, order + 1):
        power *= theta
        series[_SCALED + n] = series[_W + n] * power
    if regime != 0.0:
        at_time = first_exit(series, _SCALED, order, -upper if regime > 0.0 else -lower, regime)
        return at_time, 0.0 if at_time == NONE else regime
    up, down = (
        first_exit(series, _SCALED, order, upper, -1.0),
        first_exit(series, _SCALED, order, lower, 1.0),
    )
    if up == NONE and down == NONE:
        return NONE, 0.0
    return (up, 1.0) if up <= down else (down, -1.0)


@borrowing_kernel
def _expand(c, cubic, finite, friction, regime, unit, most, enough):
    """Write the series of the state; return its order, 0 if a spring collapsed.

    Term n is the state's n-th derivative times unit**n / n!. The order is the first at which the
    last terms are below the tolerance `enough` of the velocities, at most `most`, and even: two
    orders are worked out together, because positions follow from the velocities before them, so
    that what depends on positions is known for both.
    """
    x1, x2, v1, v2 = c[_STATE], c[_STATE + 1], c[_STATE + 2], c[_STATE + 3]
    w = c[_STATE + 4]
    # What a loop writes to the array it would read from it again: it keeps its own copies.
    by_m1, by_m2, k1, d, k2, beta = c[BY_M1], c[BY_M2], c[_K1], c[_D], c[_K2], c[_BETA]
    k2 = 0.0 if finite else k2
    damping = c[_C] if regime == 0.0 else c[_CHI]
    held, slip = c[_U], (0.0 if regime == 0.0 else regime * c[_SLIP_FORCE])
    c[_X1], c[_X2], c[_V1], c[_V2], c[_W] = x1, x2, v1, v2, w
    for m in range(most // 2):
        n = m + m
        step, next_step = unit * c[_SHARE + n], unit * c[_SHARE + n + 1]
        next_x1, next_x2 = step * v1, step * v2
        c[_X1 + n + 1], c[_X2 + n + 1] = next_x1, next_x2
        cube = next_cube = 0.0
        if cubic:
            cube, next_cube = _cubes(c, m, x1, next_x1)
        pair, next_pair = k2 * (x2 - x1), k2 * (next_x2 - next_x1)
        if finite:
            if not (_stretch(c, n) and _stretch(c, n + 1)):
                return 0
            pair, next_pair = _pair(c, n), _pair(c, n + 1)
        inner, outer = pair + slip, fma(k1, x1, fma(beta, cube, -held))
        v1, v2, w = _accelerate(
            c, n, step, by_m1, by_m2, d, damping, inner, outer, v1, v2, w, friction
        )
        x1, x2, outer = next_step * v1, next_step * v2, fma(k1, next_x1, beta * next_cube)
        v1, v2, w = _accelerate(
            c, n + 1, next_step, by_m1, by_m2, d, damping, next_pair, outer, v1, v2, w, friction
        )
        c[_X1 + n + 2], c[_X2 + n + 2] = x1, x2
        held = slip = 0.0
        if enough > 0.0 and n + 2 >= FEWEST and _is_enough(c, n + 2, enough):
            return n + 2
    return most


@inlined_kernel
def _is_enough(c, order, enough):
    """Tell whether the last terms of both velocities are below a tolerance of their scale.

    As `_step`, at a step of one unit.
    """
    scale1 = max(abs(c[_V1]), abs(c[_V1 + 1]), abs(c[_V1 + 2]))
    scale2 = max(abs(c[_V2]), abs(c[_V2 + 1]), abs(c[_V2 + 2]))
    both, last1, last2 = 2.0**-_FLOOR * max(scale1, scale2), 0.0, 0.0
    for n in range(order - 3, order + 1):
        last1, last2 = max(last1, abs(c[_V1 + n])), max(last2, abs(c[_V2 + n]))
    return last1 <= enough * max(scale1, both) and last2 <= enough * max(scale2, both)


@inlined_kernel
def _accelerate(c, n, step, by_m1, by_m2, d, damping, inner, outer, v1, v2, w, friction):
    """Write and return term n + 1 of the velocities, given term n and the forces.

    Those are what the springs between the masses, and the carriage's, add.
    """
    outer -= c[_FORCE + n]
    if friction:
        # Near a stiff stick the digits of v2 - v1 would cancel, so w has a series of its own.
        creep, outer = damping * w, outer + d * v1
        v1 = step * ((creep + inner - outer) * by_m1 - c[_GROUND + n])
        v2 = step * (-(creep + inner) * by_m2 - c[_GROUND + n])
        w = step * (outer * by_m1 - (inner + creep) * (by_m1 + by_m2))
        c[_W + n + 1] = w
    else:
        # Each term waits for the velocities, and for nothing else: they come last.
        on1 = fma(inner - outer, by_m1, -c[_GROUND + n])
        on2 = fma(-inner, by_m2, -c[_GROUND + n])
        slip = v2 - v1
        v1 = step * fma(-(damping + d) * by_m1, v1, fma(damping * by_m1, v2, on1))
        v2 = step * fma(-damping * by_m2, slip, on2)
    c[_V1 + n + 1], c[_V2 + n + 1] = v1, v2
    return v1, v2, w


@inlined_kernel
def _pair(c, n):
    """Return term n of the force of the springs of finite stretch."""
    offset = c[_X2 + n] - c[_X1 + n]
    return c[_K0] * fma(2.0, offset, c[_L0] * (c[_SHORT_POWER + n] - c[_LONG_POWER + n]))


@inlined_kernel
def _cubes(c, m, newest, next_newest):
    """Return terms 2 m and 2 m + 1 of x1**3, and write those of x1**2, given those of x1.

    Products are summed from the middle outwards, because the newest terms are the last to be known;
    those of the square come in equal pairs.
    """
    n = m + m
    first = c[_X1]
    if m == 0:
        square = c[_SQUARE] = first * first
        c[_SQUARE + 1] = 2.0 * first * next_newest
        return square * first, 3.0 * square * next_newest
    middle, following, below = c[_X1 + m], c[_X1 + m + 1], c[_SQUARE + m]
    square, next_square = 0.5 * middle * middle, middle * following
    cube, next_cube = below * middle, below * following
    other = next_other = 0.0
    for j in span(1, m):
        low, high = np.uintp(m) - j, np.uintp(m) + j
        x, far, farther = c[low], c[high], c[high + _ONE]  # of x1: its row is the first
        below, above = c[_SQUARES + low], c[_SQUARES + high]
        square, next_square = fma(x, far, square), fma(x, farther, next_square)
        cube, next_cube = fma(below, far, cube), fma(below, farther, next_cube)
        other, next_other = fma(above, x, other), fma(above, c[low + _ONE], next_other)
    square = 2.0 * fma(first, newest, square)
    next_square = 2.0 * fma(first, next_newest, next_square)
    c[_SQUARE + n], c[_SQUARE + n + 1] = square, next_square
    below = c[_SQUARE]
    cube = fma(below, newest, cube) + fma(square, first, other)
    next_other = fma(next_square, first, fma(square, c[_X1 + 1], next_other))
    return cube, fma(below, next_newest, next_cube) + next_other


@borrowing_kernel
def _stretch(c, n):
    """Write term n of both sides' stretch l and of u = l**-2; False if collapsed.

    From n l0 u_n = -sum (n + j) l_j u_(n-j).
    """
    for side in range(2):
        stretch, power = _LONG + side * WIDTH, _LONG_POWER + side * WIDTH
        c[stretch + n] = (1.0 - 2.0 * side) * (c[_X2 + n] - c[_X1 + n]) / c[_L0]
        if n == 0:
            c[stretch] += c[_STRETCH]
            if not c[stretch] > 0.0:
                return False
            c[power] = 1.0 / (c[stretch] * c[stretch])
        else:
            total = 0.0
            for j in range(1, n + 1):
                total -= (n + j) * c[stretch + j] * c[power + n - j]
            c[power + n] = total / (n * c[stretch])
    return True


@borrowing_kernel
def _log2(x):
    """Return log2 of a magnitude, at most 0.09 too small: its bits read as an integer."""
    return np.float64(abs(x)).view(np.int64) * 2.0**-52 - 1023.0 if x != 0.0 else _LOG_ZERO


@borrowing_kernel
def _exp2(y):
    """Return 2**y, at most 6 % too large."""
    return np.int64((min(max(y, -1000.0), 1000.0) + 1023.0) * 2.0**52).view(np.float64)


@borrowing_kernel
def _step(c, log_tolerance, order):
    """Return the step at which the last terms fall below the tolerance, in units of the series.

    Four of them: where only the cubic spring acts, every fourth alone differs from zero.

    Each velocity is judged by its own scale, down to 1e-6 of the other's: a fast sphere that
    nothing joins to the carriage must not hide the carriage's motion.
    """
    one0, one1, one2 = _log2(c[_V1]), _log2(c[_V1 + 1]), _log2(c[_V1 + 2])
    two0, two1, two2 = _log2(c[_V2]), _log2(c[_V2 + 1]), _log2(c[_V2 + 2])
    step1 = _step_of(
        c,
        _V1,
        log_tolerance + max(one0, two0 - _FLOOR),
        log_tolerance + max(one1, two1 - _FLOOR),
        log_tolerance + max(one2, two2 - _FLOOR),
        order,
    )
    step2 = _step_of(
        c,
        _V2,
        log_tolerance + max(two0, one0 - _FLOOR),
        log_tolerance + max(two1, one1 - _FLOOR),
        log_tolerance + max(two2, one2 - _FLOOR),
        order,
    )
    return _SAFETY * _exp2(min(step1, step2))


@inlined_kernel
def _step_of(c, row, lead0, lead1, lead2, order):
    """Return the logarithm of the step for one velocity, from what its last four terms may reach.

    Of the leading terms the one that allows most counts: at rest or at a turning point the first is
    zero.
    """
    shortest = 1000.0
    for n in range(order - 3, order + 1):
        last = _log2(c[row + n])
        first, second, third = c[_SHARE + n - 1], c[_SHARE + n - 2], c[_SHARE + n - 3]
        step = max((lead0 - last) * first, (lead1 - last) * second, (lead2 - last) * third)
        shortest = min(shortest, step if last > _LOG_ZERO else 1000.0)
    return shortest


@borrowing_kernel
def _evaluate(c, friction, theta, order):
    """Advance the state by a time in units of the series; tell whether it is still finite."""
    x1 = x2 = v1 = v2 = w = 0.0
    for n in range(order, 0, -1):
        x1, x2 = fma(x1, theta, c[_X1 + n]), fma(x2, theta, c[_X2 + n])
        v1, v2 = fma(v1, theta, c[_V1 + n]), fma(v2, theta, c[_V2 + n])
        if friction:
            w = fma(w, theta, c[_W + n])
    c[_STATE] = fma(x1, theta, c[_STATE])
    c[_STATE + 1] = fma(x2, theta, c[_STATE + 1])
    c[_STATE + 2] = fma(v1, theta, c[_STATE + 2])
    c[_STATE + 3] = fma(v2, theta, c[_STATE + 3])
    c[_STATE + 4] = fma(w, theta, c[_STATE + 4]) if friction else c[_STATE + 3] - c[_STATE + 2]
    return abs(c[_STATE]) + abs(c[_STATE + 1]) + abs(c[_STATE + 2]) + abs(c[_STATE + 3]) < np.inf
