"""The fastest slip of a free linear motion: branch and bound on the ladder of doubled steps."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import ladder
from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel

BLOCK_PHASE = 0.5
MOST_INTERVALS = 1_000_000
"""Intervals tried before giving up: some 0.2 s."""

RESOLVED = 2.0**-56
"""Share of the peak that an interval not searched further may hide."""


@kernel
def fastest_slip(p):
    """Return the largest |w| [m/s] with a viscous interface of damping p[C], and the status."""
    p[at.VR] = 0.0  # the linear system
    k2 = ladder.stiffness_of(p[at.K0], p[at.STRETCH])
    m1, m2 = ladder.carriage_mass(p), p[at.M2]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(ladder.FINEST, ladder.halvings(ladder.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > ladder.DEEPEST:
        return math.nan, at.TOO_MANY_EVENTS
    a = ladder.generator(p, k2, 0, 0, 0, 1.0, False)
    rungs, rows = np.zeros((depth + 1, *a.shape)), np.empty((2, a.shape[0]))
    ladder.climb(a, step, rungs)
    ladder.slip_rows(a, rows)
    rate = -rows[0, ladder.SLIP]
    z, y = ladder.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(a.shape[0])
    best, position, rung = abs(z[ladder.SLIP]), 0, 0
    bound = 0.0
    for _ in range(MOST_INTERVALS):
        if position == 0 and rung == 0:
            if _is_past(p, k2, z, rate, best):
                return best, at.OK
            bound = ladder.bound_motion(p, k2, z, 0, 0, 0, 1.0, step, False)[1]
        w, h = z[ladder.SLIP], step * 0.5**rung
        after = w + ladder.row_times(rungs[rung, ladder.SLIP], z)
        second = abs(ladder.row_times(rows[1], z))
        bend = min(second + h * bound, max(second, bound / rate))
        within = max(_highest(w, after, h, bend), _highest(-w, -after, h, bend))
        if rung < depth and within > max(best, abs(after)) * (1.0 + RESOLVED):
            rung += 1
            continue
        ladder.take(rungs[rung], z, y)
        best = max(best, abs(z[ladder.SLIP]))
        position += 1 << (depth - rung)
        rung = ladder.next_rung(position, rung, depth)
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
    m1, m2, k1, d = ladder.carriage_mass(p), p[at.M2], p[at.K1] * p[at.ALPHA], p[at.D]
    total = m1 + m2
    reduced = m1 * m2 / total
    root = ladder.energy_root(p, k2, z)
    if root <= best * math.sqrt(reduced):
        return True
    drive = root * math.sqrt(k1 / m1**2 + (d / m1) ** 2 / total + k2 / reduced**2)
    return drive <= rate * best
