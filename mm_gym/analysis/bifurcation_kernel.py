"""Where the sphere comes to rest under dry friction: each scene is followed to its final stick."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel
from mm_gym.simulation.energy import precise_integration_kernel as precise

MOST_INTERVALS = 1_000_000
"""Intervals tried before giving up: some 0.2 s."""

BLOCK_PHASE = 0.5
"""Carriage frequency times the first level's step."""


@kernel
def final_offsets(lanes, first, last, offsets):
    """Write x2 - x1 at rest [m] of the lanes first .. last - 1 and return the status."""
    status = at.OK
    for i in range(first, last):
        p = lanes[:, i].copy()
        offsets[i], code = final_offset(p)
        status = max(status, code)
    return status


@kernel
def final_offset(p):
    """Return the offset at rest of one free motion, and the status."""
    k2 = precise.stiffness_of(p[at.K0], p[at.STRETCH])
    m1, m2, vr = precise.carriage_mass(p), p[at.M2], p[at.VR]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(precise.FINEST, precise.halvings(precise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > precise.DEEPEST:
        return math.nan, at.TOO_MANY_EVENTS
    levels = np.zeros((2, depth + 1, precise.HARMONICS, precise.HARMONICS))
    rows, bounds = np.empty((2, 2, precise.HARMONICS)), np.empty((2, 2))
    for regime in range(2):
        a = precise.generator(p, k2, 0, 0, 0, 1.0, regime == 1)
        precise.double_up(a, step, levels[regime])
        precise.slip_rows(a, rows[regime])
    z, y = precise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(precise.HARMONICS)
    position, level, end = 0, 0, 1 << depth
    for _ in range(MOST_INTERVALS):
        if position == 0 and level == 0:
            if z[precise.SIGN] == 0.0 and sticks_for_good(p, k2, z, -rows[0, 0, precise.SLIP]):
                momentum = m2 * (z[precise.COMMON] + m1 / (m1 + m2) * z[precise.SLIP])
                return (
                    0.0 if k2 > 0.0 else z[precise.OFFSET] + momentum / precise.damping_of(p)
                ), at.OK
            for regime in range(2):
                bounds[regime, 0], bounds[regime, 1] = precise.bound_motion(
                    p, k2, z, 0, 0, 0, 1.0, step, regime == 1
                )
        if not precise.attempt(vr, levels, rows, bounds, z, y, level, step):
            level += 1
            continue
        position += 1 << (depth - level)
        level = precise.next_level(position, level, depth)
        if position == end:
            position = 0
    return math.nan, at.TOO_MANY_EVENTS


@kernel
def sticks_for_good(p, k2, z, rate):
    """Tell whether the energy left is too little to slip.

    Either sqrt(2 E / m_r), the fastest w of this energy, or |g| / rate stays below v_r.
    """
    m1, m2, k1, d, vr = (
        precise.carriage_mass(p),
        p[at.M2],
        p[at.K1] * p[at.ALPHA],
        p[at.D],
        p[at.VR],
    )
    total = m1 + m2
    reduced = m1 * m2 / total
    root = precise.energy_root(p, k2, z)
    if root <= vr * math.sqrt(reduced):
        return True
    # The largest g = (k1 x1 + d V) / m1 - k2 offset / m_r on the ellipsoid of this energy.
    drive = root * math.sqrt(k1 / m1**2 + (d / m1) ** 2 / total + k2 / reduced**2)
    return abs(z[precise.SLIP]) <= vr and drive <= rate * vr
