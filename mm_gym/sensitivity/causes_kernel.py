"""How parameters drive the deviations of a motion: the slopes of its equations over each of them.

(1) to (6) of docs/model.md, differentiated.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.motion import control_forces
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.layout import FIRST_ROW, IS_CUBIC, IS_FINITE, TIME


@borrowing_kernel
def cause(model, lanes, i, c, p, elapsed, unit, n, row):
    """Return what a parameter's deviation of one adds to term n of the deviations' equations.

    Parameters
    ----------
    model, lanes, i, c, p
        As for `series_kernel`; read.
    elapsed, unit
        As for `series_kernel`.
    n, row
        The term, and the parameter's row.

    Returns
    -------
    tuple
        To the force between the masses, to what resists the carriage [N], and to the accelerations
        v1' and w' [m/s^2], each per unit of the parameter.
    """
    first, regime = 1.0 if n == 0 else 0.0, p[of.REGIME]
    if row == at.FORCE:
        pair, held = control_forces(model, first)
        return pair, -held, 0.0, 0.0
    if row == at.STRETCH:
        if model[IS_FINITE] > 0.0:
            return c[of.OVER_STRETCH + n], 0.0, 0.0, 0.0
        return -12.0 * p[of.K0] / p[of.STRETCH] ** 4 * c[of.OFFSET + n], 0.0, 0.0, 0.0
    if row == at.M1:
        by_square = 1.0 / (p[of.M1] * p[of.M1])
        slide = (c[of.INNER + n] - c[of.OUTER + n]) * by_square
        return 0.0, 0.0, -slide, slide
    if row == at.M2:
        return 0.0, 0.0, 0.0, c[of.INNER + n] / (p[of.M2] * p[of.M2])
    if row == at.K1:
        cube = p[of.BETA] * c[of.CUBE + n] if model[IS_CUBIC] > 0.0 else 0.0
        return 0.0, fma(p[of.ALPHA], c[of.X1 + n], cube), 0.0, 0.0
    if row == at.ALPHA:
        return 0.0, p[of.K1] * c[of.X1 + n], 0.0, 0.0
    if row == at.BETA:
        if model[IS_CUBIC] > 0.0:
            return 0.0, p[of.K1] * c[of.CUBE + n], 0.0, 0.0
        return 0.0, 0.0, 0.0, 0.0
    if row == at.D:
        return 0.0, c[of.V1 + n], 0.0, 0.0
    if row == at.C:
        return c[of.W + n], 0.0, 0.0, 0.0
    if row == at.K0:
        return c[of.PAIR + n] / p[of.K0], 0.0, 0.0, 0.0
    if row == at.L0:
        return _over_rest_length(c, p, n), 0.0, 0.0, 0.0
    if row >= at.HARMONICS:
        value = harmonic_slope(model, lanes, i, elapsed, unit, n, row)
        if (int(model[at.GROUND]) >> ((row - at.HARMONICS) // at.HARMONIC_ROWS)) & 1:
            return 0.0, 0.0, -value, 0.0
        return 0.0, -value, 0.0, 0.0
    return friction_slope(c, p, n, row, first, regime), 0.0, 0.0, 0.0


@borrowing_kernel
def _over_rest_length(c, p, n):
    """Return term n of the slope of the finite pair's force over its rest length [N/m]."""
    total = 0.0
    for m in range(n + 1):
        total += (c[of.SHORT3 + m] + c[of.LONG3 + m]) * c[of.OFFSET + n - m]
    return p[of.K0] * (c[of.SHORT2 + n] - c[of.LONG2 + n] - 2.0 * total / p[of.L0])


@borrowing_kernel
def friction_slope(c, p, n, row, first, regime):
    """Return term n of the slope of dry friction, (4) of docs/model.md, over a parameter of it.

    Parameters
    ----------
    c, p, n, row
        As for `cause`.
    first, regime
        1 for term 0, else 0; and the regime.
    """
    w = c[of.W + n]
    if regime == 0.0:
        if row == at.MU1:
            return p[of.FN] / p[of.VR] * w
        if row == at.FN:
            return p[of.MU1] / p[of.VR] * w
        if row == at.VR:
            return -p[of.STICK] / p[of.VR] * w
        return 0.0
    if row == at.MU2:
        return regime * p[of.FN] * first
    if row == at.FN:
        return regime * p[of.MU2] * first
    if row == at.VR:
        return -regime * p[of.CHI] * first
    if row == at.CHI:
        return w - regime * p[of.VR] * first
    return 0.0


@borrowing_kernel
def harmonic_slope(model, lanes, i, elapsed, unit, n, row):
    """Return term n of the slope of a harmonic over its amplitude, frequency or phase.

    Parameters
    ----------
    model, lanes, i, elapsed, unit, n, row
        As for `cause`.
    """
    which = (row - at.HARMONICS) // at.HARMONIC_ROWS
    harmonic = at.HARMONICS + at.HARMONIC_ROWS * which
    frequency, amplitude = lanes[harmonic + at.FREQUENCY, i], lanes[harmonic + at.AMPLITUDE, i]
    cosine, sine = lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i]
    turned, slant = math.cos(frequency * elapsed), math.sin(frequency * elapsed)
    sine, cosine = sine * turned + cosine * slant, cosine * turned - sine * slant
    if row == harmonic + at.AMPLITUDE:
        value = _harmonic_term(sine, cosine, frequency * unit, n)
    else:  # the phase: a cosine; the frequency: time times it
        value = amplitude * _harmonic_term(cosine, -sine, frequency * unit, n)
        if row == harmonic + at.FREQUENCY:
            time = lanes[int(model[FIRST_ROW]) + TIME, i] + elapsed
            before = _harmonic_term(cosine, -sine, frequency * unit, n - 1) if n > 0 else 0.0
            value = time * value + unit * amplitude * before
    return value


@borrowing_kernel
def _harmonic_term(value, slope, turn, n):
    """Return term n of a harmonic, from its value and its slope over the phase."""
    for k in range(n):
        value, slope = slope * turn / (k + 1.0), -value * turn / (k + 1.0)
    return value
