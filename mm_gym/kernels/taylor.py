"""Adaptive Taylor series for every plant (Jorba and Zou, Experimental Mathematics 14, 2005).

The field is polynomial but for the finite stretch, a quotient, so the series follows from
recurrences: Cauchy products for the cubic spring, division for the neo-Hookean pair. Its order
follows from the tolerance, each step from its last two terms. With dry friction the first exit of
the slip velocity from its regime is found on the series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.friction import NONE, excite, first_exit, sign_of
from mm_gym.kernels.jit import kernel

# Slots of the model.
ORDER, LOG_TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE = (at.MODEL_OWN + i for i in range(5))

MOST_STEPS = 20_000
"""Series in one control step before giving up: some 0.01 s of work."""

_LOG_ZERO = -1.0e5  # what stands for the logarithm of zero
_SAFETY = 0.9  # the logarithm that steps follow from is 6 % coarse

# Rows of the series in one array, WIDTH apart; the first eight are those of kernels/friction.py.
WIDTH = 32
_X1, _X2, _V1, _V2, _OFFSET, _W, _FORCE, _GROUND = (WIDTH * k for k in range(8))
_SQUARE, _LONG, _SHORT, _LONG_POWER, _SHORT_POWER, _SCALED, _SHARE = (
    WIDTH * k for k in range(8, 15)
)

# Behind them the state (x1, x2, v1, v2, w) and the coefficients of a lane. One array: handing over
# many costs time.
_STATE = WIDTH * 15
M1, M2, _K1, _BETA, _D, _K2, _K0, _L0, _STRETCH, _U, _C, _CHI, _SLIP_FORCE, _VR, SIZE = range(
    _STATE + 5, _STATE + 20
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


@kernel
def coefficients(lanes, i, friction, c):
    """Write what the equations of lane i need."""
    mu1, mu2, vr = lanes[at.MU1, i], lanes[at.MU2, i], lanes[at.VR, i]
    normal, stretch, k0 = lanes[at.FN, i], lanes[at.STRETCH, i], lanes[at.K0, i]
    c[M1], c[M2], c[_D], c[_C] = lanes[at.M1, i], lanes[at.M2, i], lanes[at.D, i], lanes[at.C, i]
    c[_K1], c[_BETA] = lanes[at.K1, i] * lanes[at.ALPHA, i], lanes[at.K1, i] * lanes[at.BETA, i]
    c[_K0], c[_L0], c[_STRETCH], c[_U] = k0, lanes[at.L0, i], stretch, lanes[at.FORCE, i]
    # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
    c[_K2] = 2.0 * k0 * (1.0 + 2.0 / (stretch * stretch * stretch)) if k0 > 0.0 else 0.0
    c[_VR], c[_CHI] = np.inf, 0.0
    if friction:
        c[_VR], c[_CHI], c[_C] = vr, lanes[at.CHI, i], mu1 * normal / vr
        c[_SLIP_FORCE] = mu2 * normal - c[_CHI] * vr


@kernel
def interface_and_springs(c, offset, w, finite):
    """Return the force on the carriage from a viscous interface and the springs between the masses.

    See docs/model.md.
    """
    if not finite:
        return c[_C] * w + c[_K2] * offset
    long, short = c[_STRETCH] + offset / c[_L0], c[_STRETCH] - offset / c[_L0]
    pair = (long - 1.0 / (long * long)) - (short - 1.0 / (short * short))
    return c[_C] * w + c[_K0] * c[_L0] * pair


@kernel
def outer_forces(c, x1, v1):
    """Return the resistance of the carriage's spring and damper less the held force."""
    return (c[_K1] + c[_BETA] * x1 * x1) * x1 + c[_D] * v1 - c[_U]


@kernel
def _propagate_lane(model, lanes, i, c):
    """Advance one lane, series by series."""
    order, log_tolerance, duration = int(model[ORDER]), model[LOG_TOLERANCE], model[at.TIME_STEP]
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
        excite(c, WIDTH, model, lanes, i, elapsed, unit, order)
        if not _expand(c, cubic, finite, friction, regime, unit, order):
            return at.COLLAPSED
        remaining = (duration - elapsed) / unit
        # Each series may use the share of the tolerance that it takes of the step: errors add up.
        share = _log2(unit) - _log2(duration)
        theta = min(_step(c, log_tolerance + share, order), remaining)
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


@kernel
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


@kernel
def _expand(c, cubic, finite, friction, regime, unit, order):
    """Write the series of the state; False if a spring collapsed.

    Term n is the state's n-th derivative times unit**n / n!.
    """
    by_m1, by_m2, k1, d, k2, beta = 1.0 / c[M1], 1.0 / c[M2], c[_K1], c[_D], c[_K2], c[_BETA]
    damping = c[_C] if regime == 0.0 else c[_CHI]
    held, slip = c[_U], (0.0 if regime == 0.0 else regime * c[_SLIP_FORCE])
    # What the velocities add is kept apart: each term waits for them, and for nothing else.
    from_v1, from_v2, between = -(damping + d) * by_m1, damping * by_m1, damping * by_m2
    c[_X1], c[_X2], c[_V1], c[_V2], c[_W] = (
        c[_STATE],
        c[_STATE + 1],
        c[_STATE + 2],
        c[_STATE + 3],
        c[_STATE + 4],
    )
    for n in range(order):
        x1, x2, v1, v2, step = c[_X1 + n], c[_X2 + n], c[_V1 + n], c[_V2 + n], unit * c[_SHARE + n]
        inner = k2 * (x2 - x1) + slip
        if finite:
            if not _stretch(c, x2 - x1, n):
                return False
            inner = (
                c[_K0] * (2.0 * (x2 - x1) + c[_L0] * (c[_SHORT_POWER + n] - c[_LONG_POWER + n]))
                + slip
            )
        outer = k1 * x1 - c[_FORCE + n] - held
        if cubic:
            c[_SQUARE + n] = _square(c, n)
            outer += beta * _product(c, n)
        held = slip = 0.0
        on1, on2 = (inner - outer) * by_m1 - c[_GROUND + n], -inner * by_m2 - c[_GROUND + n]
        c[_X1 + n + 1], c[_X2 + n + 1] = step * v1, step * v2
        if friction:
            # Near a stiff stick the digits of v2 - v1 would cancel, so w has a series of its own.
            w = c[_W + n]
            c[_W + n + 1] = step * (
                (outer + d * v1) * by_m1 - (inner + damping * w) * (by_m1 + by_m2)
            )
            c[_V1 + n + 1] = step * ((damping * w - d * v1) * by_m1 + on1)
            c[_V2 + n + 1] = step * (on2 - between * w)
        else:
            c[_V1 + n + 1] = step * ((from_v1 * v1 + from_v2 * v2) + on1)
            c[_V2 + n + 1] = step * ((between * v1 - between * v2) + on2)
    return True


@kernel
def _square(c, n):
    """Return term n of x1**2; its products come in equal pairs."""
    half, total = (n + 1) // 2, 0.0
    for j in range(half):
        total += c[_X1 + j] * c[_X1 + n - j]
    total += total
    return total + c[_X1 + half] * c[_X1 + half] if n % 2 == 0 else total


@kernel
def _product(c, n):
    """Return term n of x1**2 x1."""
    total = 0.0
    for j in range(n + 1):
        total += c[_SQUARE + j] * c[_X1 + n - j]
    return total


@kernel
def _stretch(c, offset, n):
    """Write term n of both sides' stretch l and of u = l**-2; False if collapsed.

    From n l0 u_n = -sum (n + j) l_j u_(n-j).
    """
    for side in range(2):
        stretch, power = _LONG + side * WIDTH, _LONG_POWER + side * WIDTH
        c[stretch + n] = (1.0 - 2.0 * side) * offset / c[_L0]
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


@kernel
def _log2(x):
    """Return log2 of a magnitude, at most 0.09 too small: its bits read as an integer."""
    return np.float64(abs(x)).view(np.int64) * 2.0**-52 - 1023.0 if x != 0.0 else _LOG_ZERO


@kernel
def _exp2(y):
    """Return 2**y, at most 6 % too large."""
    return np.int64((min(max(y, -1000.0), 1000.0) + 1023.0) * 2.0**52).view(np.float64)


@kernel
def _step(series, log_tolerance, order):
    """Return the step at which the last two terms fall below the tolerance, in units of the series.

    They are compared with the largest of the leading terms, because at rest or at a turning point
    the first is zero.
    """
    shortest = 1000.0
    lead0, lead1, lead2 = _largest(series, 0), _largest(series, 1), _largest(series, 2)
    for n in range(order - 1, order + 1):
        last = _largest(series, n)
        step = (log_tolerance + lead0 - last) / n
        step = max(step, (log_tolerance + lead1 - last) / (n - 1))
        step = max(step, (log_tolerance + lead2 - last) / (n - 2))
        shortest = min(shortest, step if last > _LOG_ZERO else 1000.0)
    return _SAFETY * _exp2(shortest)


@kernel
def _largest(series, n):
    """Return the logarithm of term n of the velocities, the larger one."""
    return _log2(max(abs(series[_V1 + n]), abs(series[_V2 + n])))


@kernel
def _evaluate(c, friction, theta, order):
    """Advance the state by a time in units of the series; tell whether it is still finite."""
    x1 = x2 = v1 = v2 = w = 0.0
    for k in range(order):
        n = order - k
        x1 = (x1 + c[_X1 + n]) * theta
        x2 = (x2 + c[_X2 + n]) * theta
        v1 = (v1 + c[_V1 + n]) * theta
        v2 = (v2 + c[_V2 + n]) * theta
        if friction:
            w = (w + c[_W + n]) * theta
    c[_STATE] += x1
    c[_STATE + 1] += x2
    c[_STATE + 2] += v1
    c[_STATE + 3] += v2
    c[_STATE + 4] = c[_STATE + 4] + w if friction else c[_STATE + 3] - c[_STATE + 2]
    return abs(c[_STATE]) + abs(c[_STATE + 1]) + abs(c[_STATE + 2]) + abs(c[_STATE + 3]) < np.inf
