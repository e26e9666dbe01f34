"""Deviations of linear plants by the state at a control step's start and by the force held in it.

They do not depend on the motion. All follow from the responses to a held acceleration of either
mass: a displaced mass is pushed by a held force, and the response to a velocity is the slope of
that to an acceleration.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.sensitivity.generator_kernel import (
    ORDERS,
    add,
    coefficients,
    derivative,
    weights_of,
    write_column,
)
from mm_gym.sensitivity.layout import (
    CAUSES,
    FIRST_ROW,
    MOST_SERIES,
    PIECES,
    STATES,
    STEP_DEGREE,
    STEP_PIECES,
    TANGENTS,
    WIDTH,
)


@kernel
def write_held(model, lanes, first, last):
    """Write the deviations by the state and the force of a control step that has been made."""
    if model[PIECES] > MOST_SERIES:
        return
    weights = weights_of(ORDERS)
    for i in range(first, last, LANES):
        _write_held(model, lanes, weights, i, min(LANES, last - i))


@borrowing_kernel
def _write_held(model, lanes, weights, i, count):
    """Write those of the lanes i .. i + count - 1, with 1 / n! (ORDERS,)."""
    prefer_widest_vectors()
    pieces, degree, width = int(model[STEP_PIECES]), int(model[STEP_DEGREE]), int(model[WIDTH])
    piece = model[at.SAMPLE_INTERVAL] * model[at.INTERVALS] / pieces
    g, by_m1 = coefficients(lanes, piece, i, count)
    zero, one = everywhere(0.0), everywhere(1.0)
    carriage, sphere = (zero, zero, one, -one), (zero, zero, zero, one)
    once = _held(g, weights, carriage, degree), _held(g, weights, sphere, degree)
    by_carriage, by_sphere = once
    for _ in range(pieces - 1):
        by_carriage = _sum(once[0], _continued(g, once, by_carriage))
        by_sphere = _sum(once[1], _continued(g, once, by_sphere))
    both, row = (by_carriage, by_sphere), int(model[FIRST_ROW]) + TANGENTS
    rest = everywhere(piece)
    write_column(lanes, row, width, piece, i, count, _continued(g, both, (one, -one, zero, zero)))
    write_column(
        lanes, row + 1, width, piece, i, count, _continued(g, both, (zero, one, zero, zero))
    )
    write_column(
        lanes, row + 2, width, piece, i, count, _continued(g, both, (zero, zero, rest, -rest))
    )
    write_column(
        lanes, row + 3, width, piece, i, count, _continued(g, both, (zero, zero, zero, rest))
    )
    for j in range(STATES, width):
        if model[CAUSES + j] == at.FORCE:
            push = piece * piece * by_m1
            pull = -model[at.BETWEEN] * g[4] * push  # of the sphere, by its reaction
            z = add(add((zero, zero, zero, zero), push, by_carriage), pull, by_sphere)
            write_column(lanes, row + j, width, piece, i, count, z)


@borrowing_kernel
def _held(g, weights, z, degree):
    """Return the response to an acceleration z that is held, from rest."""
    prefer_widest_vectors()
    zero = everywhere(0.0)
    total = add((zero, zero, zero, zero), weights[1], z)
    for n in range(1, degree):
        z, _ = derivative(g, z, zero)
        total = add(total, weights[n + 1], z)
    return total


@inlined_kernel
def _continued(g, held, z):
    """Return what becomes of a deviation while two accelerations had these responses."""
    k1, _, _, k2, ratio = g
    x1, offset, v1, w = z
    by_carriage, by_sphere = held
    pull, speed2 = k2 * offset, v1 + w
    total = add(z, fma(-k1, x1, pull), by_carriage)
    total = add(total, -ratio * pull, by_sphere)
    zero = everywhere(0.0)
    total = add(total, v1, derivative(g, by_carriage, zero)[0])
    return add(total, speed2, derivative(g, by_sphere, zero)[0])


@inlined_kernel
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]
