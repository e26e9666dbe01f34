"""Dry friction (eq. 9 of the paper) on a linear plant by Taylor series: one regime after the other.

Within a regime the plant is affine. Its series over an interval is cut off below round-off, so it
serves both to advance the state and to find where the slip velocity leaves the regime.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.events import NONE, first_exit, sign_of
from mm_gym.kernels.jets import write_series
from mm_gym.kernels.jit import kernel

MOST_CHANGES = 1000
"""Changes of regime in one interval that are followed."""


# Rows of the series, and of the coefficients of one lane.
_WIDTH = 32
_X1, _X2, _V1, _V2, _W = (_WIDTH * k for k in range(5))
_FORCE, _GROUND, SERIES = (_WIDTH * k for k in range(6, 9))  # where `write_series` writes
_M1, _M2, _K1, _D, _K2, _STICK, _CHI, _SLIP_FORCE, _VR, HELD, COEFFICIENTS = range(11)


@kernel
def load_coefficients(lanes, i, p):
    """Write what the equations of lane i need."""
    mu1, mu2, vr = lanes[at.MU1, i], lanes[at.MU2, i], lanes[at.VR, i]
    chi, normal, stretch = lanes[at.CHI, i], lanes[at.FN, i], lanes[at.STRETCH, i]
    p[_M1], p[_M2], p[_D] = lanes[at.M1, i], lanes[at.M2, i], lanes[at.D, i]
    p[_K1] = lanes[at.K1, i] * lanes[at.ALPHA, i]
    # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
    p[_K2] = (
        2.0 * lanes[at.K0, i] * (1.0 + 2.0 / (stretch * stretch * stretch))
        if lanes[at.K0, i] > 0.0
        else 0.0
    )
    p[_STICK], p[_CHI], p[_SLIP_FORCE] = mu1 * normal / vr, chi, mu2 * normal - chi * vr
    p[_VR], p[HELD] = vr, lanes[at.FORCE, i]


@kernel
def walk(p, c, model, lanes, i, z, regime, elapsed, duration, degree):
    """Advance z = (x1, x2, v1, v2, w) of lane i through an interval.

    Parameters
    ----------
    p, c, model
        Coefficients of the lane; room for the series, zeroed when it was made; the model, for what
        excites it.
    regime
        Direction of slip, or 0 for stick, at its start.
    elapsed, duration
        Start of the interval within the control step, and its length [s].
    degree
        Of the series; the caller sees to it that what is cut off is below round-off.

    Returns
    -------
    tuple
        Status, and the regime at the end.
    """
    vr, w = p[_VR], z[4]
    upper, lower = vr - w, vr + w  # how far w is below v_r and above -v_r
    for _ in range(MOST_CHANGES):
        write_series(c, _WIDTH, model, lanes, i, elapsed, duration, degree)
        _expand(c, p, z, regime, duration, degree)
        if regime == 0.0:
            up, down = first_exit(c, _W, degree, upper, -1.0), first_exit(c, _W, degree, lower, 1.0)
            theta, direction = (up, 1.0) if up <= down else (down, -1.0)
        else:
            gap = -upper if regime > 0.0 else -lower
            theta, direction = first_exit(c, _W, degree, gap, regime), regime
        _evaluate(c, z, min(theta, 1.0), degree)
        if theta == NONE:
            return at.OK, regime
        regime = direction - regime
        z[4] = direction * vr
        upper, lower = (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)
        elapsed += theta * duration
        duration *= 1.0 - theta
    return at.TOO_MANY_EVENTS, regime


@kernel
def _expand(c, p, z, regime, duration, degree):
    """Write the series of the state: term n is its n-th derivative times duration**n / n!."""
    by_m1, by_m2, k1, d, k2 = 1.0 / p[_M1], 1.0 / p[_M2], p[_K1], p[_D], p[_K2]
    damping = p[_STICK] if regime == 0.0 else p[_CHI]
    friction, held, by_both = regime * p[_SLIP_FORCE], p[HELD], by_m1 + by_m2
    x1, x2, offset, v1, v2, w = z[0], z[1], z[1] - z[0], z[2], z[3], z[4]
    c[_X1], c[_X2], c[_V1], c[_V2], c[_W] = x1, x2, v1, v2, w
    for n in range(degree):
        step, ground = duration / (n + 1.0), c[_GROUND + n]
        inner = fma(damping, w, fma(k2, offset, friction))
        outer = fma(d, v1, fma(k1, x1, -c[_FORCE + n] - held))
        friction = held = 0.0
        x1, x2, offset = step * v1, step * v2, step * w
        v1 = step * (fma(inner, by_m1, -outer * by_m1) - ground)
        v2 = step * fma(-inner, by_m2, -ground)
        # Not v2 - v1: near a stiff stick its digits would cancel.
        w = step * fma(-inner, by_both, outer * by_m1)
        c[_X1 + n + 1], c[_X2 + n + 1] = x1, x2
        c[_V1 + n + 1], c[_V2 + n + 1], c[_W + n + 1] = v1, v2, w


@kernel
def _evaluate(c, z, theta, degree):
    """Advance the state by a fraction of the interval."""
    x1 = x2 = v1 = v2 = w = 0.0
    for k in range(degree):
        n = degree - k
        x1, x2 = (x1 + c[_X1 + n]) * theta, (x2 + c[_X2 + n]) * theta
        v1, v2 = (v1 + c[_V1 + n]) * theta, (v2 + c[_V2 + n]) * theta
        w = (w + c[_W + n]) * theta
    z[0] += x1
    z[1] += x2
    z[2] += v1
    z[3] += v2
    z[4] += w


# Slots of the model of the series alone.
DEGREE = at.MODEL_OWN


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step on the series alone: their parameters may differ."""
    status, degree, harmonics = at.OK, int(model[DEGREE]), int(model[at.HARMONIC_COUNT])
    z, p, c = np.empty(5), np.empty(COEFFICIENTS), np.zeros(SERIES)
    for i in range(first, last):
        load_coefficients(lanes, i, p)
        for row in range(4):
            z[row] = lanes[row, i]
        z[4] = z[3] - z[2]
        regime = sign_of(p[_VR], z[4])
        pieces = max(
            1.0, math.ceil(_fastest_rate(p, lanes, i, harmonics) * model[at.SAMPLE_INTERVAL])
        )
        piece = model[at.SAMPLE_INTERVAL] / pieces
        for k in range(pieces):
            outcome, regime = walk(p, c, model, lanes, i, z, regime, k * piece, piece, degree)
            status = max(status, outcome)
        for row in range(4):
            lanes[row, i] = z[row]
    return status


@kernel
def _fastest_rate(p, lanes, i, harmonics):
    """Return a bound of the lane's rates [1/s], see `mm_gym.methods.base.fastest_rate`."""
    damping = max(p[_STICK], p[_CHI])
    rate = (
        math.sqrt((p[_K1] + p[_K2]) / p[_M1] + p[_K2] / p[_M2])
        + (damping + p[_D]) / p[_M1]
        + damping / p[_M2]
    )
    for j in range(harmonics):
        rate = max(rate, lanes[at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY, i])
    return rate
