"""Motion of linear plants and its deviations, LANES lanes at a time.

Motion and deviations by parameters are Taylor series of the exponential. A deviation is driven by
the motion: the derivative of the exponential along that of its generator, without a matrix of twice
the size. Najfeld and Havel, *Derivatives of the matrix exponential and their computation*, Adv.
Appl. Math. 16 (1995).

Deviations by the state at a control step's start and by the force held in it do not depend on the
motion. All follow from the responses to a held acceleration of either mass: a displaced mass is
pushed by a held force, and the response to a velocity is the slope of that to an acceleration.

States and series are those of `mm_gym.law.linear_motion`; the unit of time is a piece of the sample
interval. Arguments of several kernels: `b`, rows of vectors, room for the series of a group of
lanes; `g`, the generator; `weights`, 1 / n!; `piece` [s]; `i, count`, the lanes i .. i + count - 1.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.groups import read, write, write_state
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, alike, everywhere
from mm_gym.lanes.simd_memory import from_row, rows_of, rows_on_stack
from mm_gym.lanes.tangents import slopes_of, tangent, tangents_of, value_of
from mm_gym.law.linear_motion import add, derivative, generator, state_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness
from mm_gym.methods.linear_series.kernel import (
    FORCE,
    GROUND,
    HARMONIC,
    continue_drive,
    load_drive,
    parameters_of,
    rows_of_drive,
    write_drive,
)
from mm_gym.sensitivity.columns_kernel import (
    ACCELERATION,
    COUPLING,
    OFFSET,
    ORDERS,
    V1,
    X1,
    W,
    read_column,
    read_rows,
    slope,
    take_impulses,
    write_column,
)
from mm_gym.sensitivity.layout import (
    CAUSES,
    DEGREE,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    MOST_SERIES,
    PIECES,
    STATES,
    STEP_DEGREE,
    STEP_PIECES,
    TANGENTS,
    TIME,
    WIDTH,
)

# Rows of b behind the series of the motion: what an amplitude, frequency or phase drives; then what
# excites the lanes.
_SIGNAL, _DRIVE = 4 * ORDERS, 5 * ORDERS

_lane = rows_on_stack(2 * (layout.HARMONICS + STATES))


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval."""
    if model[PIECES] > MOST_SERIES:
        return layout.TOO_MANY_SERIES
    rows = _DRIVE + rows_of_drive(model)
    scratch, weights, status = on_cache_line(rows * LANES), weights_of(ORDERS), layout.OK
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        status = max(status, _propagate(model, lanes, weights, rows_of(scratch), i, count))
    return status


@borrowing_kernel
def _propagate(model, lanes, weights, b, i, count):
    """Advance a group of lanes; return their status."""
    prefer_widest_vectors()
    pieces, degree, width = int(model[PIECES]), int(model[DEGREE]), int(model[WIDTH])
    own, drive = int(model[FIRST_ROW]), from_row(b, _DRIVE)
    piece = model[layout.SAMPLE_INTERVAL] / pieces
    g, by_m1 = _coefficients(lanes, piece, i, count)
    scale = piece * piece * by_m1
    pair, held = control_forces(model, scale * read(lanes, layout.FORCE, i, count))
    take_impulses(model, lanes, by_m1, i, count)
    load_drive(model, lanes, drive, pieces, i, count)
    z = state_of(lanes, piece, i, count)
    for k in range(pieces):
        terms = write_drive(model, lanes, drive, scale, piece, degree, i, count)
        z = _move(b, g, weights, z, (held, pair), degree, terms)
        for j in range(STATES, width):
            if model[CAUSES + j] != layout.FORCE:
                cause, column = int(model[CAUSES + j]), own + TANGENTS + j
                row, to_v1, to_w = _drive(model, lanes, b, cause, piece, k, i, count)
                y = read_column(lanes, column, width, piece, i, count)
                y = _deviate(b, g, weights, row, to_v1, to_w, degree, y)
                write_column(lanes, column, width, 1.0 / piece, y, i, count)
        if k < pieces - 1:
            continue_drive(model, lanes, drive, piece, degree, i, count)
    v1, v2 = z[2] * (1.0 / piece), (z[2] + z[3]) * (1.0 / piece)
    write(lanes, own + LAST_V1, i, count, v1)
    write(lanes, own + LAST_V2, i, count, v2)
    time = read(lanes, own + TIME, i, count) + model[layout.SAMPLE_INTERVAL]
    write(lanes, own + TIME, i, count, time)
    return write_state(lanes, i, count, z[0], z[0] + z[1], v1, v2)


@borrowing_kernel
def _move(b, g, weights, z, forces, degree, terms):
    """Return where a piece ends, and write the motion's series; what excites has so many terms."""
    prefer_widest_vectors()
    total, drive, zero = z, from_row(b, _DRIVE), everywhere(0.0)
    (push, pair), b[X1], b[OFFSET] = forces, z[0], z[1]
    for n in range(degree):
        b[V1 + n], b[W + n] = z[2], z[3]
        if n < terms:
            push = push + drive[FORCE + n]
        z, b[COUPLING + n] = derivative(g, z, push, pair)
        b[ACCELERATION + n] = z[2]
        if n < terms:
            z = z[0], z[1], z[2] - drive[GROUND + n], z[3]
        total = add(total, weights[n + 1], z)
        push = pair = zero
    return total


@borrowing_kernel
def _drive(model, lanes, b, cause, piece, k, i, count):
    """Return which series drives the deviation of a parameter in piece k, and its factors."""
    if cause < layout.HARMONICS:
        m1, m2 = read(lanes, layout.M1, i, count), read(lanes, layout.M2, i, count)
        k1, alpha = read(lanes, layout.K1, i, count), read(lanes, layout.ALPHA, i, count)
        k0, stretch = read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count)
        return slope(cause, (m1, m2, k1, alpha, k0, stretch), piece)
    _write_signal(model, lanes, b, cause, piece, k, i, count)
    if (int(model[layout.GROUND]) >> ((cause - layout.HARMONICS) // layout.HARMONIC_ROWS)) & 1:
        return _SIGNAL, everywhere(-piece * piece), everywhere(0.0)
    scale = piece * piece / read(lanes, layout.M1, i, count)
    return _SIGNAL, scale, -scale


@borrowing_kernel
def _write_signal(model, lanes, b, cause, piece, k, i, count):
    """Write the slope of a harmonic over its amplitude, frequency or phase, as `_drive` asks."""
    which, own = (cause - layout.HARMONICS) // layout.HARMONIC_ROWS, int(model[FIRST_ROW])
    harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * which
    row = _DRIVE + HARMONIC + 2 * which
    cosine, sine = b[row], b[row + 1]
    turn = piece * read(lanes, harmonic + layout.FREQUENCY, i, count)
    amplitude = read(lanes, harmonic + layout.AMPLITUDE, i, count)
    time, before = read(lanes, own + TIME, i, count) + k * piece, everywhere(0.0)
    for n in range(int(model[DEGREE])):
        if cause == harmonic + layout.AMPLITUDE:
            b[_SIGNAL + n] = sine
        elif cause == harmonic + layout.PHASE:
            b[_SIGNAL + n] = amplitude * cosine
        else:  # time times the slope over the phase
            b[_SIGNAL + n] = amplitude * fma(time, cosine, n * piece * before)
        before, cosine, sine = cosine, -turn * sine, turn * cosine


@inlined_kernel
def _coefficients(lanes, piece, i, count):
    """Return the generator's coefficients in units of a piece, and 1 / m1."""
    m1, m2, k1, d, c, k0 = parameters_of(lanes, i, count)
    k2 = stiffness(k0, read(lanes, layout.STRETCH, i, count))
    return generator(piece, m1, m2, k1, d, c, k2), 1.0 / m1


@kernel
def weights_of(count):
    """Return 1 / n! of the terms before the given one."""
    weights = np.empty(count)
    weights[0] = 1.0
    for n in range(1, count):
        weights[n] = weights[n - 1] / n
    return weights


@borrowing_kernel
def _deviate(b, g, weights, row, to_v1, to_w, degree, z):
    """Return a column z at a piece's end, driven by the series in b from `row` on."""
    prefer_widest_vectors()
    total = z
    for n in range(degree):
        z, _ = derivative(g, z, 0.0, 0.0)
        z = z[0], z[1], fma(to_v1, b[row + n], z[2]), fma(to_w, b[row + n], z[3])
        total = add(total, weights[n + 1], z)
    return total


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
    piece = model[layout.SAMPLE_INTERVAL] * model[layout.INTERVALS] / pieces
    g, by_m1 = _coefficients(lanes, piece, i, count)
    zero, one = everywhere(0.0), everywhere(1.0)
    carriage, sphere = (zero, zero, one, -one), (zero, zero, zero, one)
    once = _held(g, weights, carriage, degree), _held(g, weights, sphere, degree)
    by_carriage, by_sphere = once
    for _ in range(pieces - 1):
        by_carriage = _sum(once[0], _continued(g, once, by_carriage))
        by_sphere = _sum(once[1], _continued(g, once, by_sphere))
    both, row = (by_carriage, by_sphere), int(model[FIRST_ROW]) + TANGENTS
    way, rate = everywhere(piece), 1.0 / piece
    x1, x2 = (one, -one, zero, zero), (zero, one, zero, zero)
    v1, v2 = (zero, zero, way, -way), (zero, zero, zero, way)
    write_column(lanes, row, width, rate, _continued(g, both, x1), i, count)
    write_column(lanes, row + 1, width, rate, _continued(g, both, x2), i, count)
    write_column(lanes, row + 2, width, rate, _continued(g, both, v1), i, count)
    write_column(lanes, row + 3, width, rate, _continued(g, both, v2), i, count)
    for j in range(STATES, width):
        if model[CAUSES + j] == layout.FORCE:
            push = piece * piece * by_m1
            pull = -model[layout.BETWEEN] * g[4] * push  # of the sphere, by its reaction
            z = add(add((zero, zero, zero, zero), push, by_carriage), pull, by_sphere)
            write_column(lanes, row + j, width, rate, z, i, count)


@borrowing_kernel
def _held(g, weights, z, degree):
    """Return the response to an acceleration z that is held, from rest."""
    prefer_widest_vectors()
    zero = everywhere(0.0)
    total = add((zero, zero, zero, zero), weights[1], z)
    for n in range(1, degree):
        z, _ = derivative(g, z, 0.0, 0.0)
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
    total = add(total, v1, derivative(g, by_carriage, 0.0, 0.0)[0])
    return add(total, speed2, derivative(g, by_sphere, 0.0, 0.0)[0])


@inlined_kernel
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):
    """Add to lane i what follows from velocities [m/s] at rest, a time [s] later."""
    own, width, c = int(model[FIRST_ROW]), int(model[WIDTH]), tangents_of(_lane())
    for first in range(0, width, LANES):
        read_rows(model, lanes, i, 0, layout.HARMONICS, c, first)
        end = _response(model, c, time, v1, v2)
        for part in range(STATES):
            c[layout.HARMONICS + part] = end[part]
            for j in range(min(width - first, LANES)):
                row = own + TANGENTS + part * width + first + j
                lanes[row, i] += c[layout.HARMONICS + part, j]
    for part in range(STATES):
        lanes[part, i] += value_of(c[layout.HARMONICS + part])
    lanes[own + LAST_V1, i] += value_of(c[layout.HARMONICS + layout.V1])
    lanes[own + LAST_V2, i] += value_of(c[layout.HARMONICS + layout.V2])


@borrowing_kernel
def _response(model, lane, time, v1, v2):
    """Return x1, x2, v1 and v2 from those of a lane's rows, all as numbers with tangents."""
    piece, m1 = time / model[PIECES], lane[layout.M1]
    k1, k2 = lane[layout.K1] * lane[layout.ALPHA], stiffness(lane[layout.K0], lane[layout.STRETCH])
    g = generator(piece, m1, lane[layout.M2], k1, lane[layout.D], lane[layout.C], k2)
    # The impulse on the carriage changed v1 by its size over the mass.
    late, rest = slopes_of((v1 - v2) * value_of(m1) * (piece / m1)), alike(m1, 0.0)
    total = rest, rest, tangent(piece * v1, late), tangent(piece * (v2 - v1), -late)
    for _ in range(int(model[PIECES])):
        term, weight = total, 1.0
        for n in range(int(model[DEGREE])):
            weight /= n + 1.0
            term, _coupling = derivative(g, term, 0.0, 0.0)
            total = add(total, weight, term)
    x1, offset, way, slip = total
    return x1, x1 + offset, way * (1.0 / piece), (way + slip) * (1.0 / piece)
