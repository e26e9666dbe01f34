"""Motion of linear plants and its deviations by parameters, LANES lanes at a time.

Both are Taylor series of the exponential. A deviation is driven by the motion: the derivative of
the exponential along that of its generator, without a matrix of twice the size. Najfeld and Havel,
*Derivatives of the matrix exponential and their computation*, Adv. Appl. Math. 16 (1995).

States and series are those of `generator_kernel`; the unit of time is a piece of the sample
interval.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.groups import read, write, write_state
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.motion import control_forces
from mm_gym.sensitivity.generator_kernel import (
    ACCELERATION,
    COUPLING,
    OFFSET,
    ORDERS,
    V1,
    X1,
    W,
    add,
    coefficients,
    derivative,
    deviate,
    slope,
    take_impulses,
    weights_of,
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
    TANGENTS,
    TIME,
    WIDTH,
)

# Rows of scratch behind the series of the motion: force on the carriage over m1 and the ground's
# acceleration; what an amplitude, frequency or phase drives; the force held between the masses over
# m1. Behind them cosine and sine of each harmonic, then the jets.
_FORCE, _GROUND, _SIGNAL, _PAIR = 4 * ORDERS, 5 * ORDERS, 6 * ORDERS, 7 * ORDERS
_HARMONIC = _PAIR + 1


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval."""
    if model[PIECES] > MOST_SERIES:
        return at.TOO_MANY_SERIES
    rows = _HARMONIC + 2 * int(model[at.HARMONIC_COUNT]) + 2 * int(model[at.TERMS])
    scratch, weights, status = on_cache_line(rows * LANES), weights_of(ORDERS), at.OK
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        status = max(status, _propagate(model, lanes, weights, rows_of(scratch), i, count))
    return status


@borrowing_kernel
def _propagate(model, lanes, weights, b, i, count):
    """Advance a group of lanes.

    Parameters
    ----------
    model, lanes
        (m,) read; (rows, count) read, and state and deviations written.
    weights
        (ORDERS,) read: 1 / n!.
    b
        Rows of vectors: room.
    i, count
        The lanes: count from i on.

    Returns
    -------
    int
        Status.
    """
    prefer_widest_vectors()
    pieces, degree, width = int(model[PIECES]), int(model[DEGREE]), int(model[WIDTH])
    own = int(model[FIRST_ROW])
    piece = model[at.SAMPLE_INTERVAL] / pieces
    g, by_m1 = coefficients(lanes, piece, i, count)
    take_impulses(model, lanes, by_m1, i, count)
    _load_drive(model, lanes, b, i, count)
    z = _state(lanes, piece, i, count)
    for k in range(pieces):
        terms = _write_drive(model, lanes, b, weights, by_m1, piece, i, count)
        z = _move(b, g, weights, z, degree, terms)
        for j in range(STATES, width):
            if model[CAUSES + j] != at.FORCE:
                row, to_v1, to_w = _drive(
                    model, lanes, b, int(model[CAUSES + j]), piece, k, i, count
                )
                tangent = own + TANGENTS + j
                y = _column(lanes, tangent, width, piece, i, count)
                y = deviate(b, g, weights, row, to_v1, to_w, degree, y)
                write_column(lanes, tangent, width, piece, i, count, y)
        if k < pieces - 1:
            _continue_drive(model, lanes, b, piece, i, count)
    v1, v2 = z[2] * (1.0 / piece), (z[2] + z[3]) * (1.0 / piece)
    write(lanes, own + LAST_V1, i, count, v1)
    write(lanes, own + LAST_V2, i, count, v2)
    write(
        lanes, own + TIME, i, count, read(lanes, own + TIME, i, count) + model[at.SAMPLE_INTERVAL]
    )
    return write_state(lanes, i, count, z[0], z[0] + z[1], v1, v2)


@inlined_kernel
def _state(lanes, piece, i, count):
    x1, v1 = read(lanes, at.X1, i, count), read(lanes, at.V1, i, count)
    offset, w = read(lanes, at.X2, i, count) - x1, read(lanes, at.V2, i, count) - v1
    return x1, offset, piece * v1, piece * w


@inlined_kernel
def _column(lanes, row, width, piece, i, count):
    """Return a column of deviations of x1, x2, v1 and v2 as one of this kernel's states."""
    x1, x2 = read(lanes, row, i, count), read(lanes, row + width, i, count)
    v1, v2 = read(lanes, row + 2 * width, i, count), read(lanes, row + 3 * width, i, count)
    return x1, x2 - x1, piece * v1, piece * (v2 - v1)


@borrowing_kernel
def _move(b, g, weights, z, degree, terms):
    """Return where a piece ends; write the motion's series.

    Parameters
    ----------
    b
        Rows of vectors: the drive's series are read, those of the motion written.
    g, weights
        Coefficients of the generator, and 1 / n!.
    z
        State at the start.
    degree, terms
        Of the series, and how many terms those of the drive have.
    """
    prefer_widest_vectors()
    total, zero = z, everywhere(0.0)
    b[X1], b[OFFSET] = z[0], z[1]
    for n in range(degree):
        b[V1 + n], b[W + n] = z[2], z[3]
        is_driven = n < terms
        z, coupling = derivative(g, z, b[_FORCE + n] if is_driven else zero)
        if n == 0:
            z = z[0], z[1], z[2] + b[_PAIR], fma(-1.0 - g[4], b[_PAIR], z[3])
            coupling = coupling + b[_PAIR]
        b[ACCELERATION + n], b[COUPLING + n] = z[2], coupling
        if is_driven:
            z = z[0], z[1], z[2] - b[_GROUND + n], z[3]
        total = add(total, weights[n + 1], z)
    return total


@borrowing_kernel
def _drive(model, lanes, b, cause, piece, k, i, count):
    """Return which series drives the deviation of a parameter, and its factors; see `deviate`.

    They are the slopes of (1) and (2) of docs/model.md over the parameter.

    Parameters
    ----------
    model, lanes
        (m,) and (rows, count), read.
    b
        Rows of vectors: written, if a harmonic drives it.
    cause
        Row of the parameter.
    piece, k
        Length of a piece [s], and its number.
    i, count
        The lanes: count from i on.
    """
    if cause < at.HARMONICS:
        m1, m2 = read(lanes, at.M1, i, count), read(lanes, at.M2, i, count)
        k1, alpha = read(lanes, at.K1, i, count), read(lanes, at.ALPHA, i, count)
        k0, stretch = read(lanes, at.K0, i, count), read(lanes, at.STRETCH, i, count)
        return slope(cause, (m1, m2, k1, alpha, k0, stretch), piece)
    _write_signal(model, lanes, b, cause, piece, k, i, count)
    if (int(model[at.GROUND]) >> ((cause - at.HARMONICS) // at.HARMONIC_ROWS)) & 1:
        return _SIGNAL, everywhere(-piece * piece), everywhere(0.0)
    scale = piece * piece / read(lanes, at.M1, i, count)
    return _SIGNAL, scale, -scale


@borrowing_kernel
def _write_signal(model, lanes, b, cause, piece, k, i, count):
    """Write the slope of a harmonic over its amplitude, frequency or phase.

    Parameters
    ----------
    model, lanes, b, cause, piece, k, i, count
        As for `_drive`.
    """
    which, own = (cause - at.HARMONICS) // at.HARMONIC_ROWS, int(model[FIRST_ROW])
    harmonic = at.HARMONICS + at.HARMONIC_ROWS * which
    cosine, sine = b[_HARMONIC + 2 * which], b[_HARMONIC + 2 * which + 1]
    turn = piece * read(lanes, harmonic + at.FREQUENCY, i, count)
    amplitude = read(lanes, harmonic + at.AMPLITUDE, i, count)
    time, before = read(lanes, own + TIME, i, count) + k * piece, everywhere(0.0)
    for n in range(int(model[DEGREE])):
        if cause == harmonic + at.AMPLITUDE:
            b[_SIGNAL + n] = sine
        elif cause == harmonic + at.PHASE:
            b[_SIGNAL + n] = amplitude * cosine
        else:  # time times the slope over the phase
            b[_SIGNAL + n] = amplitude * fma(time, cosine, n * piece * before)
        before, cosine, sine = cosine, -turn * sine, turn * cosine


@borrowing_kernel
def _load_drive(model, lanes, b, i, count):
    """Load the harmonics' phases, and the jets as coefficients of (t / piece)^n."""
    harmonics, terms = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS])
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        b[_HARMONIC + 2 * j] = read(lanes, harmonic + at.COSINE, i, count)
        b[_HARMONIC + 2 * j + 1] = read(lanes, harmonic + at.SINE, i, count)
    row, jet = int(model[at.JETS]), _HARMONIC + 2 * harmonics
    for k in range(2 * terms):
        b[jet + k] = read(lanes, row + k, i, count) * model[PIECES] ** -(k % terms)


@borrowing_kernel
def _continue_drive(model, lanes, b, piece, i, count):
    """Turn the harmonics by a piece, and shift both jets by it: (t + 1)^n by Horner's scheme.

    Parameters
    ----------
    model, lanes
        (m,) and (rows, count), read.
    b
        Rows of vectors: phases and jets are read and written.
    piece
        Length of a piece [s].
    i, count
        The lanes: count from i on.
    """
    harmonics, terms = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS])
    for j in range(harmonics):
        row = _HARMONIC + 2 * j
        frequency = read(lanes, at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY, i, count)
        cosine, sine = cosines, sines = b[row], b[row + 1]
        for n in range(int(model[DEGREE])):
            turn = frequency * (piece / (n + 1.0))
            cosine, sine = -turn * sine, turn * cosine
            cosines, sines = cosines + cosine, sines + sine
        b[row], b[row + 1] = cosines, sines
    jet = _HARMONIC + 2 * harmonics
    for first in range(jet, jet + 2 * terms, max(terms, 1)):
        for start in range(terms - 1):
            for n in range(first + terms - 2, first + start - 1, -1):
                b[n] = b[n] + b[n + 1]


@borrowing_kernel
def _write_drive(model, lanes, b, weights, by_m1, piece, i, count):
    """Write the drive's series over a piece; return how many terms they have.

    Parameters
    ----------
    model, lanes
        (m,) and (rows, count), read.
    b
        Rows of vectors: jets and phases are read, the series written.
    weights
        (ORDERS,) read: 1 / n!.
    by_m1
        1 / m1 [1/kg].
    piece
        Length of the series [s].
    i, count
        The lanes: count from i on.
    """
    harmonics, terms, square = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS]), piece * piece
    degree = int(model[DEGREE])
    scale, zero = square * by_m1, everywhere(0.0)
    jet = _HARMONIC + 2 * harmonics
    written = degree if harmonics > 0 else max(min(terms, degree), 1)
    for n in range(written):
        b[_FORCE + n] = b[_GROUND + n] = zero
        if n < terms:
            factor = 1.0 / weights[n]
            b[_FORCE + n] = factor * scale * b[jet + n]
            b[_GROUND + n] = factor * square * b[jet + terms + n]
    pair, held = control_forces(model, read(lanes, at.FORCE, i, count))
    b[_PAIR], b[_FORCE] = scale * pair, fma(scale, held, b[_FORCE])
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        is_ground = (int(model[at.GROUND]) >> j) & 1
        target = _GROUND if is_ground else _FORCE
        per_size = everywhere(square) if is_ground else scale
        size = per_size * read(lanes, harmonic + at.AMPLITUDE, i, count)
        turn = piece * read(lanes, harmonic + at.FREQUENCY, i, count)
        cosine, sine = size * b[_HARMONIC + 2 * j], size * b[_HARMONIC + 2 * j + 1]
        for n in range(degree):
            b[target + n] = b[target + n] + sine
            cosine, sine = -turn * sine, turn * cosine
    return written
