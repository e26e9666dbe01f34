"""Propagation of a linear plant whose parameters differ between lanes or change between steps.

The exponential acts on the vector as a truncated Taylor series. Its degree and substeps are chosen
when the scene is compiled, for the fastest motion that the scene's support can reach, so that what
is cut off is below round-off.

The series is summed from its highest order down, y <- x + (h / n) A y (Horner), which needs no
memory of the terms; several orders are taken in one pass over the lanes, so that the state stays in
registers between them.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import borrowing_kernel, kernel

DEGREE, SUBSTEPS = at.MODEL_OWN, at.MODEL_OWN + 1

# Some lanes at a time are copied into scratch arrays whose rows lie WIDTH apart: with distances
# known when it is compiled, the compiler vectorises the loops without checking for overlap.
WIDTH = 128

# Scratch: the state at the substep's start, the partial sum, K1 = k1/m1 ..., m1/m2, and the held
# force over m1.
_ROWS = 14 * WIDTH
_X1, _X2, _V1, _V2, _Y1, _Y2, _W1, _W2, *_COEFFICIENTS = range(0, _ROWS, WIDTH)
_K1, _D1, _C1, _K2, _RATIO, _HELD = _COEFFICIENTS

# Drive: accelerations of the carriage, then of the sphere if the ground shakes, a row for each
# order of a pass.
ORDERS = 4  # summed in one pass; the degree is rounded up to a multiple
_SPHERE = ORDERS * WIDTH
_DRIVE_ROWS = 2 * _SPHERE

# Tones: cosine and sine at the substep's start, scaled to an acceleration; their partial sums; and
# the turn w h.
_TONE_ROWS = 5 * WIDTH
_COSINE, _SINE, _COSINE_SUM, _SINE_SUM, _TURN = range(0, _TONE_ROWS, WIDTH)


@kernel
def propagate(model, lanes, first, last):
    """Advance m x'' = forces by one control step; force and stretch are held over it."""
    scratch, drive = np.empty(_ROWS), np.empty(_DRIVE_ROWS)
    tones = np.empty((int(model[at.TONE_COUNT]), _TONE_ROWS))
    jets = np.empty((2 * int(model[at.TERMS]), WIDTH))
    for start in range(first, last, WIDTH):
        _propagate(model, lanes, scratch, drive, tones, jets, start, min(WIDTH, last - start))
    return at.OK


@borrowing_kernel
def _propagate(model, lanes, scratch, drive, tones, jets, first, count):
    substeps, ground = int(model[SUBSTEPS]), int(model[at.GROUND])
    highest = ORDERS * math.ceil(model[DEGREE] / ORDERS)
    h = model[at.TIME_STEP] / substeps
    _load(lanes, scratch, first, count)
    _hold(scratch, drive, count)
    _rest(drive, count)
    for j in range(tones.shape[0]):
        _load_tone(lanes, tones[j], j, (ground >> j) & 1, h, first, count)
    _load_jets(model, lanes, jets, substeps, first, count)
    for _ in range(substeps):
        _copy(scratch[_X1:], scratch[_Y1:], count)
        for order in range(highest, 0, -ORDERS):
            _excite(scratch, drive, tones, jets, ground, order, count)
            _sum(scratch, drive, h, order, count)
        _copy(scratch[_Y1:], scratch[_X1:], count)
        for j in range(tones.shape[0]):
            _continue_tone(tones[j], count)
        _continue_jets(jets, count)
    for row in range(4):
        reached = lanes[row, first : first + count]
        for i in range(count):
            reached[i] = scratch[row * WIDTH + i]


@borrowing_kernel
def _load(lanes, scratch, first, count):
    """Copy the state and divide the coefficients by the mass of the carriage."""
    for row in range(4):
        present = lanes[row, first : first + count]
        for i in range(count):
            scratch[row * WIDTH + i] = present[i]
    m1, m2, stretch = lanes[at.M1, first:], lanes[at.M2, first:], lanes[at.STRETCH, first:]
    k1, alpha, d = lanes[at.K1, first:], lanes[at.ALPHA, first:], lanes[at.D, first:]
    c, k0, force = lanes[at.C, first:], lanes[at.K0, first:], lanes[at.FORCE, first:]
    for i in range(count):
        # Small on large, eq. 15 of the paper; without springs stretch and k0 are zero.
        softening = 2.0 / (stretch[i] * stretch[i] * stretch[i])
        k2 = 2.0 * k0[i] * (1.0 + softening) if k0[i] > 0.0 else 0.0
        per_mass = 1.0 / m1[i]
        scratch[_K1 + i], scratch[_D1 + i] = k1[i] * alpha[i] * per_mass, d[i] * per_mass
        scratch[_C1 + i], scratch[_K2 + i] = c[i] * per_mass, k2 * per_mass
        scratch[_RATIO + i], scratch[_HELD + i] = m1[i] / m2[i], force[i] * per_mass


@borrowing_kernel
def _load_tone(lanes, tone, j, ground, h, first, count):
    """Copy a tone's phase, scaled to an acceleration."""
    row = at.TONES + at.TONE_ROWS * j
    amplitudes, frequencies = lanes[row + at.AMPLITUDE, first:], lanes[row + at.FREQUENCY, first:]
    cosines, sines = lanes[row + at.COSINE, first:], lanes[row + at.SINE, first:]
    m1 = lanes[at.M1, first:]
    for i in range(count):
        scale = -amplitudes[i] if ground else amplitudes[i] / m1[i]
        c, s = scale * cosines[i], scale * sines[i]
        tone[_COSINE + i], tone[_SINE + i], tone[_TURN + i] = c, s, frequencies[i] * h
        tone[_COSINE_SUM + i], tone[_SINE_SUM + i] = c, s


@borrowing_kernel
def _continue_tone(tone, count):
    """Start from the phase that the tone's series has reached."""
    for i in range(count):
        tone[_COSINE + i], tone[_SINE + i] = tone[_COSINE_SUM + i], tone[_SINE_SUM + i]


@borrowing_kernel
def _load_jets(model, lanes, jets, substeps, first, count):
    """Copy both jets as coefficients of (t / h)^n, h the series' own substep."""
    terms, row = int(model[at.TERMS]), int(model[at.JETS])
    m1 = lanes[at.M1, first:]
    for k in range(2 * terms):
        coefficients, scale = lanes[row + k, first:], float(substeps) ** -(k % terms)
        for i in range(count):
            jets[k, i] = coefficients[i] * (scale / m1[i] if k < terms else -scale)


@borrowing_kernel
def _continue_jets(jets, count):
    """Shift both jets to the next substep, (t + 1)^n, by Horner's scheme."""
    terms = jets.shape[0] // 2
    for first in range(0, 2 * terms, max(terms, 1)):
        for start in range(terms - 1):
            for n in range(first + terms - 2, first + start - 1, -1):
                for i in range(count):
                    jets[n, i] += jets[n + 1, i]


@borrowing_kernel
def _add_jets(jets, drive, order, count):
    """Add both jets to the drive of the next orders.

    Horner's scheme takes (h^n / n!) p^(n) at order m by n! m! / (m + n)!.
    """
    terms = jets.shape[0] // 2
    for k in range(ORDERS):
        weight = 1.0
        for n in range(terms):
            for i in range(count):
                drive[WIDTH * k + i] += weight * jets[n, i]
                drive[_SPHERE + WIDTH * k + i] += weight * jets[terms + n, i]
            weight *= (n + 1.0) / (order - k + n + 1.0)


@borrowing_kernel
def _copy(source, target, count):
    """Copy four rows."""
    for i in range(count):
        x1, x2, v1, v2 = source[i], source[WIDTH + i], source[2 * WIDTH + i], source[3 * WIDTH + i]
        target[i], target[WIDTH + i], target[2 * WIDTH + i], target[3 * WIDTH + i] = x1, x2, v1, v2


@borrowing_kernel
def _excite(scratch, drive, tones, jets, ground, order, count):
    """Write the drive of the next orders: the held force, all tones and both jets."""
    if tones.shape[0] + jets.shape[0] == 0:
        return
    shaken = ground + jets.shape[0] > 0
    _hold(scratch, drive, count)
    if shaken:
        _rest(drive, count)
    for j in range(tones.shape[0]):
        _add_tone(tones[j], drive[_SPHERE:] if (ground >> j) & 1 else drive, order, count)
    _add_jets(jets, drive, order, count)
    if shaken:
        _shake(drive, count)


@borrowing_kernel
def _rest(drive, count):
    """Begin the drive of the sphere with a ground at rest."""
    for i in range(count):
        for row in range(_SPHERE, _DRIVE_ROWS, WIDTH):
            drive[row + i] = 0.0


@borrowing_kernel
def _shake(drive, count):
    """Let the ground drive the carriage too."""
    for row in range(0, _SPHERE, WIDTH):
        for i in range(count):
            drive[row + i] += drive[_SPHERE + row + i]


@borrowing_kernel
def _hold(scratch, drive, count):
    """Begin the drive of the next orders with the held force."""
    for i in range(count):
        a = scratch[_HELD + i]
        drive[i], drive[WIDTH + i], drive[2 * WIDTH + i], drive[3 * WIDTH + i] = a, a, a, a


@borrowing_kernel
def _add_tone(tone, target, order, count):
    """Add a tone to the drive of the next orders; sum its own series c' = -w s, s' = w c."""
    part0, part1 = 1.0 / order, 1.0 / (order - 1)
    part2, part3 = 1.0 / (order - 2), 1.0 / (order - 3)
    for i in range(count):
        start, turn = (tone[_COSINE + i], tone[_SINE + i]), tone[_TURN + i]
        z0 = tone[_COSINE_SUM + i], tone[_SINE_SUM + i]
        z1 = _turned(start, part0 * turn, z0)
        z2 = _turned(start, part1 * turn, z1)
        z3 = _turned(start, part2 * turn, z2)
        tone[_COSINE_SUM + i], tone[_SINE_SUM + i] = _turned(start, part3 * turn, z3)
        target[i] += z0[1]
        target[WIDTH + i] += z1[1]
        target[2 * WIDTH + i] += z2[1]
        target[3 * WIDTH + i] += z3[1]


@borrowing_kernel
def _turned(start, angle, z):
    """Return start + angle (-sin, cos) of the phase z = (cos, sin)."""
    return fma(-angle, z[1], start[0]), fma(angle, z[0], start[1])


@borrowing_kernel
def _sum(scratch, drive, h, order, count):
    """Take the sum down by ORDERS orders."""
    step0, step1, step2, step3 = h / order, h / (order - 1), h / (order - 2), h / (order - 3)
    for i in range(count):
        state = scratch[_X1 + i], scratch[_X2 + i], scratch[_V1 + i], scratch[_V2 + i]
        y = scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i]
        y = _next(scratch, i, drive[i], drive[_SPHERE + i], step0, state, y)
        y = _next(scratch, i, drive[WIDTH + i], drive[_SPHERE + WIDTH + i], step1, state, y)
        y = _next(scratch, i, drive[2 * WIDTH + i], drive[_SPHERE + 2 * WIDTH + i], step2, state, y)
        y = _next(scratch, i, drive[3 * WIDTH + i], drive[_SPHERE + 3 * WIDTH + i], step3, state, y)
        scratch[_Y1 + i], scratch[_Y2 + i], scratch[_W1 + i], scratch[_W2 + i] = y


@borrowing_kernel
def _next(scratch, i, force, ground, step, state, y):
    """Return state + step (A y + excitation)."""
    x1, x2, v1, v2 = y
    coupling = fma(scratch[_C1 + i], v2 - v1, scratch[_K2 + i] * (x2 - x1))
    a1 = coupling + fma(-scratch[_K1 + i], x1, fma(-scratch[_D1 + i], v1, force))
    a2 = fma(-scratch[_RATIO + i], coupling, ground)
    return (
        fma(step, v1, state[0]),
        fma(step, v2, state[1]),
        fma(step, a1, state[2]),
        fma(step, a2, state[3]),
    )
