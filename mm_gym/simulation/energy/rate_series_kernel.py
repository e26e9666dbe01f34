"""Energy rates of a nonlinear plant, integrated as Taylor series: (11) of docs/model.md.

The same integrals as `rate_kernel` has for the piecewise linear plants. The series are those of
x1, x2 - x1, v1 and w = v2 - v1, at a fixed high order and with nothing but round-off cut off,
whatever tolerance the plant itself has.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.excitation.jets import write_series
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import write_inverse_square
from mm_gym.law.dry_friction import interface_line, slip_intercept, threshold
from mm_gym.law.events import NONE, gaps_of, gaps_on, regime_exit_within, sign_of
from mm_gym.law.springs import stiffness

ORDER = 24
CUT_OFF = 2.0**-56
"""Size of the last terms relative to the leading ones."""

MOST_SERIES = 1 << 20
"""Series in one sample interval before giving up."""

# Rows of the series in one array, _WIDTH apart; `write_series` writes the seventh and eighth.
_WIDTH = 32
_X1, _OFFSET, _V1, _W, _INNER, _OUTER, _FORCE, _GROUND = (_WIDTH * k for k in range(8))
_SQUARE, _SHORTENED, _INVERSE, _SCALED, _LINK, _END = (_WIDTH * k for k in range(8, 14))


@kernel
def step_integrals(p, model, states, applied, jets, times, duration, work):
    """Write what is dissipated in each sample interval, and what disturbances add.

    Parameters
    ----------
    p, model, states, applied, jets, times, duration, work
        As for `rate_kernel.step_integrals`.

    Returns
    -------
    int
        Status.
    """
    lane, c, z = np.empty((p.shape[0], 1)), np.zeros(_END), np.empty(4)
    for i in range(states.shape[0]):
        for row in range(p.shape[0]):
            lane[row, 0] = p[row]
        lane[at.FORCE, 0], lane[at.STRETCH, 0] = applied[i, 0], applied[i, 1]
        if model[at.DAMPED] > 0.0:
            lane[int(model[at.DAMPED]), 0] = applied[i, 2]
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
    """Add up both energy rates over one step, series by series.

    Parameters
    ----------
    model, lane
        (m,) and (rows, 1), read.
    c
        (_END,) written: room for the series, zeroed when it was made.
    z
        (4,) read and written: x1, x2 - x1 [m], v1, v2 - v1 [m/s].
    duration
        Of the step [s].
    work
        (2,) written [J].
    """
    vr = threshold(lane[at.VR, 0])
    regime = sign_of(vr, z[3])
    upper, lower = gaps_of(vr, z[3])
    elapsed, unit = 0.0, duration
    work[0] = work[1] = 0.0
    for _ in range(MOST_SERIES):
        write_series(c, _WIDTH, model, lane, 0, elapsed, unit, ORDER)
        if not _expand(model, c, lane, z, regime, unit):
            return at.COLLAPSED
        remaining = (duration - elapsed) / unit
        theta, direction = min(_reach(c), remaining), 0.0
        if vr < np.inf:
            exit_at, direction = regime_exit_within(
                c, _W, _SCALED, ORDER, theta, regime, upper, lower
            )
            theta = theta if exit_at == NONE else theta * exit_at
        _add_work(c, lane, unit, theta, work)
        for k in range(4):
            z[k] += _series(c, k * _WIDTH, theta)
        if direction != 0.0:
            regime, z[3] = direction - regime, direction * vr
            upper, lower = gaps_on(vr, direction)
        else:
            upper, lower = gaps_of(vr, z[3])
        elapsed += theta * unit
        if (theta == remaining and direction == 0.0) or elapsed >= duration:
            return at.OK
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
    return at.TOO_MANY_SERIES


@kernel
def _expand(model, c, lane, z, regime, unit):
    """Write the series of state and forces: term n is the n-th derivative times unit**n / n!."""
    m1, m2, d = lane[at.M1, 0], lane[at.M2, 0], lane[at.D, 0]
    k1, beta = lane[at.K1, 0] * lane[at.ALPHA, 0], lane[at.K1, 0] * lane[at.BETA, 0]
    k0, l0, stretch = lane[at.K0, 0], lane[at.L0, 0], lane[at.STRETCH, 0]
    pair = model[at.BETWEEN] * lane[at.FORCE, 0]  # between the masses; the rest is on the carriage
    held = lane[at.FORCE, 0] - pair
    k2, chi = stiffness(k0, stretch), lane[at.CHI, 0]
    intercept = slip_intercept(lane[at.KINETIC_FORCE, 0], chi, lane[at.VR, 0])
    slope, constant = interface_line(regime, lane[at.C, 0], chi, intercept)
    for k in range(4):
        c[k * _WIDTH] = z[k]
    for n in range(ORDER):
        x1, offset, v1, w = c[_X1 + n], c[_OFFSET + n], c[_V1 + n], c[_W + n]
        c[_LINK + n] = slope * w + constant
        springs = k2 * offset
        if l0 > 0.0:
            if not _stretch(c, stretch, l0, n):
                return False
            springs = 2.0 * k0 * (offset + 2.0 * stretch * _product(c, _OFFSET, _INVERSE, n))  # (6)
        c[_SQUARE + n] = _product(c, _X1, _X1, n)
        c[_INNER + n] = c[_LINK + n] + springs + pair
        c[_OUTER + n] = (
            d * v1 + k1 * x1 + beta * _product(c, _SQUARE, _X1, n) - c[_FORCE + n] - held
        )
        held = pair = constant = 0.0
        inner, outer, step = c[_INNER + n], c[_OUTER + n], unit / (n + 1.0)
        c[_X1 + n + 1], c[_OFFSET + n + 1] = step * v1, step * w
        c[_V1 + n + 1] = step * ((inner - outer) / m1 - c[_GROUND + n])  # (1)
        c[_W + n + 1] = step * (outer / m1 - inner * (1.0 / m1 + 1.0 / m2))  # (2) less (1)
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
    """Write term n of q = stretch^2 - (offset / l0)^2 and of q^-2; False if a spring collapsed.

    The pair's force is 2 k0 offset (1 + 2 stretch / q^2): no difference of both sides' nearly equal
    stretches.
    """
    c[_SHORTENED + n] = -_product(c, _OFFSET, _OFFSET, n) / (l0 * l0)
    if n == 0:
        c[_SHORTENED] += stretch * stretch
        if not c[_SHORTENED] > 0.0:
            return False
    write_inverse_square(c, _SHORTENED, _INVERSE, n)
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
def _series(c, row, theta):
    """Return a series without its first term."""
    total = 0.0
    for n in range(ORDER, 0, -1):
        total = (total + c[row + n]) * theta
    return total


@kernel
def _add_work(c, lane, unit, theta, work):
    """Add the integrals of both energy rates term by term.

    d v1^2 + f w, and p v1 - a_g (m1 v1 + m2 v2), the terms of (11) of docs/model.md.
    """
    m1, m2, d = lane[at.M1, 0], lane[at.M2, 0], lane[at.D, 0]
    power = unit
    for n in range(ORDER):
        power *= theta
        dissipated = d * _product(c, _V1, _V1, n) + _product(c, _LINK, _W, n)
        shaken = (m1 + m2) * _product(c, _GROUND, _V1, n) + m2 * _product(c, _GROUND, _W, n)
        work[0] += dissipated * power / (n + 1.0)
        work[1] += (_product(c, _FORCE, _V1, n) - shaken) * power / (n + 1.0)
