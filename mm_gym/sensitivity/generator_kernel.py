"""The generator of a linear plant's motion and deviations, and what parameters do to it.

States are x1, the offset, v1 and the slip velocity. The unit of time is a piece of the motion, and
term n of a series is the n-th derivative: that of x1 is the one of v1 before it. All of it takes
numbers of one lane, or vectors.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.simd import alike, everywhere
from mm_gym.lanes.simd_masks import where
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

ORDERS = 32
"""More than the terms of any series: with a phase of 2, 25 are enough."""

# Rows of the motion's series: x1 and v1, the offset and the slip velocity, the carriage's
# acceleration but for the ground's, the force between the masses over m1.
X1, OFFSET, ACCELERATION, COUPLING = 0, ORDERS, 2 * ORDERS, 3 * ORDERS
V1, W = X1 + 1, OFFSET + 1


@kernel
def weights_of(count):
    """Return 1 / n! of the terms before the given one."""
    weights = np.empty(count)
    weights[0] = 1.0
    for n in range(1, count):
        weights[n] = weights[n - 1] / n
    return weights


@inlined_kernel
def coefficients(lanes, piece, i, count):
    """Return the generator's coefficients in units of a piece, and 1 / m1."""
    m1, m2, k0 = (
        read(lanes, at.M1, i, count),
        read(lanes, at.M2, i, count),
        read(lanes, at.K0, i, count),
    )
    by_m1 = 1.0 / m1
    scale = piece * by_m1
    k2 = where(k0 > 0.0, stiffness(k0, read(lanes, at.STRETCH, i, count)), 0.0)
    k1 = read(lanes, at.K1, i, count) * read(lanes, at.ALPHA, i, count)
    d, c = read(lanes, at.D, i, count), read(lanes, at.C, i, count)
    return (piece * scale * k1, scale * d, scale * c, piece * scale * k2, m1 / m2), by_m1


@inlined_kernel
def derivative(g, z, push):
    """Return the time derivative of x1, offset, v1 and slip velocity; but for push none drives it.

    Also return the force between the masses over m1.
    """
    k1, d, c, k2, ratio = g
    x1, offset, v1, w = z
    coupling = fma(c, w, k2 * offset)
    acceleration = coupling - fma(d, v1, fma(k1, x1, -push))  # (1) of docs/model.md
    return (v1, w, acceleration, fma(-ratio, coupling, -acceleration)), coupling  # (2) less (1)


@inlined_kernel
def add(total, weight, z):
    """Return the total with a term added."""
    return (
        fma(weight, z[0], total[0]),
        fma(weight, z[1], total[1]),
        fma(weight, z[2], total[2]),
        fma(weight, z[3], total[3]),
    )


@inlined_kernel
def write_column(lanes, row, width, piece, i, count, z):
    """Write a column of deviations as those of x1, x2, v1 and v2."""
    rate = 1.0 / piece
    write(lanes, row, i, count, z[0])
    write(lanes, row + width, i, count, z[0] + z[1])
    write(lanes, row + 2 * width, i, count, rate * z[2])
    write(lanes, row + 3 * width, i, count, rate * (z[2] + z[3]))


@borrowing_kernel
def deviate(b, g, weights, row, to_v1, to_w, degree, z):
    """Return a column of deviations at a piece's end.

    Parameters
    ----------
    b, g, weights, degree
        As for `_move`; read.
    row
        First row of the series that drives the deviation.
    to_v1, to_w
        Its factors in the accelerations of x1 and of the offset.
    z
        The column at the start.
    """
    prefer_widest_vectors()
    total, zero = z, everywhere(0.0)
    for n in range(degree):
        z, _ = derivative(g, z, zero)
        z = z[0], z[1], fma(to_v1, b[row + n], z[2]), fma(to_w, b[row + n], z[3])
        total = add(total, weights[n + 1], z)
    return total


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
