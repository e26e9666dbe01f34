"""Propagation of a linear plant whose parameters differ between lanes or change between steps.

The exponential acts on the vector as a truncated Taylor series. Its degree and pieces are chosen
when the scene is compiled, for the fastest motion that the scene's support can reach, so that what
is cut off is below round-off.

The series is summed from its highest order down, y <- x + (h / n) A y (Horner), which needs no
memory of the terms; several orders are taken in one pass over the lanes, so that the state stays in
registers between them.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.memory import on_cache_line
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness

DEGREE, PIECES, UNIFORM = (at.MODEL_OWN + i for i in range(3))  # UNIFORM: parameters are fixed

# Some lanes at a time are copied into scratch arrays whose rows lie WIDTH apart: with distances
# known when it is compiled, the compiler vectorises the loops without checking for overlap. So few
# lanes that all rows stay in the first-level cache.
WIDTH = 64

# Scratch: at the piece's start x1, the sphere's offset, v1, the slip velocity; their partial
# sums; then 1/m1, k1/m1, d/m1, c/m1, k0/m1, 1 + m1/m2; and with this step's stretch and force k2/m1
# and force/m1, on the carriage and between the masses. Offset and slip need fewer operations than
# x2 and v2.
_ROWS = 17 * WIDTH
_X1, _OFFSET, _V1, _SLIP, _Y1, _Y2, _W1, _W2, *_COEFFICIENTS = range(0, _ROWS, WIDTH)
_PER_MASS, _K1, _D1, _C1, _K0, _BOTH, _K2, _HELD, _PAIR = _COEFFICIENTS

# Drive: accelerations that forces on the carriage cause, then those of the ground, a row for each
# order of a pass.
ORDERS = 3  # summed in one pass; the degree is rounded up to a multiple
_GROUND = ORDERS * WIDTH
_DRIVE_ROWS = 2 * _GROUND

# Harmonics: cosine and sine at the piece's start, scaled to an acceleration; their partial sums;
# and the frequency.
_HARMONIC_ROWS = 5 * WIDTH
_COSINE, _SINE, _COSINE_SUM, _SINE_SUM, _FREQUENCY = range(0, _HARMONIC_ROWS, WIDTH)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    count = int(model[at.HARMONIC_COUNT])
    scratch, drive = on_cache_line(_ROWS), on_cache_line(_DRIVE_ROWS)
    harmonics = on_cache_line(count * _HARMONIC_ROWS).reshape(count, _HARMONIC_ROWS)
    jets = on_cache_line(2 * int(model[at.TERMS]) * WIDTH).reshape(2 * int(model[at.TERMS]), WIDTH)
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        if start == first or model[UNIFORM] == 0.0:
            _load_parameters(lanes, scratch, start, count)
        _propagate(model, lanes, scratch, drive, harmonics, jets, start, count)
    return at.OK


@borrowing_kernel
def _propagate(model, lanes, scratch, drive, harmonics, jets, first, count):
    """Advance a few lanes, whose parameters are loaded.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) read, and the state written.
    scratch
        (_ROWS,) read and written: parameters, state and partial sums.
    drive, harmonics, jets
        (_DRIVE_ROWS,), (harmonics, _HARMONIC_ROWS) and (2 terms, WIDTH), written: room for what
        excites the lanes, as accelerations.
    first, count
        The lanes: count from first on, at most WIDTH.
    """
    pieces, ground = int(model[PIECES]), int(model[at.GROUND])
    highest = ORDERS * math.ceil(model[DEGREE] / ORDERS)
    h = model[at.SAMPLE_INTERVAL] / pieces
    # The first harmonic, if it is a force, is summed with the state and passes through no memory.
    alone = 1 if harmonics.shape[0] > 0 and ground & 1 == 0 else 0
    driven = harmonics.shape[0] + jets.shape[0] > alone
    _load_state(model, lanes, scratch, first, count)
    for j in range(harmonics.shape[0]):
        _load_harmonic(lanes, scratch, harmonics[j], j, (ground >> j) & 1, first, count)
    _load_jets(model, lanes, scratch, jets, first, count)
    _hold(scratch, drive, count)
    for _ in range(pieces):
        _copy(scratch[_X1:], scratch[_Y1:], count)
        for order in range(highest, 0, -ORDERS):
            if driven:
                _hold(scratch, drive, count)
                _excite(drive, harmonics, alone, ground, h, order, count)
                _add_jets(jets, drive, order, count)
            if alone:
                _sum_with_harmonic(scratch, drive, harmonics[0], h, order, count)
            else:
                _sum(scratch, drive, h, order, count)
        _copy(scratch[_Y1:], scratch[_X1:], count)
        for j in range(harmonics.shape[0]):
            _continue_harmonic(harmonics[j], count)
        _continue_jets(jets, count)
    _store_state(lanes, scratch, first, count)


@borrowing_kernel
def _load_state(model, lanes, scratch, first, count):
    """Copy the state, and derive what force and stretch do in this step."""
    x1, x2, v1, v2 = (
        lanes[at.X1, first:],
        lanes[at.X2, first:],
        lanes[at.V1, first:],
        lanes[at.V2, first:],
    )
    stretch, force = lanes[at.STRETCH, first:], lanes[at.FORCE, first:]
    for i in range(count):
        scratch[_X1 + i], scratch[_OFFSET + i] = x1[i], x2[i] - x1[i]
        scratch[_V1 + i], scratch[_SLIP + i] = v1[i], v2[i] - v1[i]
    for i in range(count):
        scratch[_K2 + i] = stiffness(scratch[_K0 + i], stretch[i])
        pair, held = control_forces(model, force[i])
        scratch[_HELD + i] = held * scratch[_PER_MASS + i]
        scratch[_PAIR + i] = pair * scratch[_PER_MASS + i]


@borrowing_kernel
def _store_state(lanes, scratch, first, count):
    """Write the state that was reached."""
    x1, x2, v1, v2 = (
        lanes[at.X1, first:],
        lanes[at.X2, first:],
        lanes[at.V1, first:],
        lanes[at.V2, first:],
    )
    for i in range(count):
        x1[i], x2[i] = scratch[_X1 + i], scratch[_X1 + i] + scratch[_OFFSET + i]
        v1[i], v2[i] = scratch[_V1 + i], scratch[_V1 + i] + scratch[_SLIP + i]


@borrowing_kernel
def _load_parameters(lanes, scratch, first, count):
    """Divide the coefficients by the mass of the carriage."""
    m1, m2, k0 = lanes[at.M1, first:], lanes[at.M2, first:], lanes[at.K0, first:]
    k1, alpha = lanes[at.K1, first:], lanes[at.ALPHA, first:]
    d, c = lanes[at.D, first:], lanes[at.C, first:]
    for i in range(count):
        per_mass = 1.0 / m1[i]
        scratch[_PER_MASS + i], scratch[_BOTH + i] = per_mass, 1.0 + m1[i] / m2[i]
        scratch[_K1 + i], scratch[_K0 + i] = k1[i] * alpha[i] * per_mass, k0[i] * per_mass
        scratch[_D1 + i], scratch[_C1 + i] = d[i] * per_mass, c[i] * per_mass


@borrowing_kernel
def _load_harmonic(lanes, scratch, harmonic, j, ground, first, count):
    """Copy a harmonic's phase, scaled to an acceleration.

    Parameters
    ----------
    lanes
        (rows, count) read: row j of harmonics.
    scratch
        (_ROWS,) read: 1 / m1.
    harmonic
        (_HARMONIC_ROWS,) written [m/s^2, rad/s].
    j, ground
        Number of the harmonic, and whether it shakes the ground.
    first, count
        The lanes: count from first on.
    """
    row = at.HARMONICS + at.HARMONIC_ROWS * j
    amplitudes, frequencies = lanes[row + at.AMPLITUDE, first:], lanes[row + at.FREQUENCY, first:]
    cosines, sines = lanes[row + at.COSINE, first:], lanes[row + at.SINE, first:]
    for i in range(count):
        scale = -amplitudes[i] if ground else amplitudes[i] * scratch[_PER_MASS + i]
        c, s = scale * cosines[i], scale * sines[i]
        harmonic[_COSINE + i], harmonic[_SINE + i], harmonic[_FREQUENCY + i] = c, s, frequencies[i]
        harmonic[_COSINE_SUM + i], harmonic[_SINE_SUM + i] = c, s


@borrowing_kernel
def _continue_harmonic(harmonic, count):
    """Start from the phase that the harmonic's series has reached."""
    for i in range(count):
        harmonic[_COSINE + i], harmonic[_SINE + i] = (
            harmonic[_COSINE_SUM + i],
            harmonic[_SINE_SUM + i],
        )


@borrowing_kernel
def _load_jets(model, lanes, scratch, jets, first, count):
    """Copy both jets as accelerations, coefficients of (t / h)^n with h the series' piece.

    Parameters
    ----------
    model, lanes
        (m,) and (rows, count), read: the jets of force [N] and of ground acceleration [m/s^2].
    scratch
        (_ROWS,) read: 1 / m1.
    jets
        (2 terms, WIDTH) written [m/s^2].
    first, count
        The lanes: count from first on.
    """
    terms, row, pieces = int(model[at.TERMS]), int(model[at.JETS]), model[PIECES]
    for k in range(2 * terms):
        coefficients, scale = lanes[row + k, first:], pieces ** -(k % terms)
        for i in range(count):
            jets[k, i] = coefficients[i] * (scale * scratch[_PER_MASS + i] if k < terms else -scale)


@borrowing_kernel
def _continue_jets(jets, count):
    """Shift both jets to the next piece, (t + 1)^n, by Horner's scheme."""
    terms = jets.shape[0] // 2
    for first in range(0, 2 * terms, max(terms, 1)):
        for start in range(terms - 1):
            for n in range(first + terms - 2, first + start - 1, -1):
                for i in range(count):
                    jets[n, i] += jets[n + 1, i]


@borrowing_kernel
def _add_jets(jets, drive, order, count):
    """Add both jets to the drive of the next orders.

    What is p^(n) h^n / n! of a jet counts n! m! / (m + n)! in the sum's order m (Horner).
    """
    terms = jets.shape[0] // 2
    for k in range(ORDERS):
        weight = 1.0
        for n in range(terms):
            for i in range(count):
                drive[WIDTH * k + i] += weight * jets[n, i]
                drive[_GROUND + WIDTH * k + i] += weight * jets[terms + n, i]
            weight *= (n + 1.0) / (order - k + n + 1.0)


@borrowing_kernel
def _copy(source, target, count):
    """Copy four rows."""
    for i in range(count):
        x1, offset, v1, w = (
            source[i],
            source[WIDTH + i],
            source[2 * WIDTH + i],
            source[3 * WIDTH + i],
        )
        target[i], target[WIDTH + i], target[2 * WIDTH + i], target[3 * WIDTH + i] = (
            x1,
            offset,
            v1,
            w,
        )


@borrowing_kernel
def _hold(scratch, drive, count):
    """Begin the drive of the next orders with the held force and a ground at rest."""
    for i in range(count):
        for row in range(0, _GROUND, WIDTH):
            drive[row + i], drive[_GROUND + row + i] = scratch[_HELD + i], 0.0


@borrowing_kernel
def _excite(drive, harmonics, first_harmonic, ground, h, order, count):
    """Add to the drive of the next orders what the harmonics contribute.

    Parameters
    ----------
    drive
        (_DRIVE_ROWS,) read and written [m/s^2].
    harmonics
        (harmonics, _HARMONIC_ROWS) read, and their partial sums written [m/s^2].
    first_harmonic
        Number of the first one to add.
    ground
        Bit j: whether harmonic j shakes the ground.
    h, order, count
        Piece [s], the next order, and the number of lanes.
    """
    for j in range(first_harmonic, harmonics.shape[0]):
        _add_harmonic(
            harmonics[j], drive[_GROUND:] if (ground >> j) & 1 else drive, h, order, count
        )


@borrowing_kernel
def _add_harmonic(harmonic, target, h, order, count):
    """Add a harmonic to the drive of the next orders; sum its own series."""
    step0, step1, step2 = h / order, h / (order - 1), h / (order - 2)
    for i in range(count):
        start, frequency = (harmonic[_COSINE + i], harmonic[_SINE + i]), harmonic[_FREQUENCY + i]
        z0 = harmonic[_COSINE_SUM + i], harmonic[_SINE_SUM + i]
        z1 = _turned(start, step0 * frequency, z0)
        z2 = _turned(start, step1 * frequency, z1)
        harmonic[_COSINE_SUM + i], harmonic[_SINE_SUM + i] = _turned(start, step2 * frequency, z2)
        target[i] += z0[1]
        target[WIDTH + i] += z1[1]
        target[2 * WIDTH + i] += z2[1]


@borrowing_kernel
def _turned(start, angle, z):
    """Return start + angle (-sin, cos) of the phase z = (cos, sin): c' = -w s, s' = w c."""
    return fma(-angle, z[1], start[0]), fma(angle, z[0], start[1])


@borrowing_kernel
def _sum(scratch, drive, h, order, count):
    """Take the sum down by ORDERS orders."""
    prefer_widest_vectors()
    step0, step1, step2 = h / order, h / (order - 1), h / (order - 2)
    for i in range(count):
        state = scratch[_X1 + i], scratch[_OFFSET + i], scratch[_V1 + i], scratch[_SLIP + i]
        y = scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i]
        y = _next(scratch, i, drive[i], drive[_GROUND + i], step0, state, y)
        y = _next(scratch, i, drive[WIDTH + i], drive[_GROUND + WIDTH + i], step1, state, y)
        y = _next(scratch, i, drive[2 * WIDTH + i], drive[_GROUND + 2 * WIDTH + i], step2, state, y)
        scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i] = y


@borrowing_kernel
def _sum_with_harmonic(scratch, drive, harmonic, h, order, count):
    """Take the sum down by ORDERS orders, and that of a harmonic which drives the carriage.

    Parameters
    ----------
    scratch
        (_ROWS,) read, and the partial sums written.
    drive
        (_DRIVE_ROWS,) read [m/s^2]: what else excites the lanes.
    harmonic
        (_HARMONIC_ROWS,) read, and its partial sums written [m/s^2].
    h, order, count
        Piece [s], the next order, and the number of lanes.
    """
    prefer_widest_vectors()
    step0, step1, step2 = h / order, h / (order - 1), h / (order - 2)
    for i in range(count):
        start, frequency = (harmonic[_COSINE + i], harmonic[_SINE + i]), harmonic[_FREQUENCY + i]
        z0 = harmonic[_COSINE_SUM + i], harmonic[_SINE_SUM + i]
        z1 = _turned(start, step0 * frequency, z0)
        z2 = _turned(start, step1 * frequency, z1)
        harmonic[_COSINE_SUM + i], harmonic[_SINE_SUM + i] = _turned(start, step2 * frequency, z2)
        force0, ground0 = drive[i] + z0[1], drive[_GROUND + i]
        force1, ground1 = drive[WIDTH + i] + z1[1], drive[_GROUND + WIDTH + i]
        force2, ground2 = drive[2 * WIDTH + i] + z2[1], drive[_GROUND + 2 * WIDTH + i]
        state = scratch[_X1 + i], scratch[_OFFSET + i], scratch[_V1 + i], scratch[_SLIP + i]
        y = scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i]
        y = _next(scratch, i, force0, ground0, step0, state, y)
        y = _next(scratch, i, force1, ground1, step1, state, y)
        y = _next(scratch, i, force2, ground2, step2, state, y)
        scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i] = y


@borrowing_kernel
def _next(scratch, i, force, ground, step, state, y):
    """Return state + step (A y + excitation).

    Parameters
    ----------
    scratch, i
        (_ROWS,) read: the coefficients of the i-th lane.
    force, ground
        Accelerations [m/s^2] that the carriage's forces cause, and of the ground.
    step
        Piece over order [s].
    state, y
        x1, offset [m], v1 and w [m/s]: at the piece's start, and the partial sum.
    """
    x1, offset, v1, w = y
    coupling = fma(scratch[_C1 + i], w, fma(scratch[_K2 + i], offset, scratch[_PAIR + i]))
    outer = fma(-scratch[_D1 + i], v1, fma(-scratch[_K1 + i], x1, force))
    a1 = coupling + (outer + ground)  # (1) of docs/model.md
    a2 = fma(-scratch[_BOTH + i], coupling, -outer)  # (2) less (1): the ground moves both
    return (
        fma(step, v1, state[0]),
        fma(step, w, state[1]),
        fma(step, a1, state[2]),
        fma(step, a2, state[3]),
    )
