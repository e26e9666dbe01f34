"""Columns of deviations: read and written with their lanes, and what parameters do to the motion.

Columns are those of x1, x2, v1 and v2, and of an interface's own states. Kernels for linear dampers
and springs between the masses take them as x1, the offset, v1 and the slip velocity, in lanes side
by side. The unit of time is a piece of the motion, and term n of a series is the n-th derivative:
that of x1 is the one of v1 before it.

Others take lanes as numbers with tangents. A number has a slope in each column of deviations. Those
of the state are its deviations; a parameter has the slope 1 in the columns that it is the cause of.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.simd import LANES, alike
from mm_gym.lanes.tangents import slopes_of, tangent, value_of
from mm_gym.law.interface import state_row
from mm_gym.law.springs import stiffness
from mm_gym.sensitivity.layout import (
    CAUSES,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    STATES,
    TANGENTS,
    TIME,
    WIDTH,
)

ORDERS = 48
"""As many as `mm_gym.methods.linear_series.kernel` has at most."""

# Rows of the motion's series: x1 and v1, the offset and the slip velocity, the carriage's
# acceleration but for the ground's, the force between the masses over m1.
X1, OFFSET, ACCELERATION, COUPLING = 0, ORDERS, 2 * ORDERS, 3 * ORDERS
V1, W = X1 + 1, OFFSET + 1


@inlined_kernel
def read_column(lanes, row, width, piece, i, count):
    """Return a column of deviations of x1, the offset, v1 and the slip velocity per piece [s]."""
    x1, x2 = read(lanes, row, i, count), read(lanes, row + width, i, count)
    v1, v2 = read(lanes, row + 2 * width, i, count), read(lanes, row + 3 * width, i, count)
    return x1, x2 - x1, piece * v1, piece * (v2 - v1)


@inlined_kernel
def write_column(lanes, row, width, rate, z, i, count):
    """Write such a column z, of so many pieces in a second."""
    write(lanes, row, i, count, z[0])
    write(lanes, row + width, i, count, z[0] + z[1])
    write(lanes, row + 2 * width, i, count, rate * z[2])
    write(lanes, row + 3 * width, i, count, rate * (z[2] + z[3]))


@borrowing_kernel
def take_impulses(model, lanes, by_m1, i, count):
    """Let the carriage's mass deviate in impulses on it since the last propagation.

    They changed v1 by size / m1; those of the ground change both velocities alike.
    """
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    for j in range(STATES, width):
        if model[CAUSES + j] == layout.M1:
            change = read(lanes, layout.V1, i, count) - read(lanes, own + LAST_V1, i, count)
            change2 = read(lanes, layout.V2, i, count) - read(lanes, own + LAST_V2, i, count)
            impulse = change - change2
            row = own + TANGENTS + j + 2 * width
            write(lanes, row, i, count, fma(-by_m1, impulse, read(lanes, row, i, count)))


@inlined_kernel
def slope(cause, parameters, piece):
    """Return which series drives the deviation of a parameter but a harmonic's, and its factors.

    They are those in the accelerations of x1 and of the offset: the slopes of (1) and (2) of
    docs/model.md over the parameter, whose row is the cause. Parameters are m1, m2 [kg], k1 [N/m],
    alpha, k0 [N/m] and stretch; a piece is a length of time [s].
    """
    m1, m2, k1, alpha, k0, stretch = parameters
    by_m1 = 1.0 / m1
    rate, both = piece * by_m1, -1.0 - m1 / m2
    scale = piece * rate
    if cause == layout.M1:
        return ACCELERATION, -by_m1, by_m1
    if cause == layout.M2:
        return COUPLING, alike(m1, 0.0), m1 / (m2 * m2)
    if cause == layout.D:
        return V1, -rate, rate
    if cause == layout.C:
        return W, rate, both * rate
    if cause == layout.K1:
        return X1, -scale * alpha, scale * alpha
    if cause == layout.ALPHA:
        return X1, -scale * k1, scale * k1
    if cause == layout.K0:
        factor = scale * stiffness(1.0, stretch)
    else:
        square = stretch * stretch
        factor = -12.0 * scale * k0 / (square * square)
    return OFFSET, factor, both * factor


@borrowing_kernel
def read_rows(model, lanes, i, row, count, c, first):
    """Read rows of lane i, from `row` on, as first numbers of c; slopes from column `first` on."""
    for k in range(count):
        c[k] = lanes[row + k, i]
    for j in range(min(int(model[WIDTH]) - first, LANES)):
        k = int(model[CAUSES + first + j]) - row
        if 0 <= k < count:
            c[k, j] = 1.0


@borrowing_kernel
def read_state(model, lanes, i, states, c):
    """Read x1, x2, v1, v2 and an interface's own states of lane i as the first numbers of c.

    Impulses on the carriage since the last propagation changed v1 by size / m1, so that its mass
    deviates in them; those of the ground change both velocities alike.
    """
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    for part in range(states):
        c[part] = lanes[state_row(model, part, states), i]
        for j in range(width):
            c[part, j] = lanes[own + TANGENTS + part * width + j, i]
    impulse = lanes[layout.V1, i] - lanes[own + LAST_V1, i]
    impulse -= lanes[layout.V2, i] - lanes[own + LAST_V2, i]
    if impulse != 0.0:
        for j in range(width):
            if int(model[CAUSES + j]) == layout.M1:
                c[layout.V1, j] = c[layout.V1, j] - impulse / lanes[layout.M1, i]


@borrowing_kernel
def write_state(model, lanes, i, states, c):
    """Write the first numbers of c as the state of lane i at the end of a propagation."""
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    for part in range(states):
        lanes[state_row(model, part, states), i] = value_of(c[part])
        for j in range(width):
            lanes[own + TANGENTS + part * width + j, i] = c[part, j]
    lanes[own + LAST_V1, i], lanes[own + LAST_V2, i] = lanes[layout.V1, i], lanes[layout.V2, i]
    lanes[own + TIME, i] += model[layout.SAMPLE_INTERVAL]


@borrowing_kernel
def read_harmonic(model, lanes, i, which, c):
    """Read a harmonic's amplitude and frequency, and cosine and sine of its phase, into c."""
    row = layout.HARMONICS + layout.HARMONIC_ROWS * which
    read_rows(model, lanes, i, row, 3, c, 0)
    since = lanes[int(model[FIRST_ROW]) + TIME, i]
    turn = slopes_of(c[layout.PHASE]) + slopes_of(c[layout.FREQUENCY]) * since
    cosine, sine = lanes[row + layout.COSINE, i], lanes[row + layout.SINE, i]
    c[2], c[3] = tangent(cosine, turn * -sine), tangent(sine, turn * cosine)
