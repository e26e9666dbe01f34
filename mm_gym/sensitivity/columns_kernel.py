"""The columns of deviations of one lane: read, written, and changed by impulses."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.layout import (
    CAUSES,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    STATES,
    TANGENTS,
    WIDTH,
)


@borrowing_kernel
def read_columns(model, lanes, i, t, part):
    """Read the deviations of lane i: each part of them is that many rows behind the one before."""
    first, width = int(model[FIRST_ROW]) + TANGENTS, int(model[WIDTH])
    for j in range(width):
        x1, v1 = lanes[first + j, i], lanes[first + 2 * width + j, i]
        t[0, j], t[2 * part, j] = x1, v1
        t[part, j] = lanes[first + width + j, i] - x1
        t[3 * part, j] = lanes[first + 3 * width + j, i] - v1


@borrowing_kernel
def write_columns(model, lanes, i, t, part):
    """Write them."""
    first, width = int(model[FIRST_ROW]) + TANGENTS, int(model[WIDTH])
    for j in range(width):
        lanes[first + j, i], lanes[first + 2 * width + j, i] = t[0, j], t[2 * part, j]
        lanes[first + width + j, i] = t[0, j] + t[part, j]
        lanes[first + 3 * width + j, i] = t[2 * part, j] + t[3 * part, j]


@borrowing_kernel
def take_impulses(model, lanes, i, p):
    """Let the carriage's mass deviate in impulses on it since the last propagation.

    They changed v1 by size / m1; those of the ground change both velocities alike.
    """
    own = int(model[FIRST_ROW])
    impulse = lanes[at.V1, i] - lanes[own + LAST_V1, i]
    impulse -= lanes[at.V2, i] - lanes[own + LAST_V2, i]
    if impulse != 0.0:
        width = int(model[WIDTH])
        for j in range(STATES, width):
            if model[CAUSES + j] == at.M1:
                lanes[own + TANGENTS + 2 * width + j, i] -= impulse / p[of.M1]
