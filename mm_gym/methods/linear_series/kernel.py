"""Propagation of a linear plant by a Taylor series of its motion, LANES lanes at a time.

Its degree and pieces are chosen when the scene is compiled, for the fastest motion that the scene's
support can reach. States and series are those of `mm_gym.law.linear_motion`; the unit of time is a
piece of the sample interval.

Arguments of several kernels: `b`, rows of vectors, room for what excites a group of lanes; `piece`
[s]; `i, count`, the lanes i .. i + count - 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.sources import is_excited
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.linear_motion import derivative, state_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness

if TYPE_CHECKING:
    from collections.abc import Callable

MOST = 48
"""More than the degree of any series: with a phase of 2, 25 are enough, and one more for each term
of a jet behind the first."""

SHORT = (4, 5)
"""Degrees that have a loop of their own: those of most scenes at tolerances of 1e-2 and 1e-3."""

# Slots of the model. For each group of rows, which together are one number of a lane, there is one
# that says whether lanes have values of their own; 1 / n!, and a piece's n-th power [s^n] over n!.
DEGREE, PIECES, VARIES = (layout.MODEL_OWN + i for i in range(3))
GROUPS = (
    (layout.M1,),
    (layout.M2,),
    (layout.K1, layout.ALPHA),
    (layout.D,),
    (layout.C,),
    (layout.K0, layout.STRETCH),
)
WEIGHTS = VARIES + len(GROUPS)
POWERS = WEIGHTS + MOST + 2
END = POWERS + MOST + 2

# Rows of b: the series of the force on the carriage over m1 and of the ground's acceleration; then
# cosine and sine of each harmonic, and the jets as coefficients of (t / piece)^n.
FORCE, GROUND, HARMONIC = 0, MOST, 2 * MOST


def _over_groups(move: Callable[..., None]) -> Callable[..., None]:
    """Return a kernel that moves the lanes by groups; the arguments of `move` are `_move`'s."""

    @borrowing_kernel
    def propagate_groups(model, lanes, b, first, last):
        prefer_widest_vectors()
        stay_apart()
        varies, plan = _varies(model), _plan(model)
        p = _parameters(lanes, None, varies, first, min(LANES, last - first))
        whole = last - (last - first) % LANES
        for i in range(first, whole, LANES):  # compiled for groups of just that many lanes
            p = _parameters(lanes, p, varies, i, LANES)
            move(model, plan, lanes, b, p, i, LANES)
        if whole < last:
            p = _parameters(lanes, p, varies, whole, last - whole)
            move(model, plan, lanes, b, p, whole, last - whole)

    return propagate_groups


@inlined_kernel
def _plan(model):
    """Return the pieces, the degree, a piece [s] and its inverse."""
    pieces, interval = model[PIECES], model[layout.SAMPLE_INTERVAL]
    return int(pieces), int(model[DEGREE]), interval / pieces, pieces / interval


@inlined_kernel
def _move_freely(model, plan, lanes, b, p, i, count):  # noqa: ARG001 - as of `_move`
    """Advance a group of lanes that a held force alone drives.

    Apart from `_move`, whose branches take as long as four terms of the series.
    """
    pieces, degree, piece, by_piece = plan
    g, _, pair, held, y = _begin(model, lanes, piece, p, i, count)
    for _ in range(pieces):
        z, _ = derivative(g, y, held, pair)
        y = _add(model, WEIGHTS, 0, _drifted(y), z)
        for n in range(1, degree):
            z, _ = derivative(g, z, 0.0, 0.0)
            y = _add(model, WEIGHTS, n, y, z)
    _write(lanes, by_piece, y, i, count)


@inlined_kernel
def _move(model, plan, lanes, b, p, i, count):
    """Advance a group of lanes with parameters p, see `_parameters`.

    Without b, which is None, one harmonic force at most and jets excite the lanes, in one piece:
    that passes through no memory.
    """
    pieces, degree, piece, by_piece = plan
    is_swung, zero = model[layout.HARMONIC_COUNT] > 0.0, everywhere(0.0)
    terms, jets = int(model[layout.TERMS]), int(model[layout.JETS])
    square, cosine, sine, turn = piece * piece, zero, zero, zero
    g, scale, pair, held, y = _begin(model, lanes, piece, p, i, count)
    if b is not None:
        load_drive(model, lanes, b, pieces, i, count)
    elif is_swung:
        size = scale * read(lanes, layout.HARMONICS + layout.AMPLITUDE, i, count)
        cosine = size * read(lanes, layout.HARMONICS + layout.COSINE, i, count)
        sine = size * read(lanes, layout.HARMONICS + layout.SINE, i, count)
        turn = piece * read(lanes, layout.HARMONICS + layout.FREQUENCY, i, count)
    for k in range(pieces):
        if b is not None:
            terms = write_drive(model, lanes, b, scale, piece, degree, i, count)
        driven = degree if is_swung else min(max(terms, 1), degree)
        weights, z, push, inner = (scale, square), y, held + sine, pair
        y = _drifted(y)
        for n in range(driven):
            if n < terms:
                push, ground = _driven(b, lanes, jets, terms, weights, push, n, i, count)
                weights = (n + 1.0) * weights[0], (n + 1.0) * weights[1]
                z, _ = derivative(g, z, push, inner)
                z = z[0], z[1], z[2] - ground, z[3]
            else:
                z, _ = derivative(g, z, push, inner)
            y = _add(model, WEIGHTS, n, y, z)
            if b is None and is_swung:
                cosine, sine = -turn * sine, turn * cosine
            push, inner = sine, zero
        for n in range(driven, degree):
            z, _ = derivative(g, z, 0.0, 0.0)
            y = _add(model, WEIGHTS, n, y, z)
        if b is not None and k < pieces - 1:
            continue_drive(model, lanes, b, piece, degree, i, count)
    _write(lanes, by_piece, y, i, count)


@inlined_kernel
def _begin(model, lanes, piece, p, i, count):
    """Return generator, units of the carriage's force, both parts of the held one, and state."""
    m1, by_m1, by_m2, k1, d, c, k2 = p
    rate = piece * by_m1
    scale = piece * rate
    g = scale * k1, rate * d, rate * c, scale * k2, m1 * by_m2
    pair, held = control_forces(model, scale * read(lanes, layout.FORCE, i, count))
    return g, scale, pair, held, state_of(lanes, piece, i, count)


@inlined_kernel
def _drifted(y):
    """Return a state after a piece at constant velocities."""
    return y[0] + y[2], y[1] + y[3], y[2], y[3]


@inlined_kernel
def _write(lanes, by_piece, y, i, count):
    """Write the state of the lanes i .. i + count - 1."""
    write(lanes, layout.X1, i, count, y[0])
    write(lanes, layout.X2, i, count, y[0] + y[1])
    write(lanes, layout.V1, i, count, by_piece * y[2])
    write(lanes, layout.V2, i, count, by_piece * (y[2] + y[3]))


_FREELY, _EXCITED = _over_groups(_move_freely), _over_groups(_move)


def _few_terms(degree: int, otherwise: Callable[..., None]) -> Callable[..., None]:
    """Return a kernel for series of a degree, of lanes of which the carriage's mass alone varies.

    The compiler writes out its terms, and keeps what the lanes share in registers. `otherwise` is
    for other degrees.
    """

    @borrowing_kernel
    def move(model, lanes, first, last):
        prefer_widest_vectors()
        stay_apart()
        time, by_m2 = model[layout.SAMPLE_INTERVAL], 1.0 / lanes[layout.M2, first]
        k1 = lanes[layout.K1, first] * lanes[layout.ALPHA, first]
        k2 = stiffness(lanes[layout.K0, first], lanes[layout.STRETCH, first])
        d, c = lanes[layout.D, first], lanes[layout.C, first]
        x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
        v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
        forces, masses = lanes[layout.FORCE, first:last], lanes[layout.M1, first:last]
        for i in range(last - first):
            m1, x1, v1 = masses[i], x1s[i], v1s[i]
            by_m1, offset, w = 1.0 / m1, x2s[i] - x1, v2s[i] - v1
            g = by_m1 * k1, by_m1 * d, by_m1 * c, by_m1 * k2, m1 * by_m2
            pair, held = control_forces(model, by_m1 * forces[i])
            z, _ = derivative(g, (x1, offset, v1, w), held, pair)
            y = fma(time, v1, x1), fma(time, w, offset), v1, w
            y = _add(model, POWERS, 0, y, z)
            for n in range(1, degree):
                z, _ = derivative(g, z, 0.0, 0.0)
                y = _add(model, POWERS, n, y, z)
            x1s[i], x2s[i], v1s[i], v2s[i] = y[0], y[0] + y[1], y[2], y[2] + y[3]

    @borrowing_kernel
    def move_if_few(model, lanes, b, first, last):
        if model[DEGREE] == degree:
            move(model, lanes, first, last)
        else:
            otherwise(model, lanes, b, first, last)

    return move_if_few


_FEW = _FREELY
for _degree in SHORT:
    _FEW = _few_terms(_degree, _FEW)


@inlined_kernel
def _may_be_few(model):
    """Tell whether the lanes differ in the carriage's mass at most, and have one piece."""
    _, m2, k1, d, c, k2 = _varies(model)
    return model[PIECES] == 1.0 and not (m2 or k1 or d or c or k2)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    is_alone = model[layout.HARMONIC_COUNT] <= 1.0 and model[layout.GROUND] == 0.0
    if not is_excited(model):
        if _may_be_few(model):
            _FEW(model, lanes, None, first, last)
        else:
            _FREELY(model, lanes, None, first, last)
    elif model[PIECES] == 1.0 and is_alone:
        _EXCITED(model, lanes, None, first, last)
    else:
        numbers = on_cache_line(rows_of_drive(model) * LANES)
        _EXCITED(model, lanes, rows_of(numbers), first, last)
    return layout.OK


@inlined_kernel
def _add(model, weights, n, y, z):
    """Return the state with what its derivative n + 1 adds to velocities, and to positions.

    Of positions that is the term of order n + 2, which takes no other derivative.
    """
    faster, further = model[weights + n + 1], model[weights + n + 2]
    return (
        fma(further, z[2], y[0]),
        fma(further, z[3], y[1]),
        fma(faster, z[2], y[2]),
        fma(faster, z[3], y[3]),
    )


@inlined_kernel
def _driven(b, lanes, jet, terms, weights, push, n, i, count):
    """Return what drives term n, over m1 and in units of the piece.

    Parameters
    ----------
    b
        See `_move`.
    jet, terms
        First row of the jets, and their terms.
    weights
        n! times what turns a force, and an acceleration of the ground, into that.
    push
        What else drives it.
    """
    if b is not None:
        return push + b[FORCE + n], b[GROUND + n]
    of_force, of_ground = weights
    force, ground = read(lanes, jet + n, i, count), read(lanes, jet + terms + n, i, count)
    return fma(of_force, force, push), of_ground * ground


@inlined_kernel
def _varies(model):
    """Return whether lanes have values of their own of m1, m2, k1, d, c and k2."""
    return (
        model[VARIES] > 0.0,
        model[VARIES + 1] > 0.0,
        model[VARIES + 2] > 0.0,
        model[VARIES + 3] > 0.0,
        model[VARIES + 4] > 0.0,
        model[VARIES + 5] > 0.0,
    )


@inlined_kernel
def _parameters(lanes, known, varies, i, count):
    """Return m1, 1 / m1, 1 / m2, k1 alpha, d, c and k2 of the lanes i .. i + count - 1.

    Of what does not vary they are those known. A division takes as long as a term of the series.
    """
    if known is None:
        m1, m2, k1, d, c, k0 = parameters_of(lanes, i, count)
        k2 = stiffness(k0, read(lanes, layout.STRETCH, i, count))
        return m1, 1.0 / m1, 1.0 / m2, k1, d, c, k2
    m1, by_m1, by_m2, k1, d, c, k2 = known
    if varies[0]:
        m1 = read(lanes, layout.M1, i, count)
        by_m1 = 1.0 / m1
    if varies[1]:
        by_m2 = 1.0 / read(lanes, layout.M2, i, count)
    if varies[2]:
        k1 = read(lanes, layout.K1, i, count) * read(lanes, layout.ALPHA, i, count)
    if varies[3]:
        d = read(lanes, layout.D, i, count)
    if varies[4]:
        c = read(lanes, layout.C, i, count)
    if varies[5]:
        k2 = stiffness(read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count))
    return m1, by_m1, by_m2, k1, d, c, k2


@inlined_kernel
def parameters_of(lanes, i, count):
    """Return the same of the lanes i .. i + count - 1."""
    k1 = read(lanes, layout.K1, i, count) * read(lanes, layout.ALPHA, i, count)
    m1, m2, k0 = (
        read(lanes, layout.M1, i, count),
        read(lanes, layout.M2, i, count),
        read(lanes, layout.K0, i, count),
    )
    return m1, m2, k1, read(lanes, layout.D, i, count), read(lanes, layout.C, i, count), k0


@borrowing_kernel
def rows_of_drive(model):
    """Return how many rows b has."""
    return HARMONIC + 2 * int(model[layout.HARMONIC_COUNT]) + 2 * int(model[layout.TERMS])


@borrowing_kernel
def load_drive(model, lanes, b, pieces, i, count):
    """Load the harmonics' phases and the jets."""
    harmonics, terms = int(model[layout.HARMONIC_COUNT]), int(model[layout.TERMS])
    for j in range(harmonics):
        row = layout.HARMONICS + layout.HARMONIC_ROWS * j
        b[HARMONIC + 2 * j] = read(lanes, row + layout.COSINE, i, count)
        b[HARMONIC + 2 * j + 1] = read(lanes, row + layout.SINE, i, count)
    row, jet = int(model[layout.JETS]), HARMONIC + 2 * harmonics
    for k in range(2 * terms):
        b[jet + k] = read(lanes, row + k, i, count) * float(pieces) ** -(k % terms)


@borrowing_kernel
def write_drive(model, lanes, b, scale, piece, degree, i, count):
    """Write the series of what excites the lanes over a piece; return how many terms they have."""
    harmonics, terms, square = (
        int(model[layout.HARMONIC_COUNT]),
        int(model[layout.TERMS]),
        piece * piece,
    )
    zero, jet, factor = everywhere(0.0), HARMONIC + 2 * harmonics, 1.0
    written = degree if harmonics > 0 else max(min(terms, degree), 1)
    for n in range(written):
        b[FORCE + n] = b[GROUND + n] = zero
        if n < terms:
            b[FORCE + n] = factor * scale * b[jet + n]
            b[GROUND + n] = factor * square * b[jet + terms + n]
            factor *= n + 1.0
    for j in range(harmonics):
        row = layout.HARMONICS + layout.HARMONIC_ROWS * j
        is_ground = (int(model[layout.GROUND]) >> j) & 1
        target, size = (GROUND, everywhere(square)) if is_ground else (FORCE, scale)
        size = size * read(lanes, row + layout.AMPLITUDE, i, count)
        turn = piece * read(lanes, row + layout.FREQUENCY, i, count)
        cosine, sine = size * b[HARMONIC + 2 * j], size * b[HARMONIC + 2 * j + 1]
        for n in range(degree):
            b[target + n] = b[target + n] + sine
            cosine, sine = -turn * sine, turn * cosine
    return written


@borrowing_kernel
def continue_drive(model, lanes, b, piece, degree, i, count):
    """Turn the harmonics by a piece, and shift both jets by it: (t + 1)^n by Horner's scheme."""
    harmonics, terms = int(model[layout.HARMONIC_COUNT]), int(model[layout.TERMS])
    for j in range(harmonics):
        row = HARMONIC + 2 * j
        frequency = read(
            lanes, layout.HARMONICS + layout.HARMONIC_ROWS * j + layout.FREQUENCY, i, count
        )
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
