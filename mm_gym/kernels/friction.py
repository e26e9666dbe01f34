"""Dry friction (eq. 9 of the paper) on a linear plant by Taylor series: one regime after the other.

Within a regime the plant is affine. Its series over an interval is cut off below round-off, so it
serves both to advance the state and to find where the slip velocity leaves the regime.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import kernel
from mm_gym.kernels.sources import add_jets

NONE = 2.0
"""What `first_exit` returns where there is no exit."""

MOST_CHANGES = 1000
"""Changes of regime in one interval that are followed."""

_MOST_TRIALS = 10_000
_SHORTEST = 2.0**-52

# Rows of the series, and of the coefficients of one lane.
_WIDTH = 32
_X1, _X2, _V1, _V2, _W = (_WIDTH * k for k in range(5))
_FORCE, _GROUND, SERIES = (_WIDTH * k for k in range(6, 9))  # where `excite` writes
_M1, _M2, _K1, _D, _K2, _STICK, _CHI, _SLIP_FORCE, _VR, HELD, COEFFICIENTS = range(11)


@kernel
def sign_of(vr, w):
    """Return the direction of slip, or 0 for stick."""
    return (1.0 if w > vr else 0.0) - (1.0 if w < -vr else 0.0)


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
        excite(c, _WIDTH, model, lanes, i, elapsed, duration, degree)
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
def excite(c, width, model, lanes, i, elapsed, duration, degree):
    """Write the series of the carriage's force (row 6) and of the ground's acceleration (row 7).

    Rows are `width` apart; the interval begins at `elapsed` [s] of the substep. For each tone
    p'' = -w**2 p.
    """
    tones, ground = int(model[at.TONE_COUNT]), int(model[at.GROUND])
    if tones == 0 and model[at.TERMS] == 0.0:
        return
    for n in range(degree + 1):
        c[6 * width + n] = c[7 * width + n] = 0.0
    add_jets(c, 6 * width, 7 * width, model, lanes, i, elapsed, duration, degree)
    for j in range(tones):
        tone = at.TONES + at.TONE_ROWS * j
        frequency, scale = lanes[tone + at.FREQUENCY, i], lanes[tone + at.AMPLITUDE, i]
        cosine, sine = math.cos(frequency * elapsed), math.sin(frequency * elapsed)
        value = scale * (lanes[tone + at.SINE, i] * cosine + lanes[tone + at.COSINE, i] * sine)
        slope = scale * (lanes[tone + at.COSINE, i] * cosine - lanes[tone + at.SINE, i] * sine)
        turn = frequency * duration
        slope *= turn
        row = 7 * width if (ground >> j) & 1 else 6 * width
        for n in range(degree + 1):
            c[row + n] += value
            value, slope = slope, -value * turn * turn / ((n + 1.0) * (n + 2.0))


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


@kernel
def first_exit(c, row, degree, gap, sign):
    """Return the first t in (0, 1] at which a polynomial turns negative, or NONE.

    The polynomial is gap + sign (c1 t + c2 t**2 + ...), c from `row` on.

    Nothing is missed: an interval is passed only if the second derivative's bound leaves no room
    for an exit, and a root is taken as the first one only where the polynomial is monotone.
    """
    gap = max(gap, 0.0)  # what round-off left outside
    total = bend = 0.0
    for n in range(degree, 0, -1):
        total += c[row + n]
        bend += n * (n - 1.0) * abs(c[row + n])
    if gap + sign * total >= 0.0 and gap + gap + sign * total >= 0.5 * bend:
        return NONE
    start, width, value, slope = 0.0, 1.0, gap, sign * c[row + 1]
    for _ in range(_MOST_TRIALS):
        end = start + width
        next_value, next_slope = _value_and_slope(c, row, degree, gap, sign, end)
        rises = max(slope, next_slope) >= bend * width
        falls = min(slope, next_slope) <= -bend * width
        passed = next_value >= 0.0 and (
            rises or falls or value + next_value >= 0.5 * bend * width * width or width <= _SHORTEST
        )
        if passed:
            if end >= 1.0:
                return NONE
            start, value, slope = end, max(next_value, 0.0), next_slope
            while start % (2.0 * width) == 0.0:  # the next interval is as long as its place allows
                width *= 2.0
        elif falls:
            return _root(
                c, row, degree, gap, sign, start, end, start + width * value / (value - next_value)
            )
        elif width <= _SHORTEST:
            return end
        else:
            width *= 0.5
    return start


@kernel
def _value_and_slope(c, row, degree, gap, sign, t):
    value = slope = 0.0
    for n in range(degree, 0, -1):
        slope = fma(slope, t, value)
        value = fma(value, t, c[row + n])
    return fma(sign * value, t, gap), sign * fma(slope, t, value)


@kernel
def _root(c, row, degree, gap, sign, low, high, t):
    """Return the root of a falling polynomial, at least 0 at `low` and negative at `high`.

    By Newton's method from t, bracketed.
    """
    for _ in range(200):
        value, slope = _value_and_slope(c, row, degree, gap, sign, t)
        if value >= 0.0:
            low = t
        else:
            high = t
        following = t - value / slope if slope < 0.0 else high
        if abs(following - t) <= 2.0**-52 * t:
            return min(max(following, low), high)
        if not low < following < high:
            following = 0.5 * (low + high)
            if not low < following < high:
                return high
        t = following
    return t


# Slots of the model of the series alone.
DEGREE = at.MODEL_OWN


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step on the series alone: their parameters may differ."""
    status, degree, tones = at.OK, int(model[DEGREE]), int(model[at.TONE_COUNT])
    z, p, c = np.empty(5), np.empty(COEFFICIENTS), np.zeros(SERIES)
    for i in range(first, last):
        load_coefficients(lanes, i, p)
        for row in range(4):
            z[row] = lanes[row, i]
        z[4] = z[3] - z[2]
        regime = sign_of(p[_VR], z[4])
        pieces = max(1.0, math.ceil(_fastest_rate(p, lanes, i, tones) * model[at.TIME_STEP]))
        piece = model[at.TIME_STEP] / pieces
        for k in range(pieces):
            outcome, regime = walk(p, c, model, lanes, i, z, regime, k * piece, piece, degree)
            status = max(status, outcome)
        for row in range(4):
            lanes[row, i] = z[row]
    return status


@kernel
def _fastest_rate(p, lanes, i, tones):
    """Return a bound of the lane's rates [1/s], see `mm_gym.methods.base.fastest_rate`."""
    damping = max(p[_STICK], p[_CHI])
    rate = (
        math.sqrt((p[_K1] + p[_K2]) / p[_M1] + p[_K2] / p[_M2])
        + (damping + p[_D]) / p[_M1]
        + damping / p[_M2]
    )
    for j in range(tones):
        rate = max(rate, lanes[at.TONES + at.TONE_ROWS * j + at.FREQUENCY, i])
    return rate
