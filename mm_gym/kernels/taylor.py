"""Adaptive Taylor series for every plant (Jorba and Zou, Experimental Mathematics 14, 2005).

The field is polynomial but for the finite stretch, a quotient, so the series follows from recurrences: Cauchy products
for the cubic spring, division for the neo-Hookean pair. Its order follows from the tolerance, each step from its last
two terms. With dry friction the first exit of the slip velocity from its regime is found on the series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.friction import NONE, excite, first_exit, sign_of
from mm_gym.kernels.jit import kernel

# Slots of the model.
ORDER, LOG_TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE = (at.MODEL_OWN + i for i in range(5))

MOST_STEPS = 50_000
"""Series in one control step before giving up: some 0.02 s of work."""

_SAFETY = 0.9  # the logarithm that steps follow from is 6 % coarse

# Rows of the series; the first eight are those of kernels/friction.py.
_X1, _X2, _V1, _V2, _OFFSET, _W, _FORCE, _GROUND = range(8)
_SQUARE, _LONG, _SHORT, _LONG_POWER, _SHORT_POWER, _SCALED, _ROWS = range(8, 15)

# Coefficients of a lane.
_M1, _M2, _K1, _BETA, _D, _K2, _K0, _L0, _STRETCH, _U, _C, _CHI, _SLIP_FORCE, _VR, SIZE = range(15)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step; force and stretch are held over it."""
    status = at.OK
    series, p, z = np.empty((_ROWS, int(model[ORDER]) + 1)), np.empty(SIZE), np.empty(5)
    for i in range(first, last):
        coefficients(lanes, i, model[HAS_FRICTION] > 0.0, p)
        status = max(status, _propagate_lane(model, lanes, i, series, p, z))
    return status


@kernel
def coefficients(lanes, i, friction, p):
    """Write what the equations of lane i need."""
    mu1, mu2, vr = lanes[at.MU1, i], lanes[at.MU2, i], lanes[at.VR, i]
    normal, stretch, k0 = lanes[at.FN, i], lanes[at.STRETCH, i], lanes[at.K0, i]
    p[_M1], p[_M2], p[_D], p[_C] = lanes[at.M1, i], lanes[at.M2, i], lanes[at.D, i], lanes[at.C, i]
    p[_K1], p[_BETA] = lanes[at.K1, i] * lanes[at.ALPHA, i], lanes[at.K1, i] * lanes[at.BETA, i]
    p[_K0], p[_L0], p[_STRETCH], p[_U] = k0, lanes[at.L0, i], stretch, lanes[at.FORCE, i]
    # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
    p[_K2] = 2.0 * k0 * (1.0 + 2.0 / (stretch * stretch * stretch)) if k0 > 0.0 else 0.0
    p[_VR], p[_CHI] = np.inf, 0.0
    if friction:
        p[_VR], p[_CHI], p[_C] = vr, lanes[at.CHI, i], mu1 * normal / vr
        p[_SLIP_FORCE] = mu2 * normal - p[_CHI] * vr


@kernel
def interface_and_springs(p, offset, w, finite):
    """Return the force on the carriage from a viscous interface and the springs between the masses (docs/model.md)."""
    if not finite:
        return p[_C] * w + p[_K2] * offset
    long, short = p[_STRETCH] + offset / p[_L0], p[_STRETCH] - offset / p[_L0]
    pair = (long - 1.0 / (long * long)) - (short - 1.0 / (short * short))
    return p[_C] * w + p[_K0] * p[_L0] * pair


@kernel
def outer_forces(p, x1, v1):
    """Return the resistance of the carriage's spring and damper less the held force."""
    return (p[_K1] + p[_BETA] * x1 * x1) * x1 + p[_D] * v1 - p[_U]


@kernel
def _propagate_lane(model, lanes, i, series, p, z):
    """Advance one lane, series by series."""
    order, tones, ground = int(model[ORDER]), int(model[at.TONE_COUNT]), int(model[at.GROUND])
    duration, friction, vr = model[at.TIME_STEP], model[HAS_FRICTION] > 0.0, p[_VR]
    for row in range(4):
        z[row] = lanes[row, i]
    z[4] = z[3] - z[2]
    regime = sign_of(vr, z[4])
    upper, lower = vr - z[4], vr + z[4]  # how far the slip velocity is below v_r and above -v_r
    elapsed = 0.0
    unit = duration  # the series' unit of time: about the length of a step, so that no term overflows
    for _ in range(MOST_STEPS):
        excite(series, lanes, i, tones, ground, elapsed, unit, order)
        if not _expand(model, series, p, z, regime, unit, order):
            return at.COLLAPSED
        remaining = (duration - elapsed) / unit
        theta = min(_step(series, model[LOG_TOLERANCE], order), remaining)
        direction = 0.0
        if friction:
            exit_at, direction = _exit(series, regime, upper, lower, theta, order)
            theta = theta if exit_at == NONE else theta * exit_at
        _evaluate(series, z, theta, order)
        if not abs(z[0]) + abs(z[1]) + abs(z[2]) + abs(z[3]) < np.inf:
            return at.DIVERGED
        upper, lower = vr - z[4], vr + z[4]
        if direction != 0.0:
            regime = direction - regime
            z[4] = direction * vr
            upper, lower = (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)
        elif theta == remaining:
            for row in range(4):
                lanes[row, i] = z[row]
            return at.OK
        elapsed += theta * unit
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
        if unit <= 0.0:
            for row in range(4):
                lanes[row, i] = z[row]
            return at.OK
    return at.STEPS


@kernel
def _exit(series, regime, upper, lower, theta, order):
    """Return where in the step the regime ends, as a fraction of it, and at which boundary (1 or -1); NONE and 0 if not."""
    scaled, w, power = series[_SCALED], series[_W], 1.0
    for n in range(1, order + 1):
        power *= theta
        scaled[n] = w[n] * power
    if regime != 0.0:
        at_time = first_exit(scaled, order, -upper if regime > 0.0 else -lower, regime)
        return at_time, 0.0 if at_time == NONE else regime
    up, down = first_exit(scaled, order, upper, -1.0), first_exit(scaled, order, lower, 1.0)
    if up == NONE and down == NONE:
        return NONE, 0.0
    return (up, 1.0) if up <= down else (down, -1.0)


@kernel
def _expand(model, series, p, z, regime, unit, order):
    """Write the series of the state: term n is its n-th derivative times unit**n / n!. False if a spring collapsed."""
    m1, m2, k1, d, k2, beta = p[_M1], p[_M2], p[_K1], p[_D], p[_K2], p[_BETA]
    cubic, finite = model[IS_CUBIC] > 0.0, model[IS_FINITE] > 0.0
    damping = p[_C] if regime == 0.0 else p[_CHI]
    held, friction = p[_U], (0.0 if regime == 0.0 else regime * p[_SLIP_FORCE])
    x1, x2, v1, v2, w = series[_X1], series[_X2], series[_V1], series[_V2], series[_W]
    offset, force, ground, square = series[_OFFSET], series[_FORCE], series[_GROUND], series[_SQUARE]
    x1[0], x2[0], v1[0], v2[0], w[0], offset[0] = z[0], z[1], z[2], z[3], z[4], z[1] - z[0]
    for n in range(order):
        spring = k2 * offset[n]
        if finite:
            if not _stretch(series, p, n):
                return False
            difference = series[_SHORT_POWER, n] - series[_LONG_POWER, n]
            spring = 2.0 * p[_K0] * offset[n] + p[_K0] * p[_L0] * difference
        inner = damping * w[n] + spring + friction
        outer = k1 * x1[n] + d * v1[n] - force[n] - held
        if cubic:
            square[n] = _product(x1, x1, n)
            outer += beta * _product(square, x1, n)
        held = friction = 0.0
        step = unit / (n + 1.0)
        x1[n + 1], x2[n + 1], offset[n + 1] = step * v1[n], step * v2[n], step * w[n]
        v1[n + 1] = step * ((inner - outer) / m1 - ground[n])
        v2[n + 1] = step * (-inner / m2 - ground[n])
        # Not v2 - v1: near a stiff stick its digits would cancel.
        w[n + 1] = step * (outer / m1 - inner / m1 - inner / m2)
    return True


@kernel
def _product(a, b, n):
    """Return term n of the product of two series; two sums, so that additions need not wait for each other."""
    even = odd = 0.0
    for j in range(0, n, 2):
        even += a[j] * b[n - j]
        odd += a[j + 1] * b[n - j - 1]
    return even + odd if n % 2 == 1 else even + odd + a[n] * b[0]


@kernel
def _stretch(series, p, n):
    """Write term n of both sides' stretch l and of l**-2, from n l0 u_n = -sum (n + j) l_j u_(n-j). False if collapsed."""
    for side in range(2):
        stretch, power = series[_LONG + side], series[_LONG_POWER + side]
        stretch[n] = (1.0 - 2.0 * side) * series[_OFFSET, n] / p[_L0]
        if n == 0:
            stretch[0] += p[_STRETCH]
            if not stretch[0] > 0.0:
                return False
            power[0] = 1.0 / (stretch[0] * stretch[0])
        else:
            total = 0.0
            for j in range(1, n + 1):
                total -= (n + j) * stretch[j] * power[n - j]
            power[n] = total / (n * stretch[0])
    return True


@kernel
def _log2(x):
    """Return the base-2 logarithm of a magnitude, at most 0.09 too small: its bits read as an integer."""
    return np.float64(abs(x)).view(np.int64) * 2.0**-52 - 1023.0 if x != 0.0 else -1.0e5


@kernel
def _exp2(y):
    """Return 2**y, at most 6 % too large."""
    return np.int64((min(max(y, -1000.0), 1000.0) + 1023.0) * 2.0**52).view(np.float64)


@kernel
def _step(series, log_tolerance, order):
    """Return the step at which the last two terms fall below the tolerance, in units of the series.

    They are compared with the largest of the leading terms, because at rest or at a turning point the first is zero.
    """
    shortest = np.inf
    lead0, lead1 = _largest(series, 0), _largest(series, 1)
    lead2 = _largest(series, 2)
    for n in range(order - 1, order + 1):
        last = _largest(series, n)
        step = (log_tolerance + lead0 - last) / n
        step = max(step, (log_tolerance + lead1 - last) / (n - 1))
        step = max(step, (log_tolerance + lead2 - last) / (n - 2))
        shortest = min(shortest, step)
    return _SAFETY * _exp2(shortest)


@kernel
def _largest(series, n):
    """Return the logarithm of term n of the velocities, the larger one."""
    return _log2(max(abs(series[_V1, n]), abs(series[_V2, n])))


@kernel
def _evaluate(series, z, theta, order):
    """Advance the state by a time in units of the series."""
    x1, x2, v1, v2, w = series[_X1], series[_X2], series[_V1], series[_V2], series[_W]
    a = b = c = d = e = 0.0
    for n in range(order, 0, -1):
        a = (a + x1[n]) * theta
        b = (b + x2[n]) * theta
        c = (c + v1[n]) * theta
        d = (d + v2[n]) * theta
        e = (e + w[n]) * theta
    z[0] += a
    z[1] += b
    z[2] += c
    z[3] += d
    z[4] += e
