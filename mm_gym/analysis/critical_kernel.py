"""The test whether dry friction slips at all in a free motion, on the levels of doubled steps."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.analysis.bifurcation_kernel import BLOCK_PHASE, MOST_INTERVALS
from mm_gym.compiler.jit import kernel
from mm_gym.lanes import layout as at
from mm_gym.law.springs import stiffness
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy import precise_integration_kernel as precise


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
