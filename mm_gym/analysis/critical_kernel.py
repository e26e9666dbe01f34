"""The fastest slip of a free linear motion: branch and bound on the levels of doubled steps."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel
from mm_gym.kernels.laws import stiffness
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy import precise_integration_kernel as precise

BLOCK_PHASE = 0.5
MOST_INTERVALS = 1_000_000
"""Intervals tried before giving up: some 0.2 s."""

RESOLVED = 2.0**-56
"""Share of the peak that an interval not searched further may hide."""


@kernel
def fastest_slip(p):
    """Return the largest |w| [m/s] with a viscous interface of damping p[C], and the status."""
    p[at.VR] = 0.0  # the linear system
    k2 = stiffness(p[at.K0], p[at.STRETCH])
    m1, m2 = piecewise.carriage_mass(p), p[at.M2]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(piecewise.FINEST, precise.halvings(piecewise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > piecewise.DEEPEST:
        return math.nan, at.TOO_MANY_EVENTS
    a = piecewise.generator(p, k2, 0, 0, 0, 1.0, False)
    levels, rows = np.zeros((depth + 1, *a.shape)), np.empty((2, a.shape[0]))
    precise.double_up(a, step, levels)
    piecewise.slip_rows(a, rows)
    rate = -rows[0, piecewise.SLIP]
    z, y = piecewise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(a.shape[0])
    best, position, level = abs(z[piecewise.SLIP]), 0, 0
    bound = 0.0
    for _ in range(MOST_INTERVALS):
        if position == 0 and level == 0:
            if piecewise.stays_slower(p, k2, z, rate, best):
                return best, at.OK
            bound = piecewise.bound_motion(p, k2, z, 0, 0, 0, 1.0, step, False)[1]
        w, h = z[piecewise.SLIP], step * 0.5**level
        after = w + piecewise.row_times(levels[level, piecewise.SLIP], z)
        second = abs(piecewise.row_times(rows[1], z))
        bend = min(second + h * bound, max(second, bound / rate))
        within = max(_highest(w, after, h, bend), _highest(-w, -after, h, bend))
        if level < depth and within > max(best, abs(after)) * (1.0 + RESOLVED):
            level += 1
            continue
        piecewise.take(levels[level], z, y)
        best = max(best, abs(z[piecewise.SLIP]))
        position += 1 << (depth - level)
        level = piecewise.next_level(position, level, depth)
        if position == 1 << depth:
            position = 0
    return math.nan, at.TOO_MANY_EVENTS


@kernel
def _highest(w, after, h, bend):
    """Return a bound of w over an interval: its chord and at most t (h - t) / 2 |w''| above it."""
    rise, sag = after - w, 0.5 * h * h * bend
    if abs(rise) >= sag:
        return max(w, after)
    return 0.5 * (w + after) + 0.25 * sag + 0.25 * rise * rise / sag
