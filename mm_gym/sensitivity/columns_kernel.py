"""Lanes as numbers with tangents: read with their deviations, and written.

A number has a slope in each column of deviations. Those of the state are its deviations; a
parameter has the slope 1 in the columns that it is the cause of.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.tangents import slopes_of, tangent, value_of
from mm_gym.law.interface import state_row
from mm_gym.sensitivity.layout import (
    CAUSES,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    TANGENTS,
    TIME,
    WIDTH,
)


@borrowing_kernel
def read_rows(model, lanes, i, row, count, c, first):
    """Read rows of lane i, from `row` on, as the first numbers of c.

    Their slopes are those in the columns from `first` on.
    """
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
    impulse = lanes[at.V1, i] - lanes[own + LAST_V1, i]
    impulse -= lanes[at.V2, i] - lanes[own + LAST_V2, i]
    if impulse != 0.0:
        for j in range(width):
            if int(model[CAUSES + j]) == at.M1:
                c[at.V1, j] = c[at.V1, j] - impulse / lanes[at.M1, i]


@borrowing_kernel
def write_state(model, lanes, i, states, c):
    """Write the first numbers of c as the state of lane i at the end of a propagation."""
    own, width = int(model[FIRST_ROW]), int(model[WIDTH])
    for part in range(states):
        lanes[state_row(model, part, states), i] = value_of(c[part])
        for j in range(width):
            lanes[own + TANGENTS + part * width + j, i] = c[part, j]
    lanes[own + LAST_V1, i], lanes[own + LAST_V2, i] = lanes[at.V1, i], lanes[at.V2, i]
    lanes[own + TIME, i] += model[at.SAMPLE_INTERVAL]


@borrowing_kernel
def read_harmonic(model, lanes, i, which, c):
    """Read a harmonic's amplitude and frequency, and cosine and sine of its phase, into c."""
    row = at.HARMONICS + at.HARMONIC_ROWS * which
    read_rows(model, lanes, i, row, 3, c, 0)
    since = lanes[int(model[FIRST_ROW]) + TIME, i]
    turn = slopes_of(c[at.PHASE]) + slopes_of(c[at.FREQUENCY]) * since
    cosine, sine = lanes[row + at.COSINE, i], lanes[row + at.SINE, i]
    c[2], c[3] = tangent(cosine, turn * -sine), tangent(sine, turn * cosine)
