"""What parameters do to the motion of plants with linear dampers and springs between the masses.

States are x1, the offset, v1 and the slip velocity. The unit of time is a piece of the motion, and
term n of a series is the n-th derivative: that of x1 is the one of v1 before it. All of it takes
numbers of one lane, or vectors.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.simd import alike
from mm_gym.law.springs import stiffness
from mm_gym.sensitivity.layout import (
    CAUSES,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    STATES,
    TANGENTS,
    WIDTH,
)

ORDERS = 48
"""As many as `mm_gym.methods.linear_series.kernel` has at most."""

# Rows of the motion's series: x1 and v1, the offset and the slip velocity, the carriage's
# acceleration but for the ground's, the force between the masses over m1.
X1, OFFSET, ACCELERATION, COUPLING = 0, ORDERS, 2 * ORDERS, 3 * ORDERS
V1, W = X1 + 1, OFFSET + 1


@borrowing_kernel
def take_impulses(model, lanes, by_m1, i, count):
    """Let the carriage's mass deviate in impulses on it since the last propagation.

    They changed v1 by size / m1; those of the ground change both velocities alike.
    """
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    for j in range(STATES, width):
        if model[CAUSES + j] == at.M1:
            change = read(lanes, at.V1, i, count) - read(lanes, own + LAST_V1, i, count)
            change2 = read(lanes, at.V2, i, count) - read(lanes, own + LAST_V2, i, count)
            impulse = change - change2
            row = own + TANGENTS + j + 2 * width
            write(lanes, row, i, count, fma(-by_m1, impulse, read(lanes, row, i, count)))


@inlined_kernel
def slope(cause, parameters, piece):
    """Return which series drives the deviation of a parameter but a harmonic's, and its factors.

    They are those in the accelerations of x1 and of the offset: the slopes of (1) and (2) of
    docs/model.md over the parameter.

    Parameters
    ----------
    cause
        Row of the parameter.
    parameters
        m1, m2 [kg], k1 [N/m], alpha, k0 [N/m] and stretch.
    piece
        Length of a piece [s].
    """
    m1, m2, k1, alpha, k0, stretch = parameters
    by_m1 = 1.0 / m1
    rate, both = piece * by_m1, -1.0 - m1 / m2
    scale = piece * rate
    if cause == at.M1:
        return ACCELERATION, -by_m1, by_m1
    if cause == at.M2:
        return COUPLING, alike(m1, 0.0), m1 / (m2 * m2)
    if cause == at.D:
        return V1, -rate, rate
    if cause == at.C:
        return W, rate, both * rate
    if cause == at.K1:
        return X1, -scale * alpha, scale * alpha
    if cause == at.ALPHA:
        return X1, -scale * k1, scale * k1
    if cause == at.K0:
        factor = scale * stiffness(1.0, stretch)
    else:
        square = stretch * stretch
        factor = -12.0 * scale * k0 / (square * square)
    return OFFSET, factor, both * factor
