"""The motion of a linear plant as a Taylor series, over every kind of number.

States are x1, the offset, v1 and the slip velocity: offset and slip velocity need fewer operations
than x2 and v2. The unit of time is a piece of the motion, so that all states are in metres and the
generator has no unit. Terms of a series are derivatives, the n-th weighed by 1 / n!.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.groups import read
from mm_gym.law.bounds import fastest_rate
from mm_gym.law.springs import stiffness

ROUND_OFF = 2.0**-56
"""Size below which a term of the series changes nothing."""


@inlined_kernel
def generator(piece, m1, m2, k1, d, c, k2):
    """Return the generator's coefficients in units of a piece [s], and m1 / m2."""
    rate = piece / m1
    return piece * rate * k1, rate * d, rate * c, piece * rate * k2, m1 / m2


@inlined_kernel
def state_of(lanes, piece, i, count):
    """Return the state of the lanes i .. i + count - 1."""
    x1, v1 = read(lanes, layout.X1, i, count), read(lanes, layout.V1, i, count)
    offset, w = read(lanes, layout.X2, i, count) - x1, read(lanes, layout.V2, i, count) - v1
    return x1, offset, piece * v1, piece * w


@inlined_kernel
def derivative(g, z, push, pair):
    """Return the time derivative of a state, and the force between the masses over m1.

    `push` and `pair` are what else drives it, on the carriage and between the masses, over m1.
    """
    k1, d, c, k2, ratio = g
    x1, offset, v1, w = z
    coupling = fma(c, w, fma(k2, offset, pair))
    outer = fma(d, v1, fma(k1, x1, -push))
    # (1) of docs/model.md, and (2) less (1), neither of which waits for the other
    return (v1, w, coupling - outer, fma(-(1.0 + ratio), coupling, outer)), coupling


@inlined_kernel
def add(total, weight, z):
    """Return the total with a term added."""
    return (
        fma(weight, z[0], total[0]),
        fma(weight, z[1], total[1]),
        fma(weight, z[2], total[2]),
        fma(weight, z[3], total[3]),
    )


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):  # noqa: ARG001 - other methods read their models
    """Add to the state of lane i its free motion for a time [s] after velocities [m/s] at rest."""
    m1, m2, d, c = lanes[layout.M1, i], lanes[layout.M2, i], lanes[layout.D, i], lanes[layout.C, i]
    k1, k2 = (
        lanes[layout.K1, i] * lanes[layout.ALPHA, i],
        stiffness(lanes[layout.K0, i], lanes[layout.STRETCH, i]),
    )
    phase = fastest_rate(m1, m2, k1, k2, c, d) * time
    pieces = max(1, math.ceil(phase))
    piece, phase = time / pieces, phase / pieces
    g = generator(piece, m1, m2, k1, d, c, k2)
    y = 0.0, 0.0, piece * v1, piece * (v2 - v1)
    for _ in range(pieces):
        z, n, weight, bound = y, 0.0, 1.0, 1.0
        while bound > ROUND_OFF:
            n += 1.0
            weight, bound = weight / n, bound * (phase / n)
            z, _ = derivative(g, z, 0.0, 0.0)
            y = add(y, weight, z)
    lanes[layout.X1, i] += y[0]
    lanes[layout.X2, i] += y[0] + y[1]
    lanes[layout.V1, i] += y[2] / piece
    lanes[layout.V2, i] += (y[2] + y[3]) / piece
