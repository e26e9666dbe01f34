"""Motions under dry friction, followed until it is proved that the sphere sticks or slips."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.lanes import layout as at
from mm_gym.law.springs import stiffness
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy import precise_integration_kernel as precise

MOST_INTERVALS = 1_000_000  # intervals tried before giving up: some 0.2 s
BLOCK_PHASE = 0.5  # carriage frequency times the first level's step


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
    k2 = stiffness(p[at.K0], p[at.STRETCH])
    m1, m2, vr = piecewise.carriage_mass(p), p[at.M2], p[at.VR]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(piecewise.FINEST, precise.halvings(piecewise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > piecewise.DEEPEST:
        return math.nan, at.TOO_MANY_EVENTS
    levels = np.zeros((2, depth + 1, piecewise.HARMONICS, piecewise.HARMONICS))
    rows, bounds = np.empty((2, 2, piecewise.HARMONICS)), np.empty((2, 2))
    for regime in range(2):
        a = piecewise.generator(p, k2, 0, 0, 0, 1.0, regime == 1)
        precise.double_up(a, step, levels[regime])
        piecewise.slip_rows(a, rows[regime])
    z, y = piecewise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(piecewise.HARMONICS)
    position, level, end = 0, 0, 1 << depth
    for _ in range(MOST_INTERVALS):
        if position == 0 and level == 0:
            rate = -rows[0, 0, piecewise.SLIP]
            if z[piecewise.SIGN] == 0.0 and piecewise.stays_slower(p, k2, z, rate, vr):
                momentum = m2 * (z[piecewise.COMMON] + m1 / (m1 + m2) * z[piecewise.SLIP])
                # (8) of docs/model.md, with the slope in stick
                return 0.0 if k2 > 0.0 else z[piecewise.OFFSET] + momentum / p[at.C], at.OK
            for regime in range(2):
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
    return math.nan, at.TOO_MANY_EVENTS


@kernel
def sticks_throughout(p):
    """Tell whether dry friction never slips in the free motion, and return the status.

    The intervals and their arithmetic are those of `final_offset`, and so is the answer.
    """
    k2, vr = stiffness(p[at.K0], p[at.STRETCH]), p[at.VR]
    m1, m2 = piecewise.carriage_mass(p), p[at.M2]
    step = BLOCK_PHASE / math.sqrt(p[at.K1] * p[at.ALPHA] / m1 + k2 * (1.0 / m1 + 1.0 / m2))
    depth = max(piecewise.FINEST, precise.halvings(piecewise.fastest_rate(p, k2, 0, 0, 1.0) * step))
    if depth > piecewise.DEEPEST:
        return False, at.TOO_MANY_EVENTS
    size = piecewise.size_of(0, 0)
    levels = np.zeros((1, depth + 1, size, size))  # of one regime: what follows a slip is not asked
    rows, bounds = np.empty((1, 2, size)), np.empty((1, 2))
    a = piecewise.generator(p, k2, 0, 0, 0, 1.0, False)
    precise.double_up(a, step, levels[0])
    piecewise.slip_rows(a, rows[0])
    z, y = piecewise.start(p, p[:4], 0.0, 0, 0.0, p[:0]), np.empty(size)
    position, level = 0, 0
    for _ in range(MOST_INTERVALS):
        if z[piecewise.SIGN] != 0.0:
            return False, at.OK
        if position == 0 and level == 0:
            if piecewise.stays_slower(p, k2, z, -rows[0, 0, piecewise.SLIP], vr):
                return True, at.OK
            bounds[0, 0], bounds[0, 1] = piecewise.bound_motion(p, k2, z, 0, 0, 0, 1.0, step, False)
        if not piecewise.attempt(vr, levels, rows, bounds, z, y, level, step):
            level += 1
            continue
        position += 1 << (depth - level)
        level = piecewise.next_level(position, level, depth)
        if position == 1 << depth:
            position = 0
    return False, at.TOO_MANY_EVENTS
