"""Motions under dry friction, followed until it is proved that the sphere sticks or slips."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.lanes import layout
from mm_gym.law.springs import stiffness
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy import precise_integration_kernel as precise

MOST_INTERVALS = 1_000_000  # intervals tried before giving up: some 0.2 s
BLOCK_PHASE = 0.5  # carriage frequency times the first level's step


@kernel
def final_offsets(lanes, first, last, offsets):
    """Write x2 - x1 at rest [m] of the lanes first .. last - 1 and return the status."""
    status = layout.OK
    for i in range(first, last):
        _, offsets[i], code = _follow(lanes[:, i].copy(), 2)
        status = max(status, code)
    return status


@kernel
def sticks_throughout(p):
    """Tell whether dry friction never slips in the free motion, and return the status."""
    sticks, _, status = _follow(p, 1)
    return sticks, status


@kernel
def _follow(p, regimes):
    """Follow a motion until it sticks for good, or with one regime slips: that, offset, status."""
    k2 = stiffness(p[layout.K0], p[layout.STRETCH])
    m1, m2 = piecewise.carriage_mass(p), p[layout.M2]
    vr, size = p[layout.VR], piecewise.size_of(0, 0)
    step = BLOCK_PHASE / math.sqrt(p[layout.K1] * p[layout.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(piecewise.FINEST, precise.halvings(piecewise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > piecewise.DEEPEST:
        return False, math.nan, layout.TOO_MANY_EVENTS
    levels = np.zeros((regimes, depth + 1, size, size))
    rows, bounds = np.empty((regimes, 2, size)), np.empty((regimes, 2))
    for regime in range(regimes):
        a = piecewise.generator(p, k2, 0, 0, 0, 1.0, regime == 1)
        precise.double_up(a, step, levels[regime])
        piecewise.slip_rows(a, rows[regime])
    z, y = piecewise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(size)
    position, level, end = 0, 0, 1 << depth
    for _ in range(MOST_INTERVALS):
        if regimes == 1 and z[piecewise.SIGN] != 0.0:
            return False, math.nan, layout.OK
        if position == 0 and level == 0:
            rate = -rows[0, 0, piecewise.SLIP]
            if z[piecewise.SIGN] == 0.0 and piecewise.stays_slower(p, k2, z, rate, vr):
                momentum = m2 * (z[piecewise.COMMON] + m1 / (m1 + m2) * z[piecewise.SLIP])
                # (8) of docs/model.md, with the slope in stick
                return (
                    True,
                    0.0 if k2 > 0.0 else z[piecewise.OFFSET] + momentum / p[layout.C],
                    layout.OK,
                )
            for regime in range(regimes):
                bounds[regime, 0], bounds[regime, 1] = piecewise.bound_motion(
                    p, k2, z, 0, 0, 0, 1.0, step, regime == 1
                )
        if not piecewise.attempt(vr, levels, rows, bounds, z, y, level, step):
            level += 1
            continue
        position += 1 << (depth - level)
        level = piecewise.next_level(position, level, depth)
        if position == end:
            position = 0
    return False, math.nan, layout.TOO_MANY_EVENTS
