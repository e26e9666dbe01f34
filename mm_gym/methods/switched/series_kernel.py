"""Dry friction (eq. 9 of the paper) on a linear plant by Taylor series: one regime after the other.

Within a regime the plant is affine. Its series over an interval is cut off below round-off, so it
serves both to advance the state and to find where the slip velocity leaves the regime.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.excitation.jets import write_series
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.bounds import fastest_harmonic, fastest_rate
from mm_gym.law.dry_friction import interface_line, slip_intercept
from mm_gym.law.events import gaps_of, gaps_on, regime_exit, sign_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness

MOST_CHANGES = 1000
"""Changes of regime in one interval that are followed."""


# Rows of the series, and of the coefficients of one lane.
_WIDTH = 32
_X1, _X2, _V1, _V2, _W = (_WIDTH * k for k in range(5))
_FORCE, _GROUND, SERIES = (_WIDTH * k for k in range(6, 9))  # where `write_series` writes
_M1, _M2, _K1, _D, _K2, _STICK, _CHI, _INTERCEPT, _VR, HELD, COEFFICIENTS = range(11)


@kernel
def load_coefficients(lanes, i, p):
    """Write what the equations of lane i need to p (COEFFICIENTS,), in SI units."""
    p[_M1], p[_M2], p[_D] = lanes[layout.M1, i], lanes[layout.M2, i], lanes[layout.D, i]
    p[_K1] = lanes[layout.K1, i] * lanes[layout.ALPHA, i]
    p[_K2] = stiffness(lanes[layout.K0, i], lanes[layout.STRETCH, i])
    p[_STICK], p[_CHI], p[_VR] = lanes[layout.C, i], lanes[layout.CHI, i], lanes[layout.VR, i]
    p[_INTERCEPT] = slip_intercept(lanes[layout.KINETIC_FORCE, i], p[_CHI], p[_VR])
    p[HELD] = lanes[layout.FORCE, i]


@kernel
def walk(p, c, model, lanes, i, z, regime, elapsed, duration, degree):
    """Advance the state z of lane i through an interval.

    Parameters
    ----------
    p
        (COEFFICIENTS,) read: what `load_coefficients` writes.
    c
        (SERIES,) written: room for the series, zeroed when it was made.
    model, lanes
        (m,) and (rows, count), read: what excites the lane.
    z
        (5,) read and written: x1, x2 [m], v1, v2 and w = v2 - v1 [m/s].
    regime
        Direction of slip, or 0 for stick, at the interval's start.
    elapsed, duration
        Start of the interval within the sample interval, and its length [s].
    degree
        Of the series; the caller sees to it that what is cut off is below round-off.

    Returns
    -------
    tuple
        Status, and the regime at the end.
    """
    vr = p[_VR]
    upper, lower = gaps_of(vr, z[4])
    for _ in range(MOST_CHANGES):
        write_series(c, _WIDTH, model, lanes, i, elapsed, duration, degree)
        _expand(model, c, p, z, regime, duration, degree)
        theta, direction = regime_exit(c, _W, degree, regime, upper, lower)
        _evaluate(c, z, min(theta, 1.0), degree)
        if direction == 0.0:
            return layout.OK, regime
        regime = direction - regime
        z[4] = direction * vr
        upper, lower = gaps_on(vr, direction)
        elapsed += theta * duration
        duration *= 1.0 - theta
    return layout.TOO_MANY_EVENTS, regime


@kernel
def _expand(model, c, p, z, regime, duration, degree):
    """Write the series of the state: term n is its n-th derivative times duration**n / n!.

    Parameters
    ----------
    c
        (SERIES,) written, but for the series of force [N] and ground acceleration [m/s^2], read.
    """
    by_m1, by_m2, k1, d, k2 = 1.0 / p[_M1], 1.0 / p[_M2], p[_K1], p[_D], p[_K2]
    damping, friction = interface_line(regime, p[_STICK], p[_CHI], p[_INTERCEPT])
    pair, held = control_forces(model, p[HELD])
    friction, by_both = friction + pair, by_m1 + by_m2
    x1, x2, offset, v1, v2, w = z[0], z[1], z[1] - z[0], z[2], z[3], z[4]
    c[_X1], c[_X2], c[_V1], c[_V2], c[_W] = x1, x2, v1, v2, w
    for n in range(degree):
        step, ground = duration / (n + 1.0), c[_GROUND + n]
        inner = fma(damping, w, fma(k2, offset, friction))
        outer = fma(d, v1, fma(k1, x1, -c[_FORCE + n] - held))
        friction = held = 0.0
        x1, x2, offset = step * v1, step * v2, step * w
        v1 = step * (fma(inner, by_m1, -outer * by_m1) - ground)  # (1) of docs/model.md
        v2 = step * fma(-inner, by_m2, -ground)  # (2)
        # (2) less (1), and not v2 - v1: near a stiff stick its digits would cancel.
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
DEGREE = layout.MODEL_OWN


@kernel
def propagate(model, lanes, first, last):
    """Advance by one sample interval the lanes that `lanes_kernel` leaves, one after the other."""
    status, degree = layout.OK, int(model[DEGREE])
    z, p, c = np.empty(5), np.empty(COEFFICIENTS), np.zeros(SERIES)
    for i in range(first, last):
        load_coefficients(lanes, i, p)
        for row in range(4):
            z[row] = lanes[row, i]
        z[4] = z[3] - z[2]
        regime = sign_of(p[_VR], z[4])
        rate = fastest_rate(p[_M1], p[_M2], p[_K1], p[_K2], max(p[_STICK], p[_CHI]), p[_D])
        rate = max(rate, fastest_harmonic(lanes[:, i], int(model[layout.HARMONIC_COUNT])))
        pieces = max(1, math.ceil(rate * model[layout.SAMPLE_INTERVAL]))
        piece = model[layout.SAMPLE_INTERVAL] / pieces
        for k in range(pieces):
            outcome, regime = walk(p, c, model, lanes, i, z, regime, k * piece, piece, degree)
            status = max(status, outcome)
        for row in range(4):
            lanes[row, i] = z[row]
    return status
