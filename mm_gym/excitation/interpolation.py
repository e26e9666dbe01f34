"""Piecewise-linear interpolants of points, and their projection on a polynomial.

Points are a tuple: the slots of a model array at which their times and their values begin, their
number, and their spacing, which is 0 if they are not even. The interpolant is 0 before the first
point and after the last.

Over a sample interval with corners inside, the interpolant p is replaced by the polynomial q of
degree MOMENTS that has its end value and its moments up to t^(MOMENTS - 1). A linear plant adds the
integral of g p to its state, where g is a sum of exponentials: what q leaves of that is
(rate h / 2)^MOMENTS / (2^(MOMENTS - 1) MOMENTS!) of |p - q|, below 1e-11 for rate h = 0.5.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel

MOMENTS = 8
TERMS = MOMENTS + 1
"""Coefficients of the polynomial."""

_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(TERMS // 2 + 1)
NODES, WEIGHTS = 0.5 * (_ROOTS + 1.0), 0.5 * _WEIGHTS
"""Gauss's rule on [0, 1], exact for a line times a Legendre polynomial of degree MOMENTS - 1."""

MONOMIALS = np.array(
    [
        [(-1.0) ** (k + n) * math.comb(k, n) * math.comb(k + n, n) for n in range(TERMS)]
        for k in range(TERMS)
    ]
)
"""Coefficients of t^n in Legendre's polynomial k of 2 t - 1."""

ROUND_OFF = 2.0**-48
"""Size of the rounding of a time, relative to it."""

CLOSE = 1e-12
"""Part of an interval below which a corner is at its end."""


@borrowing_kernel
def time_of(model, points, k):
    """Return the time of a point; behind the last one it is infinite."""
    times, _, count, spacing = points
    if k >= count:
        return np.inf
    return k * spacing if spacing > 0.0 else model[times + k]


@borrowing_kernel
def segment_at(model, points, time):
    """Return the last point that is not later than a time, -1 before the first one."""
    _, _, count, spacing = points
    if not time >= time_of(model, points, 0):
        return -1
    if time >= time_of(model, points, count - 1):
        return count - 1
    if spacing > 0.0:
        k = min(int(time / spacing), count - 1)
        if k * spacing > time:
            return k - 1
        return k + 1 if (k + 1) * spacing <= time else k
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if time_of(model, points, middle) <= time:
            low = middle
        else:
            high = middle
    return low


@borrowing_kernel
def line(model, points, k, time):
    """Return at a time the line from point k to the next; 0 beyond the ends."""
    _, values, count, _ = points
    if k < 0 or k >= count - 1:
        return 0.0
    start = time_of(model, points, k)
    part = (time - start) / (time_of(model, points, k + 1) - start)
    return (1.0 - part) * model[values + k] + part * model[values + k + 1]


@borrowing_kernel
def margin(begin, end):
    """Return the time below which a point is at an end of an interval."""
    return ROUND_OFF * max(abs(begin), abs(end)) + CLOSE * (end - begin)


@borrowing_kernel
def add_interpolant(model, points, scale, begin, end, lanes, jet, scratch, i):
    """Add the interpolant over an interval to a jet: exactly, or its projection.

    Parameters
    ----------
    model
        (m,) float64, read.
    points
        See above.
    scale
        Factor of the values.
    begin, end
        The interval.
    lanes
        (rows, lanes) float64; TERMS rows of the jet (2 if there are no corners inside) and of the
        scratch are written.
    jet, scratch
        First rows of the jet and of the scratch.
    i
        The lane.
    """
    close = margin(begin, end)
    k = segment_at(model, points, begin + close)
    if not time_of(model, points, k + 1) < end - close:
        before, after = line(model, points, k, begin), line(model, points, k, end)
        lanes[jet, i] += scale * before
        lanes[jet + 1, i] += scale * (after - before)
        return
    for n in range(TERMS):
        lanes[scratch + n, i] = 0.0
    start = begin
    while True:
        stop = time_of(model, points, k + 1)
        if not stop < end - close:
            break
        _add_moments(model, points, k, start, stop, begin, end, lanes, scratch, i)
        start, k = stop, k + 1
    _add_moments(model, points, k, start, end, begin, end, lanes, scratch, i)
    rest = line(model, points, k, end)
    for n in range(MOMENTS):
        rest -= lanes[scratch + n, i]
    lanes[scratch + MOMENTS, i] = rest  # every Legendre polynomial ends in 1
    for n in range(TERMS):
        total = 0.0
        for degree in range(n, TERMS):
            total += MONOMIALS[degree, n] * lanes[scratch + degree, i]
        lanes[jet + n, i] += scale * total


@borrowing_kernel
def _add_moments(model, points, k, start, stop, begin, end, lanes, scratch, i):
    """Add a line's part of the coefficients of the Legendre polynomials over begin .. end."""
    share = (stop - start) / (end - begin)
    for node in range(NODES.shape[0]):
        time = start + NODES[node] * (stop - start)
        value = WEIGHTS[node] * share * line(model, points, k, time)
        place = 2.0 * (time - begin) / (end - begin) - 1.0
        legendre, following = 1.0, place
        for n in range(MOMENTS):
            lanes[scratch + n, i] += (2.0 * n + 1.0) * value * legendre
            legendre, following = (
                following,
                ((2.0 * n + 3.0) * place * following - (n + 1.0) * legendre) / (n + 2.0),
            )
