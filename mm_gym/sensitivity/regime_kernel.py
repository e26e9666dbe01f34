"""Motion and deviations of one lane within a regime of the friction, where the plant is linear.

The deviations of all columns stand side by side in a vector. How many terms it takes is known
beforehand, from the fastest rate. The unit of time of the deviations is the length of the motion's
part that counts, and their terms are derivatives, as in `generator_kernel`.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.simd import everywhere
from mm_gym.law.motion import control_forces
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.causes_kernel import friction_slope, harmonic_slope
from mm_gym.sensitivity.generator_kernel import (
    ACCELERATION,
    COUPLING,
    OFFSET,
    V1,
    X1,
    deviate,
    slope,
)
from mm_gym.sensitivity.layout import CAUSES, STATES, WIDTH

ROUND_OFF = 2.0**-54
"""Terms that are smaller, over the first one, do not change a sum."""

# Rows of vectors behind the four parts of the deviations: the factors of what drives each, then its
# terms.
_TO_V1, _TO_W, _SIGNAL = 4, 5, 6
ROWS = _SIGNAL + of.ORDER


@borrowing_kernel
def expand_motion(model, c, p, unit, phase):
    """Write the motion's series; return their order.

    Parameters
    ----------
    model, c, p
        As for `series_kernel`: first terms, coefficients and the excitation's series are read, all
        other terms written.
    unit
        Unit of time [s].
    phase
        The fastest rate times it, at most `series_kernel.LONGEST`.
    """
    by_m1, by_both = 1.0 / p[of.M1], 1.0 / p[of.M1] + 1.0 / p[of.M2]
    k1, k2, d, damping = p[of.K1] * p[of.ALPHA], p[of.K2], p[of.D], p[of.DAMPING]
    excited = model[at.HARMONIC_COUNT] > 0.0 or model[at.TERMS] > 0.0
    held, slip, bound = p[of.HELD], p[of.SLIP] + p[of.BETWEEN], 1.0
    for n in range(of.ORDER):
        step = unit / (n + 1.0)
        inner = fma(damping, c[of.W + n], k2 * c[of.OFFSET + n]) + slip
        outer, ground = fma(k1, c[of.X1 + n], fma(d, c[of.V1 + n], -held)), 0.0
        if excited:
            outer -= c[of.FORCE + n]
            ground = c[of.GROUND + n]
        c[of.INNER + n], c[of.ACCELERATION + n] = inner, (inner - outer) * by_m1
        c[of.X1 + n + 1], c[of.OFFSET + n + 1] = step * c[of.V1 + n], step * c[of.W + n]
        c[of.V1 + n + 1] = step * (c[of.ACCELERATION + n] - ground)  # (1)
        c[of.W + n + 1] = step * (outer * by_m1 - inner * by_both)  # (2) less (1)
        held = slip = 0.0
        bound *= phase / (n + 1.0)
        if bound <= ROUND_OFF and n > 1:
            return n + 1
    return of.ORDER


@borrowing_kernel
def write_signals(model, lanes, i, c, p, t, elapsed, unit, theta, order):
    """Write what drives the deviations in the part theta of the motion's series.

    Parameters
    ----------
    model, lanes, i, c, p
        As for `series_kernel`; read.
    t
        (ROWS, LANES) written: factors and terms.
    elapsed, unit
        Start of the series since that of the sample interval, and its unit of time [s].
    theta, order
        Part of the unit, and order of the series.
    """
    span = theta * unit
    parameters = p[of.M1], p[of.M2], p[of.K1], p[of.ALPHA], p[of.K0], p[of.STRETCH]
    push, both = span * span / p[of.M1], 1.0 + p[of.M1] / p[of.M2]
    for j in range(STATES, int(model[WIDTH])):
        cause = int(model[CAUSES + j])
        row, scale = of.X1, theta
        if cause == at.FORCE:
            pair, alone = control_forces(model, push)
            t[_TO_V1, j], t[_TO_W, j], t[_SIGNAL, j] = push, -alone - both * pair, 1.0
            continue
        if cause >= at.HARMONICS:
            which = (cause - at.HARMONICS) // at.HARMONIC_ROWS
            ground = (int(model[at.GROUND]) >> which) & 1
            t[_TO_V1, j], t[_TO_W, j] = (-span * span, 0.0) if ground else (push, -push)
            row = of.TERM
            for n in range(order):
                c[row + n] = harmonic_slope(model, lanes, i, elapsed, unit, n, cause)
            scale = 1.0
        elif cause in (at.MU1, at.MU2, at.VR, at.CHI, at.FN):
            t[_TO_V1, j], t[_TO_W, j] = push, -both * push
            row, scale = of.TERM, 1.0
            for n in range(order):
                first = 1.0 if n == 0 else 0.0
                c[row + n] = friction_slope(c, p, n, cause, first, p[of.REGIME])
        else:
            which, t[_TO_V1, j], t[_TO_W, j] = slope(cause, parameters, span)
            row, scale = _row_of(which, span, p)
        for n in range(order):
            t[_SIGNAL + n, j] = scale * c[row + n]
            scale *= theta * (n + 1.0)


@borrowing_kernel
def _row_of(which, span, p):
    """Return the row of a series of `generator_kernel`, and its factor."""
    if which == X1:
        return of.X1, 1.0
    if which == OFFSET:
        return of.OFFSET, 1.0
    if which == V1:
        return of.V1, span
    if which == ACCELERATION:
        return of.ACCELERATION, span * span
    if which == COUPLING:
        return of.INNER, span * span / p[of.M1]
    return of.W, span


@borrowing_kernel
def advance(p, b, weights, span, order):
    """Advance the deviations.

    Parameters
    ----------
    p
        (of.COEFFICIENTS,) read.
    b
        The rows of `write_signals` as vectors: the deviations are read and written.
    weights
        (of.ORDER + 1,) read: 1 / n!.
    span
        How long [s].
    order
        Of the series.
    """
    prefer_widest_vectors()
    rate = span / p[of.M1]
    g = (
        everywhere(span * rate * p[of.K1] * p[of.ALPHA]),
        everywhere(rate * p[of.D]),
        everywhere(rate * p[of.DAMPING]),
        everywhere(span * rate * p[of.K2]),
        everywhere(p[of.M1] / p[of.M2]),
    )
    z = b[0], b[1], span * b[2], span * b[3]
    z = deviate(b, g, weights, _SIGNAL, b[_TO_V1], b[_TO_W], order, z)
    back = 1.0 / span
    b[0], b[1], b[2], b[3] = z[0], z[1], back * z[2], back * z[3]
