"""The free motion of a linear plant after an impulse, as a Taylor series of the exponential."""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.bounds import fastest_rate
from mm_gym.law.springs import stiffness

ROUND_OFF = 2.0**-56
"""Size below which a term of the series changes nothing."""


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):  # noqa: ARG001 - methods with a model of it read that
    """Add to the state of a lane its free motion after given velocities at rest.

    Parameters
    ----------
    model
        Unused.
    lanes
        (rows, lanes) float64; parameters are read, the state is written.
    time
        How long the motion lasts [s].
    v1, v2
        Velocities at its start [m/s].
    i
        The lane.
    """
    m1, m2, d, c = lanes[at.M1, i], lanes[at.M2, i], lanes[at.D, i], lanes[at.C, i]
    k1, k2 = lanes[at.K1, i] * lanes[at.ALPHA, i], stiffness(lanes[at.K0, i], lanes[at.STRETCH, i])
    per_mass, both = 1.0 / m1, 1.0 + m1 / m2
    phase = fastest_rate(m1, m2, k1, k2, c, d) * time
    pieces = max(1, math.ceil(phase))
    piece, phase = time / pieces, phase / pieces
    k1, k2, d, c = k1 * per_mass, k2 * per_mass, d * per_mass, c * per_mass
    # Offset and slip velocity in place of x2 and v2: they need fewer operations.
    x1, offset, w = 0.0, 0.0, v2 - v1
    for _ in range(pieces):
        x1_term, offset_term, v1_term, w_term = x1, offset, v1, w
        n, bound = 0.0, 1.0
        while bound > ROUND_OFF:
            n += 1.0
            step, bound = piece / n, bound * (phase / n)
            coupling = fma(c, w_term, k2 * offset_term)
            outer = fma(d, v1_term, k1 * x1_term)
            x1_term, offset_term = step * v1_term, step * w_term
            v1_term = step * (coupling - outer)  # (1) of docs/model.md
            w_term = step * fma(-both, coupling, outer)  # (2) less (1)
            x1, offset, v1, w = x1 + x1_term, offset + offset_term, v1 + v1_term, w + w_term
    lanes[at.X1, i] += x1
    lanes[at.X2, i] += x1 + offset
    lanes[at.V1, i] += v1
    lanes[at.V2, i] += v1 + w
