"""The fastest slip of a free linear motion: branch and bound on the ladder of doubled steps."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel
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
    k2 = precise.stiffness_of(p[at.K0], p[at.STRETCH])
    m1, m2 = precise.carriage_mass(p), p[at.M2]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(precise.FINEST, precise.halvings(precise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > precise.DEEPEST:
        return math.nan, at.TOO_MANY_EVENTS
    a = precise.generator(p, k2, 0, 0, 0, 1.0, False)
    levels, rows = np.zeros((depth + 1, *a.shape)), np.empty((2, a.shape[0]))
    precise.double_up(a, step, levels)
    precise.slip_rows(a, rows)
    rate = -rows[0, precise.SLIP]
    z, y = precise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(a.shape[0])
    best, position, level = abs(z[precise.SLIP]), 0, 0
    bound = 0.0
    for _ in range(MOST_INTERVALS):
        if position == 0 and level == 0:
            if _is_past(p, k2, z, rate, best):
                return best, at.OK
            bound = precise.bound_motion(p, k2, z, 0, 0, 0, 1.0, step, False)[1]
        w, h = z[precise.SLIP], step * 0.5**level
        after = w + precise.row_times(levels[level, precise.SLIP], z)
        second = abs(precise.row_times(rows[1], z))
        bend = min(second + h * bound, max(second, bound / rate))
        within = max(_highest(w, after, h, bend), _highest(-w, -after, h, bend))
        if level < depth and within > max(best, abs(after)) * (1.0 + RESOLVED):
            level += 1
            continue
        precise.take(levels[level], z, y)
        best = max(best, abs(z[precise.SLIP]))
        position += 1 << (depth - level)
        level = precise.next_level(position, level, depth)
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


@kernel
def _is_past(p, k2, z, rate, best):
    """Tell whether the energy left is too little for a faster slip; see `kernels.bifurcation`."""
    m1, m2, k1, d = precise.carriage_mass(p), p[at.M2], p[at.K1] * p[at.ALPHA], p[at.D]
    total = m1 + m2
    reduced = m1 * m2 / total
    root = precise.energy_root(p, k2, z)
    if root <= best * math.sqrt(reduced):
        return True
    drive = root * math.sqrt(k1 / m1**2 + (d / m1) ** 2 / total + k2 / reduced**2)
    return drive <= rate * best
