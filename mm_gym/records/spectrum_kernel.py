"""The largest responses of oscillators to a ground acceleration that is linear between samples.

With w = 2 pi / T the state is p = w^2 x and q = w v, of displacement x and velocity v relative to
the ground; its time is w t:

    dp = q,  dq = -p - 2 z q - a                                                         (S1)

In a part of a sample interval the acceleration is a + s w t, and the next state is a sum of p, q,
a and s with constant factors: the recurrence of Nigam and Jennings (Bull. Seism. Soc. Am. 59,
1969), whose factors here are sums of Taylor series, without the cancellation that their closed
forms have at long periods.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel

TURN = 0.125
"""Longest part of a sample interval, times w (1 + 2 z) [rad]: a response has at most one turning
point in it, but for those between which it hardly moves."""

TERMS = 12  # of a series: what they leave out is 0.125^12 / 12! = 3e-20 of the largest

NEWTON = 4
"""Steps of Newton's method to a turning point: each doubles the digits, and the first has two."""


@kernel
def write_peaks(steps, values, periods, dampings, peaks):
    """Write the largest |p| and |absolute acceleration| (2, d, k) [m/s^2] of each oscillator.

    The oscillators, of periods (k,) [s] and damping ratios (d,), are at rest at the first of n
    samples, which are steps (n - 1,) [s] apart; behind the last one the ground is.
    """
    series, factors = np.empty(TERMS), np.empty((4, 2))
    for i in range(dampings.shape[0]):
        for k in range(periods.shape[0]):
            w = 2.0 * math.pi / periods[k]
            peaks[0, i, k], peaks[1, i, k] = _peak(steps, values, w, dampings[i], series, factors)


@kernel
def _peak(steps, values, w, z, series, factors):
    """Return the largest |p| and |absolute acceleration| of one oscillator."""
    p, q, largest, most, length, parts, part = 0.0, 0.0, 0.0, 0.0, 0.0, 1, 0.0
    for i in range(steps.shape[0] + 1):
        free = i == steps.shape[0]  # for a period behind the last sample
        step = 2.0 * math.pi / w if free else steps[i]
        if step != length:
            length, parts = step, math.ceil(w * step * (1.0 + 2.0 * z) / TURN)
            part = w * step / parts
            _write_factors(part, z, series, factors)
        start = 0.0 if free else values[i]
        slope = 0.0 if free else (values[i + 1] - start) / (w * step)
        for j in range(parts):
            a = start + slope * (part * j)
            nextp = (
                factors[0, 0] * p + factors[1, 0] * q + factors[2, 0] * a + factors[3, 0] * slope
            )
            nextq = (
                factors[0, 1] * p + factors[1, 1] * q + factors[2, 1] * a + factors[3, 1] * slope
            )
            if q * nextq < 0.0 and abs(p) + part * abs(q) > largest:
                _write_series(p, q, a, slope, z, series)
                largest = max(largest, _turning(series, part))
            rate = q - 2.0 * z * (p + 2.0 * z * q + a)
            after = a + slope * part
            nextrate = nextq - 2.0 * z * (nextp + 2.0 * z * nextq + after)
            if rate * nextrate < 0.0 and abs(p + 2.0 * z * q) + part * abs(rate) > most:
                _write_series(p, q, a, slope, z, series)
                for n in range(TERMS - 1):
                    series[n] += 2.0 * z * (n + 1.0) * series[n + 1]
                series[TERMS - 1] = 0.0
                most = max(most, _turning(series, part))
            p, q = nextp, nextq
            largest, most = max(largest, abs(p)), max(most, abs(p + 2.0 * z * q))
    return largest, most


@kernel
def _write_series(p, q, a, slope, z, series):
    """Write the Taylor series of p under (S1), in w t."""
    series[0], series[1] = p, q
    for n in range(TERMS - 2):
        force = a if n == 0 else (slope if n == 1 else 0.0)
        total = series[n] + 2.0 * z * (n + 1.0) * series[n + 1] + force
        series[n + 2] = -total / ((n + 1.0) * (n + 2.0))


@kernel
def _write_factors(part, z, series, factors):
    """Write the factors (4, 2) of p, q, a and the slope in the next p and q."""
    for k in range(4):
        _write_series(
            1.0 if k == 0 else 0.0,
            1.0 if k == 1 else 0.0,
            1.0 if k == 2 else 0.0,  # noqa: PLR2004 - of four unit vectors
            1.0 if k == 3 else 0.0,  # noqa: PLR2004
            z,
            series,
        )
        factors[k, 0], factors[k, 1], _ = _value_slope_bend(series, part)


@kernel
def _value_slope_bend(series, place):
    """Return a series at a place, with its first two derivatives."""
    value = slope = bend = 0.0
    for n in range(TERMS - 1, -1, -1):
        bend = bend * place + 2.0 * slope
        slope = slope * place + value
        value = value * place + series[n]
    return value, slope, bend


@kernel
def _turning(series, part):
    """Return the magnitude of a series where it turns within a part."""
    place = 0.5 * part
    for _ in range(NEWTON):
        _, slope, bend = _value_slope_bend(series, place)
        if bend != 0.0:
            place = min(max(place - slope / bend, 0.0), part)
    return abs(_value_slope_bend(series, place)[0])
