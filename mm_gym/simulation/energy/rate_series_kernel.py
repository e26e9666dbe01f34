"""What flows in and out of a nonlinear plant: Taylor series of the motion and of the power.

The same integrals as `kernels.power` has for the piecewise linear plants. The series are those of
x1, x2 - x1, v1 and w = v2 - v1, at a fixed high order and with nothing but round-off cut off,
whatever tolerance the plant itself has.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.events import NONE, first_exit, sign_of
from mm_gym.kernels.jets import write_series
from mm_gym.kernels.jit import kernel
from mm_gym.simulation.energy.precise_integration_kernel import damping_of, stiffness_of

ORDER = 24
CUT_OFF = 2.0**-56
"""Size of the last terms relative to the leading ones."""

MOST_SERIES = 1 << 20
"""Series in one control step before giving up."""

# Rows of the series in one array, _WIDTH apart; `write_series` writes the seventh and eighth.
_WIDTH = 32
_X1, _OFFSET, _V1, _W, _INNER, _OUTER, _FORCE, _GROUND = (_WIDTH * k for k in range(8))
_SQUARE, _SHORTENED, _POWER, _SCALED, _LINK, _END = (_WIDTH * k for k in range(8, 14))


@kernel
def step_integrals(p, model, states, applied, jets, times, duration, work):
    """Write energies (steps, 2) [J], dissipated and disturbing, of each step from its own start.

    p (rows,) as `layout` has them, states (steps, 4), applied (steps, 2) and jets (steps, 2 terms)
    at the steps' starts, times (steps,) [s].
    """
    lane, c, z = np.empty((p.shape[0], 1)), np.zeros(_END), np.empty(4)
    for i in range(states.shape[0]):
        for row in range(p.shape[0]):
            lane[row, 0] = p[row]
        lane[at.FORCE, 0], lane[at.STRETCH, 0] = applied[i, 0], applied[i, 1]
        for n in range(jets.shape[1]):
            lane[int(model[at.JETS]) + n, 0] = jets[i, n]
        for j in range(int(model[at.HARMONIC_COUNT])):
            harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
            angle = p[harmonic + at.PHASE] + p[harmonic + at.FREQUENCY] * times[i]
            lane[harmonic + at.COSINE, 0], lane[harmonic + at.SINE, 0] = (
                math.cos(angle),
                math.sin(angle),
            )
        z[0], z[1] = states[i, 0], states[i, 1] - states[i, 0]
        z[2], z[3] = states[i, 2], states[i, 3] - states[i, 2]
        status = _walk(model, lane, c, z, duration, work[i])
        if status != at.OK:
            return status
    return at.OK


@kernel
def _walk(model, lane, c, z, duration, work):
    """Add up both powers over one step, series by series."""
    vr = lane[at.VR, 0] if lane[at.VR, 0] > 0.0 else np.inf
    regime = sign_of(vr, z[3])
    upper, lower = vr - z[3], vr + z[3]  # how far w is below v_r and above -v_r
    elapsed, unit = 0.0, duration
    work[0] = work[1] = 0.0
    for _ in range(MOST_SERIES):
        write_series(c, _WIDTH, model, lane, 0, elapsed, unit, ORDER)
        if not _expand(c, lane, z, regime, unit):
            return at.COLLAPSED
        remaining = (duration - elapsed) / unit
        theta, direction = min(_reach(c), remaining), 0.0
        if vr < np.inf:
            theta, direction = _exit(c, regime, upper, lower, theta)
        _add_work(c, lane, unit, theta, work)
        for k in range(4):
            z[k] += _series(c, k * _WIDTH, theta)
        if direction != 0.0:
            regime, z[3] = direction - regime, direction * vr
            upper, lower = (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)
        else:
            upper, lower = vr - z[3], vr + z[3]
        elapsed += theta * unit
        if (theta == remaining and direction == 0.0) or elapsed >= duration:
            return at.OK
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
    return at.TOO_MANY_SERIES


@kernel
def _expand(c, lane, z, regime, unit):
    """Write the series of state and forces: term n is the n-th derivative times unit**n / n!."""
    m1, m2, d = lane[at.M1, 0], lane[at.M2, 0], lane[at.D, 0]
    k1, beta = lane[at.K1, 0] * lane[at.ALPHA, 0], lane[at.K1, 0] * lane[at.BETA, 0]
    k0, l0, k2 = lane[at.K0, 0], lane[at.L0, 0], stiffness_of(lane[at.K0, 0], lane[at.STRETCH, 0])
    slope = lane[at.CHI, 0] if regime != 0.0 else damping_of(lane[:, 0])
    constant = regime * (lane[at.MU2, 0] * lane[at.FN, 0] - lane[at.CHI, 0] * lane[at.VR, 0])
    held = lane[at.FORCE, 0]
    for k in range(4):
        c[k * _WIDTH] = z[k]
    for n in range(ORDER):
        x1, offset, v1, w = c[_X1 + n], c[_OFFSET + n], c[_V1 + n], c[_W + n]
        c[_LINK + n] = slope * w + constant
        springs = k2 * offset
        if l0 > 0.0:
            if not _stretch(c, lane[at.STRETCH, 0], l0, n):
                return False
            springs = (
                2.0 * k0 * (offset + 2.0 * lane[at.STRETCH, 0] * _product(c, _OFFSET, _POWER, n))
            )
        c[_SQUARE + n] = _product(c, _X1, _X1, n)
        c[_INNER + n] = c[_LINK + n] + springs
        c[_OUTER + n] = (
            d * v1 + k1 * x1 + beta * _product(c, _SQUARE, _X1, n) - c[_FORCE + n] - held
        )
        held = constant = 0.0
        inner, outer, step = c[_INNER + n], c[_OUTER + n], unit / (n + 1.0)
        c[_X1 + n + 1], c[_OFFSET + n + 1] = step * v1, step * w
        c[_V1 + n + 1] = step * ((inner - outer) / m1 - c[_GROUND + n])
        c[_W + n + 1] = step * (outer / m1 - inner * (1.0 / m1 + 1.0 / m2))
    return True


@kernel
def _product(c, a, b, n):
    """Return term n of the product of two rows."""
    total = 0.0
    for j in range(n + 1):
        total += c[a + j] * c[b + n - j]
    return total


@kernel
def _stretch(c, stretch, l0, n):
    """Write term n of q = stretch^2 - (offset / l0)^2 and of u = q^-2.

    From q u' = -2 q' u: n q0 u_n = -sum (n + j) q_j u_(n-j).

    The pair's force is 2 k0 offset (1 + 2 stretch u): no difference of both sides' nearly equal
    stretches. False if a spring has collapsed.
    """
    c[_SHORTENED + n] = -_product(c, _OFFSET, _OFFSET, n) / (l0 * l0)
    if n == 0:
        c[_SHORTENED] += stretch * stretch
        if not c[_SHORTENED] > 0.0:
            return False
        c[_POWER] = 1.0 / (c[_SHORTENED] * c[_SHORTENED])
        return True
    total = 0.0
    for j in range(1, n + 1):
        total -= (n + j) * c[_SHORTENED + j] * c[_POWER + n - j]
    c[_POWER + n] = total / (n * c[_SHORTENED])
    return True


@kernel
def _reach(c):
    """Return the time, in units of the series, up to which it serves: by its last eight terms.

    Of fewer, symmetry could make all zero: begun at rest, a cubic spring leaves one in six.
    """
    lead = 0.0
    for n in range(3):
        lead = max(lead, abs(c[_V1 + n]), abs(c[_W + n]))
    theta = np.inf
    for n in range(ORDER - 7, ORDER + 1):
        last = max(abs(c[_V1 + n]), abs(c[_W + n]))
        if last > 0.0:
            theta = min(theta, (CUT_OFF * lead / last) ** (1.0 / n))
    return theta


@kernel
def _exit(c, regime, upper, lower, theta):
    """Return when the regime ends, at most theta, and at which boundary: 1, -1, or 0 for none."""
    power = 1.0
    for n in range(1, ORDER + 1):
        power *= theta
        c[_SCALED + n] = c[_W + n] * power
    if regime != 0.0:
        gap = -upper if regime > 0.0 else -lower
        at_time = first_exit(c, _SCALED, ORDER, gap, regime)
        return (theta, 0.0) if at_time == NONE else (theta * at_time, regime)
    up, down = first_exit(c, _SCALED, ORDER, upper, -1.0), first_exit(c, _SCALED, ORDER, lower, 1.0)
    if up == NONE and down == NONE:
        return theta, 0.0
    return (theta * up, 1.0) if up <= down else (theta * down, -1.0)


@kernel
def _series(c, row, theta):
    """Return a series without its first term."""
    total = 0.0
    for n in range(ORDER, 0, -1):
        total = (total + c[row + n]) * theta
    return total


@kernel
def _add_work(c, lane, unit, theta, work):
    """Add the integrals of d v1^2 + f w, and of p v1 - a_g (m1 v1 + m2 v2), term by term."""
    m1, m2, d = lane[at.M1, 0], lane[at.M2, 0], lane[at.D, 0]
    power = unit
    for n in range(ORDER):
        power *= theta
        dissipated = d * _product(c, _V1, _V1, n) + _product(c, _LINK, _W, n)
        shaken = (m1 + m2) * _product(c, _GROUND, _V1, n) + m2 * _product(c, _GROUND, _W, n)
        work[0] += dissipated * power / (n + 1.0)
        work[1] += (_product(c, _FORCE, _V1, n) - shaken) * power / (n + 1.0)
