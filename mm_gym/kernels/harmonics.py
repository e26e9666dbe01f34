"""Harmonics: each is turned by its exact rotation in every sample interval."""

from __future__ import annotations

import math

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.memory import span


@borrowing_kernel
def rotate(model, lanes, first, last):
    """Turn every harmonic by one sample interval."""
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        for i in span(first, last):
            c, s = lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i]
            rc, rs = lanes[harmonic + at.ROTATE_COSINE, i], lanes[harmonic + at.ROTATE_SINE, i]
            cosine, sine = fma(c, rc, -s * rs), fma(s, rc, c * rs)
            # One Newton step towards length 1, or round-off would add up in the amplitude.
            norm = fma(-0.5, fma(cosine, cosine, sine * sine), 1.5)
            lanes[harmonic + at.COSINE, i], lanes[harmonic + at.SINE, i] = (
                cosine * norm,
                sine * norm,
            )


@borrowing_kernel
def begin_harmonic(lanes, harmonic, time_step, first, last):
    """Write cosine and sine of a harmonic's phase, and of its turn in one sample interval."""
    for i in span(first, last):
        phase, turn = lanes[harmonic + at.PHASE, i], lanes[harmonic + at.FREQUENCY, i] * time_step
        lanes[harmonic + at.COSINE, i] = math.cos(phase)
        lanes[harmonic + at.SINE, i] = math.sin(phase)
        lanes[harmonic + at.ROTATE_COSINE, i] = math.cos(turn)
        lanes[harmonic + at.ROTATE_SINE, i] = math.sin(turn)
