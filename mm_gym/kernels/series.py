"""Propagation of a linear plant whose parameters differ from lane to lane or change from step to step.

The exponential acts on the vector as a truncated Taylor series. Its degree and substeps are chosen when the scene is
compiled, for the fastest motion that the scene's support can reach, so that what is cut off is below round-off.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel

DEGREE, SUBSTEPS = at.MODEL_OWN, at.MODEL_OWN + 1

# A block is copied into one scratch array whose rows lie BLOCK apart: with distances known when it is compiled, the
# compiler vectorises the loops without checking for overlap. Offsets of its rows: the state, the present term of its
# series, the forces divided by the masses (D1 = d/m1, K2M1 = k2/m1 ...), and the excitation's present term.
_X1, _X2, _V1, _V2 = 0, at.BLOCK, 2 * at.BLOCK, 3 * at.BLOCK
_TX1, _TX2, _TV1, _TV2 = 4 * at.BLOCK, 5 * at.BLOCK, 6 * at.BLOCK, 7 * at.BLOCK
_P1, _P2 = 8 * at.BLOCK, 9 * at.BLOCK
_K1, _D1, _C1, _C2 = 10 * at.BLOCK, 11 * at.BLOCK, 12 * at.BLOCK, 13 * at.BLOCK
_K2M1, _K2M2, _M1 = 14 * at.BLOCK, 15 * at.BLOCK, 16 * at.BLOCK
_TONES = 17 * at.BLOCK  # per tone three rows: the present term, the next one, and -(w h)**2
_VALUE, _SLOPE, _TURN = 0, at.BLOCK, 2 * at.BLOCK


@kernel
def propagate(model, lanes, first, last):
    """Advance m x'' = forces by one control step; force and stretch are held over it."""
    substeps, tones, count = int(model[SUBSTEPS]), int(model[at.TONE_COUNT]), last - first
    h = model[at.TIME_STEP] / substeps
    scratch = np.empty(_TONES + 3 * at.BLOCK * tones)
    _load(lanes, scratch, first, last)
    for substep in range(substeps):
        _begin(model, lanes, scratch, h, substep, first, last)
        for order in range(1, int(model[DEGREE]) + 1):
            _next_term(scratch, h / order, count)
            for j in range(tones):
                _next_excitation(scratch, _TONES + 3 * at.BLOCK * j, 1.0 / (order * (order + 1.0)), count)
                _add_tone(scratch, _TONES + 3 * at.BLOCK * j, (int(model[at.GROUND]) >> j) & 1, count)
    for row in range(4):
        reached = lanes[row, first:last]
        for i in range(count):
            reached[i] = scratch[row * at.BLOCK + i]
    return at.OK


@kernel
def _load(lanes, scratch, first, last):
    """Copy the state and divide the coefficients by the masses."""
    for row in range(4):
        present = lanes[row, first:last]
        for i in range(last - first):
            scratch[row * at.BLOCK + i] = present[i]
    for i in range(last - first):
        k = first + i
        m1, m2, stretch = lanes[at.M1, k], lanes[at.M2, k], lanes[at.STRETCH, k]
        # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
        k2 = 2.0 * lanes[at.K0, k] * (1.0 + 2.0 / (stretch * stretch * stretch))
        scratch[_K1 + i] = lanes[at.K1, k] * lanes[at.ALPHA, k] / m1
        scratch[_D1 + i] = lanes[at.D, k] / m1
        scratch[_C1 + i], scratch[_C2 + i] = lanes[at.C, k] / m1, lanes[at.C, k] / m2
        scratch[_K2M1 + i], scratch[_K2M2 + i] = k2 / m1, k2 / m2
        scratch[_M1 + i] = m1


@kernel
def _begin(model, lanes, scratch, h, substep, first, last):
    """Write the terms of order zero: the state, the held force, each tone's value and slope."""
    count = last - first
    forces = lanes[at.FORCE, first:last]
    for i in range(count):
        scratch[_TX1 + i], scratch[_TX2 + i] = scratch[_X1 + i], scratch[_X2 + i]
        scratch[_TV1 + i], scratch[_TV2 + i] = scratch[_V1 + i], scratch[_V2 + i]
        scratch[_P1 + i], scratch[_P2 + i] = forces[i] / scratch[_M1 + i], 0.0
    for j in range(int(model[at.TONE_COUNT])):
        tone, own = at.TONES + at.TONE_ROWS * j, _TONES + 3 * at.BLOCK * j
        ground = (int(model[at.GROUND]) >> j) & 1
        for i in range(count):
            k = first + i
            w, scale = lanes[tone + at.FREQUENCY, k], lanes[tone + at.AMPLITUDE, k]
            if not ground:
                scale /= scratch[_M1 + i]
            cosine, sine = lanes[tone + at.COSINE, k], lanes[tone + at.SINE, k]
            if substep > 0:
                turn_cosine, turn_sine = math.cos(w * h * substep), math.sin(w * h * substep)
                cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
            scratch[own + _VALUE + i] = scale * sine
            scratch[own + _SLOPE + i] = scale * cosine * (w * h)
            scratch[own + _TURN + i] = -(w * h) * (w * h)
        _add_tone(scratch, own, ground, count)


@kernel
def _next_term(scratch, step, count):
    """Turn the term of order n - 1 into that of order n (step = h / n) and add it to the state."""
    for i in range(count):
        x1, x2, v1, v2 = scratch[_TX1 + i], scratch[_TX2 + i], scratch[_TV1 + i], scratch[_TV2 + i]
        slip, offset = v2 - v1, x2 - x1
        a1 = scratch[_C1 + i] * slip + scratch[_K2M1 + i] * offset - scratch[_D1 + i] * v1 - scratch[_K1 + i] * x1
        a2 = -scratch[_C2 + i] * slip - scratch[_K2M2 + i] * offset
        next_v1, next_v2 = step * (a1 + scratch[_P1 + i]), step * (a2 + scratch[_P2 + i])
        scratch[_TX1 + i], scratch[_TX2 + i] = step * v1, step * v2
        scratch[_TV1 + i], scratch[_TV2 + i] = next_v1, next_v2
        scratch[_P1 + i], scratch[_P2 + i] = 0.0, 0.0
        scratch[_X1 + i] += step * v1
        scratch[_X2 + i] += step * v2
        scratch[_V1 + i] += next_v1
        scratch[_V2 + i] += next_v2


@kernel
def _next_excitation(scratch, own, factor, count):
    """Advance a tone's series: p'' = -w**2 p, so term n + 1 follows from term n - 1."""
    for i in range(count):
        previous = scratch[own + _VALUE + i]
        scratch[own + _VALUE + i] = scratch[own + _SLOPE + i]
        scratch[own + _SLOPE + i] = previous * scratch[own + _TURN + i] * factor


@kernel
def _add_tone(scratch, own, ground, count):
    """Add a tone's present term to the accelerations: a force on the carriage, or the ground under both."""
    if ground:
        for i in range(count):
            scratch[_P1 + i] -= scratch[own + i]
            scratch[_P2 + i] -= scratch[own + i]
    else:
        for i in range(count):
            scratch[_P1 + i] += scratch[own + i]
