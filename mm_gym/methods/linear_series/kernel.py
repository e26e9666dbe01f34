"""Propagation of a linear plant by a Taylor series of its motion, LANES lanes at a time.

Its degree and pieces are chosen when the scene is compiled, for the fastest motion that the scene's
support can reach. States and series are those of `mm_gym.law.linear_motion`; the unit of time is a
piece of the sample interval.

Arguments of several kernels: `b`, rows of vectors, room for what excites a group of lanes; `piece`
[s]; `i, count`, the lanes i .. i + count - 1.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.sources import is_excited
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.linear_motion import add, derivative, generator, state_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness

MOST = 48
"""More than the degree of any series: with a phase of 2, 25 are enough, and one more for each term
of a jet behind the first."""

# Slots of the model: whether all lanes have the same parameters; 1 / n!.
DEGREE, PIECES, UNIFORM, WEIGHTS = (at.MODEL_OWN + i for i in range(4))
END = WEIGHTS + MOST + 1

# Rows of b: the series of the force on the carriage over m1 and of the ground's acceleration; then
# cosine and sine of each harmonic, and the jets as coefficients of (t / piece)^n.
FORCE, GROUND, HARMONIC = 0, MOST, 2 * MOST


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    others = model[at.HARMONIC_COUNT] - 1.0 + model[at.GROUND] + model[at.TERMS]
    if is_excited(model) and (model[PIECES] > 1.0 or others != 0.0):
        numbers = on_cache_line(rows_of_drive(model) * LANES)
        own = parameters_of(lanes, first, min(LANES, last - first))
        _propagate(model, lanes, own, True, rows_of(numbers), first, last)
    elif model[UNIFORM] > 0.0:
        _propagate(model, lanes, _shared_parameters(lanes, first), None, None, first, last)
    else:
        own = parameters_of(lanes, first, min(LANES, last - first))
        _propagate(model, lanes, own, True, None, first, last)
    return at.OK


@borrowing_kernel
def _propagate(model, lanes, parameters, is_drawn, b, first, last):
    """Advance the lanes, see `propagate`.

    Parameters
    ----------
    parameters, is_drawn
        Those of the first lanes; None, and not False, if all lanes share them.
    b
        None if nothing or one harmonic force excites the lanes, in one piece: that passes through
        no memory.
    """
    prefer_widest_vectors()
    stay_apart()
    pieces, degree, is_swung = int(model[PIECES]), int(model[DEGREE]), is_excited(model)
    piece, zero, terms = model[at.SAMPLE_INTERVAL] / pieces, everywhere(0.0), 0
    by_piece, cosine, sine, turn = 1.0 / piece, zero, zero, zero
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        if is_drawn is not None and i > first:
            parameters = parameters_of(lanes, i, count)
        m1, m2, k1, d, c, k0 = parameters
        k2 = stiffness(k0, read(lanes, at.STRETCH, i, count))
        g, scale = generator(piece, m1, m2, k1, d, c, k2), piece * piece / m1
        pair, held = control_forces(model, scale * read(lanes, at.FORCE, i, count))
        y = state_of(lanes, piece, i, count)
        if b is not None:
            load_drive(model, lanes, b, pieces, i, count)
        elif is_swung:
            size = scale * read(lanes, at.HARMONICS + at.AMPLITUDE, i, count)
            cosine = size * read(lanes, at.HARMONICS + at.COSINE, i, count)
            sine = size * read(lanes, at.HARMONICS + at.SINE, i, count)
            turn = piece * read(lanes, at.HARMONICS + at.FREQUENCY, i, count)
        for k in range(pieces):
            push = held + sine
            if b is not None:
                terms = write_drive(model, lanes, b, scale, piece, degree, i, count)
                push = held + b[FORCE]
            z, _ = derivative(g, y, push, pair)
            if b is not None:
                z = z[0], z[1], z[2] - b[GROUND], z[3]
            y = add(y, 1.0, z)
            for n in range(1, degree):
                push = zero
                if b is None and is_swung:
                    cosine, sine = -turn * sine, turn * cosine
                    push = sine
                if b is not None and n < terms:
                    push = b[FORCE + n]
                z, _ = derivative(g, z, push, 0.0)
                if b is not None and n < terms:
                    z = z[0], z[1], z[2] - b[GROUND + n], z[3]
                y = add(y, model[WEIGHTS + n + 1], z)
            if b is not None and k < pieces - 1:
                continue_drive(model, lanes, b, piece, degree, i, count)
        write(lanes, at.X1, i, count, y[0])
        write(lanes, at.X2, i, count, y[0] + y[1])
        write(lanes, at.V1, i, count, by_piece * y[2])
        write(lanes, at.V2, i, count, by_piece * (y[2] + y[3]))


@inlined_kernel
def _shared_parameters(lanes, i):
    """Return m1, m2, k1 alpha, d, c and k0 of lane i."""
    k1 = lanes[at.K1, i] * lanes[at.ALPHA, i]
    return lanes[at.M1, i], lanes[at.M2, i], k1, lanes[at.D, i], lanes[at.C, i], lanes[at.K0, i]


@inlined_kernel
def parameters_of(lanes, i, count):
    """Return the same of the lanes i .. i + count - 1."""
    k1 = read(lanes, at.K1, i, count) * read(lanes, at.ALPHA, i, count)
    m1, m2, k0 = (
        read(lanes, at.M1, i, count),
        read(lanes, at.M2, i, count),
        read(lanes, at.K0, i, count),
    )
    return m1, m2, k1, read(lanes, at.D, i, count), read(lanes, at.C, i, count), k0


@borrowing_kernel
def rows_of_drive(model):
    """Return how many rows b has."""
    return HARMONIC + 2 * int(model[at.HARMONIC_COUNT]) + 2 * int(model[at.TERMS])


@borrowing_kernel
def load_drive(model, lanes, b, pieces, i, count):
    """Load the harmonics' phases and the jets."""
    harmonics, terms = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS])
    for j in range(harmonics):
        row = at.HARMONICS + at.HARMONIC_ROWS * j
        b[HARMONIC + 2 * j] = read(lanes, row + at.COSINE, i, count)
        b[HARMONIC + 2 * j + 1] = read(lanes, row + at.SINE, i, count)
    row, jet = int(model[at.JETS]), HARMONIC + 2 * harmonics
    for k in range(2 * terms):
        b[jet + k] = read(lanes, row + k, i, count) * float(pieces) ** -(k % terms)


@borrowing_kernel
def write_drive(model, lanes, b, scale, piece, degree, i, count):
    """Write the series of what excites the lanes over a piece; return how many terms they have."""
    harmonics, terms, square = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS]), piece * piece
    zero, jet, factor = everywhere(0.0), HARMONIC + 2 * harmonics, 1.0
    written = degree if harmonics > 0 else max(min(terms, degree), 1)
    for n in range(written):
        b[FORCE + n] = b[GROUND + n] = zero
        if n < terms:
            b[FORCE + n] = factor * scale * b[jet + n]
            b[GROUND + n] = factor * square * b[jet + terms + n]
            factor *= n + 1.0
    for j in range(harmonics):
        row = at.HARMONICS + at.HARMONIC_ROWS * j
        is_ground = (int(model[at.GROUND]) >> j) & 1
        target, size = (GROUND, everywhere(square)) if is_ground else (FORCE, scale)
        size = size * read(lanes, row + at.AMPLITUDE, i, count)
        turn = piece * read(lanes, row + at.FREQUENCY, i, count)
        cosine, sine = size * b[HARMONIC + 2 * j], size * b[HARMONIC + 2 * j + 1]
        for n in range(degree):
            b[target + n] = b[target + n] + sine
            cosine, sine = -turn * sine, turn * cosine
    return written


@borrowing_kernel
def continue_drive(model, lanes, b, piece, degree, i, count):
    """Turn the harmonics by a piece, and shift both jets by it: (t + 1)^n by Horner's scheme."""
    harmonics, terms = int(model[at.HARMONIC_COUNT]), int(model[at.TERMS])
    for j in range(harmonics):
        row = HARMONIC + 2 * j
        frequency = read(lanes, at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY, i, count)
        cosine, sine = cosines, sines = b[row], b[row + 1]
        for n in range(degree):
            turn = frequency * (piece / (n + 1.0))
            cosine, sine = -turn * sine, turn * cosine
            cosines, sines = cosines + cosine, sines + sine
        b[row], b[row + 1] = cosines, sines
    jet = HARMONIC + 2 * harmonics
    for first in range(jet, jet + 2 * terms, max(terms, 1)):
        for start in range(terms - 1):
            for n in range(first + terms - 2, first + start - 1, -1):
                b[n] = b[n] + b[n + 1]
