"""Motion and deviations of linear plants whose parameters vary, LANES lanes at a time.

Both are Taylor series of the exponential. A deviation of the stretch is driven by the motion: the
derivative of the exponential along that of its generator, without a matrix of twice the size.
Najfeld and Havel, *Derivatives of the matrix exponential and their computation*, Adv. Appl. Math.
16 (1995).
"""

from __future__ import annotations

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma, prefer_widest_vectors
from mm_gym.kernels.groups import read, write
from mm_gym.kernels.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.kernels.laws import stiffness
from mm_gym.kernels.memory import on_cache_line
from mm_gym.kernels.simd import LANES, everywhere
from mm_gym.kernels.simd_memory import rows_of
from mm_gym.sensitivity.layout import CAUSES, COLUMNS, DEGREE, FIRST_ROW, PIECES, STATES, TANGENTS

MOST_HARMONICS = 8
"""Harmonics that there is room for."""

# Rows of scratch: the drive's series of the carriage and of the ground, then cosine and sine of
# each harmonic, then the jets.
_ORDERS = 64
_FORCE, _GROUND, _HARMONIC = 0, _ORDERS, 2 * _ORDERS
_JET = _HARMONIC + 2 * MOST_HARMONICS


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval."""
    scratch = on_cache_line((_JET + 2 * int(model[at.TERMS])) * LANES)
    return _propagate(model, lanes, scratch, first, last)


@borrowing_kernel
def _propagate(model, lanes, scratch, first, last):
    """Advance the lanes first .. last - 1, with room (rows * LANES,)."""
    prefer_widest_vectors()
    pieces, degree, tangents = (
        int(model[PIECES]),
        int(model[DEGREE]),
        int(model[FIRST_ROW]) + TANGENTS,
    )
    piece = model[at.SAMPLE_INTERVAL] / pieces
    for i in range(first, last, LANES):
        count, b = min(LANES, last - i), rows_of(scratch)
        g, by_m1, slope = _coefficients(lanes, i, count)
        _load_drive(model, lanes, b, i, count)
        for _ in range(pieces):
            _write_drive(model, lanes, b, by_m1, piece, degree, i, count)
            _move(model, lanes, b, g, slope, tangents, piece, degree, i, count)
            for j in range(COLUMNS):
                cause = model[CAUSES + j]
                if j < STATES or cause == at.FORCE:
                    push = by_m1 if cause == at.FORCE else everywhere(0.0)
                    _deviate(lanes, g, push, tangents + j, piece, degree, i, count)
            _continue_jets(model, b)
    return at.OK


@inlined_kernel
def _coefficients(lanes, i, count):
    """Return the generator's coefficients over m1, 1 / m1, and the slope of k2 / m1."""
    by_m1 = 1.0 / read(lanes, at.M1, i, count)
    both = 1.0 + read(lanes, at.M1, i, count) / read(lanes, at.M2, i, count)
    k0, stretch = read(lanes, at.K0, i, count) * by_m1, read(lanes, at.STRETCH, i, count)
    square = stretch * stretch
    k1 = read(lanes, at.K1, i, count) * read(lanes, at.ALPHA, i, count) * by_m1
    d, c = read(lanes, at.D, i, count) * by_m1, read(lanes, at.C, i, count) * by_m1
    return (k1, d, c, stiffness(k0, stretch), both), by_m1, -12.0 * k0 / (square * square)


@inlined_kernel
def _derivative(g, push, pull, step, z):
    """Return a term of the series from the one before it.

    Parameters
    ----------
    g
        Coefficients of the generator.
    push, pull
        Accelerations of the carriage [m/s^2]: by forces on it, and by the springs besides.
    step
        Piece over order [s].
    z
        x1, offset, v1 and slip velocity.
    """
    k1, d, c, k2, both = g
    x1, offset, v1, w = z
    coupling = fma(c, w, fma(k2, offset, pull))
    outer = fma(d, v1, fma(k1, x1, -push))
    return (
        step * v1,
        step * w,
        step * (coupling - outer),  # (1) of docs/model.md
        step * fma(-both, coupling, outer),  # (2) less (1)
    )


@inlined_kernel
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@inlined_kernel
def _column(lanes, row, i, count):
    """Return the four parts of a column of deviations."""
    return (
        read(lanes, row, i, count),
        read(lanes, row + COLUMNS, i, count),
        read(lanes, row + 2 * COLUMNS, i, count),
        read(lanes, row + 3 * COLUMNS, i, count),
    )


@inlined_kernel
def _write_column(lanes, row, i, count, z):
    write(lanes, row, i, count, z[0])
    write(lanes, row + COLUMNS, i, count, z[1])
    write(lanes, row + 2 * COLUMNS, i, count, z[2])
    write(lanes, row + 3 * COLUMNS, i, count, z[3])


@borrowing_kernel
def _deviate(lanes, g, push, row, piece, degree, i, count):
    """Advance a column that the motion does not drive.

    Parameters
    ----------
    lanes
        (rows, count) read and written: the column.
    g, push
        Coefficients of the generator; acceleration [m/s^2] that is held.
    row
        The column's first row.
    piece, degree
        Length [s] and degree of the series.
    i, count
        The lanes: count from i on.
    """
    prefer_widest_vectors()
    total = term = _column(lanes, row, i, count)
    zero = everywhere(0.0)
    for n in range(degree):
        term = _derivative(g, push, zero, piece / (n + 1.0), term)
        total, push = _sum(total, term), zero
    _write_column(lanes, row, i, count, total)


@borrowing_kernel
def _move(model, lanes, b, g, slope, tangents, piece, degree, i, count):
    """Advance the motion, and with it the column of the stretch.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) read, and state and column written.
    b
        Rows of vectors, read: the drive's series.
    g, slope
        Coefficients of the generator, and the slope of k2 / m1 over the stretch.
    tangents
        First row of the columns.
    piece, degree
        Length [s] and degree of the series.
    i, count
        The lanes: count from i on.
    """
    prefer_widest_vectors()
    x1, v1 = read(lanes, at.X1, i, count), read(lanes, at.V1, i, count)
    offset, w = read(lanes, at.X2, i, count) - x1, read(lanes, at.V2, i, count) - v1
    total = term = x1, offset, v1, w
    row, zero = tangents, everywhere(0.0)
    for j in range(STATES, COLUMNS):
        if model[CAUSES + j] == at.STRETCH:
            row = tangents + j
    deviation = turn = _column(lanes, row, i, count)
    for n in range(degree):
        step = piece / (n + 1.0)
        turn = _derivative(g, zero, slope * term[1], step, turn)
        deviation = _sum(deviation, turn)
        y1, y2, u1, u2 = _derivative(g, b[_FORCE + n], zero, step, term)
        term = y1, y2, u1 - step * b[_GROUND + n], u2
        total = _sum(total, term)
    write(lanes, at.X1, i, count, total[0])
    write(lanes, at.X2, i, count, total[0] + total[1])
    write(lanes, at.V1, i, count, total[2])
    write(lanes, at.V2, i, count, total[2] + total[3])
    if row != tangents:
        _write_column(lanes, row, i, count, deviation)


@borrowing_kernel
def _load_drive(model, lanes, b, i, count):
    """Load the harmonics' phases, and the jets as coefficients of (t / piece)^n."""
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        b[_HARMONIC + 2 * j] = read(lanes, harmonic + at.COSINE, i, count)
        b[_HARMONIC + 2 * j + 1] = read(lanes, harmonic + at.SINE, i, count)
    terms, row = int(model[at.TERMS]), int(model[at.JETS])
    for k in range(2 * terms):
        b[_JET + k] = read(lanes, row + k, i, count) * model[PIECES] ** -(k % terms)


@borrowing_kernel
def _continue_jets(model, b):
    """Shift both jets to the next piece, (t + 1)^n, by Horner's scheme."""
    terms = int(model[at.TERMS])
    for first in range(_JET, _JET + 2 * terms, max(terms, 1)):
        for start in range(terms - 1):
            for n in range(first + terms - 2, first + start - 1, -1):
                b[n] = b[n] + b[n + 1]


@borrowing_kernel
def _write_drive(model, lanes, b, by_m1, piece, degree, i, count):
    """Write the drive's series over a piece, and the harmonics' phases at its end.

    Parameters
    ----------
    model, lanes
        (m,) and (rows, count), read.
    b
        Rows of vectors: jets and phases are read, the series [m/s^2] and phases written.
    by_m1
        1 / m1 [1/kg].
    piece, degree
        Length [s] and degree of the series.
    i, count
        The lanes: count from i on.
    """
    terms, zero = int(model[at.TERMS]), everywhere(0.0)
    for n in range(degree):
        b[_FORCE + n] = by_m1 * b[_JET + n] if n < terms else zero
        b[_GROUND + n] = b[_JET + terms + n] if n < terms else zero
    b[_FORCE] = b[_FORCE] + by_m1 * read(lanes, at.FORCE, i, count)
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        is_ground = (int(model[at.GROUND]) >> j) & 1
        scale = read(lanes, harmonic + at.AMPLITUDE, i, count)
        if not is_ground:
            scale = scale * by_m1
        target = _GROUND if is_ground else _FORCE
        turn = piece * read(lanes, harmonic + at.FREQUENCY, i, count)
        cosine, sine = b[_HARMONIC + 2 * j], b[_HARMONIC + 2 * j + 1]
        cosines, sines = cosine, sine
        for n in range(degree):
            b[target + n] = b[target + n] + scale * sine
            step = turn * (1.0 / (n + 1.0))
            cosine, sine = -step * sine, step * cosine
            cosines, sines = cosines + cosine, sines + sine
        b[_HARMONIC + 2 * j], b[_HARMONIC + 2 * j + 1] = cosines, sines


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):
    """Add to motion and deviations of a lane what follows from given velocities at rest.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) float64; parameters are read, state and the column of the stretch written.
    time
        How long the motion lasts [s]; at most the sample interval.
    v1, v2
        Velocities at its start [m/s].
    i
        The lane.
    """
    by_m1, k0, stretch = 1.0 / lanes[at.M1, i], lanes[at.K0, i], lanes[at.STRETCH, i]
    g = (
        lanes[at.K1, i] * lanes[at.ALPHA, i] * by_m1,
        lanes[at.D, i] * by_m1,
        lanes[at.C, i] * by_m1,
        stiffness(k0, stretch) * by_m1,
        1.0 + lanes[at.M1, i] / lanes[at.M2, i],
    )
    slope = -12.0 * k0 * by_m1 / stretch**4
    total, deviation = (0.0, 0.0, v1, v2 - v1), (0.0, 0.0, 0.0, 0.0)
    pieces = int(model[PIECES])
    for _ in range(pieces):
        term, turn = total, deviation
        for n in range(int(model[DEGREE])):
            step = time / pieces / (n + 1.0)
            turn = _derivative(g, 0.0, slope * term[1], step, turn)
            term = _derivative(g, 0.0, 0.0, step, term)
            total, deviation = _sum(total, term), _sum(deviation, turn)
    lanes[at.X1, i] += total[0]
    lanes[at.X2, i] += total[0] + total[1]
    lanes[at.V1, i] += total[2]
    lanes[at.V2, i] += total[2] + total[3]
    for j in range(STATES, COLUMNS):
        if model[CAUSES + j] == at.STRETCH:
            row = int(model[FIRST_ROW]) + TANGENTS + j
            for part in range(4):
                lanes[row + part * COLUMNS, i] += deviation[part]
