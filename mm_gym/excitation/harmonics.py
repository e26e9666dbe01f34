"""Harmonics: each is turned by its exact rotation in every sample interval.

The rotation's rounding turns the phase a little in the same direction every time, so from time to
time the phase is computed anew from the number of sample intervals since the episode began.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import cosine_and_sine
from mm_gym.lanes.extended import on_circle
from mm_gym.lanes.memory import span

REFRESH = 1024.0
"""Sample intervals after which a phase is computed anew: until then it drifts by 2e-13 at most."""


@borrowing_kernel
def rotate(model, lanes, interval, first, last):
    """Turn every harmonic by one sample interval."""
    harmonics = int(model[layout.HARMONIC_COUNT])
    for j in range(harmonics):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        for i in span(first, last):
            c, s = lanes[harmonic + layout.COSINE, i], lanes[harmonic + layout.SINE, i]
            rc = lanes[harmonic + layout.ROTATE_COSINE, i]
            rs = lanes[harmonic + layout.ROTATE_SINE, i]
            cosine, sine = fma(c, rc, -s * rs), fma(s, rc, c * rs)
            # One Newton step towards length 1, or round-off would add up in the amplitude.
            norm = fma(-0.5, fma(cosine, cosine, sine * sine), 1.5)
            lanes[harmonic + layout.COSINE, i] = cosine * norm
            lanes[harmonic + layout.SINE, i] = sine * norm
    if harmonics > 0:
        made = lanes[layout.NOW, first] * model[layout.INTERVALS] + interval + 1.0
        some_due = False
        for i in span(first, last):
            some_due |= _is_due(made - model[layout.INTERVALS] * lanes[layout.BEGAN, i])
        if some_due:
            _refresh(model, lanes, made, first, last)


@borrowing_kernel
def _is_due(count):
    """Tell whether a phase is computed anew after a number of sample intervals."""
    refreshes = count * (1.0 / REFRESH)
    return np.floor(refreshes) == refreshes


@borrowing_kernel
def _refresh(model, lanes, made, first, last):
    """Compute the phases anew in the lanes where they are due."""
    for i in range(first, last):
        count = made - model[layout.INTERVALS] * lanes[layout.BEGAN, i]
        if _is_due(count):
            for j in range(int(model[layout.HARMONIC_COUNT])):
                harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
                _write_phase(lanes, harmonic, model[layout.SAMPLE_INTERVAL], count, i)


@borrowing_kernel
def _write_phase(lanes, harmonic, step, count, i):
    """Write cosine and sine of phase + frequency * step * count, in twice a double's digits."""
    frequency, phase = lanes[harmonic + layout.FREQUENCY, i], lanes[harmonic + layout.PHASE, i]
    turn = frequency * step
    turned = turn * count
    rest = fma(turn, count, -turned) + fma(frequency, step, -turn) * count
    angle = turned + phase
    added = angle - turned
    rest += (turned - (angle - added)) + (phase - added)  # what the sum lost (Knuth, 1969)
    if not abs(rest) < np.inf:
        return  # beyond the doubles
    lanes[harmonic + layout.COSINE, i], lanes[harmonic + layout.SINE, i] = on_circle((angle, rest))


@borrowing_kernel
def begin_harmonic(lanes, harmonic, time_step, first, last):
    """Write cosine and sine of a harmonic's phase, and of its turn in one sample interval."""
    for i in span(first, last):
        phase, frequency = lanes[harmonic + layout.PHASE, i], lanes[harmonic + layout.FREQUENCY, i]
        turn = frequency * time_step
        # What rounding takes off a turn of many radians would add up; less is below round-off.
        rest = fma(frequency, time_step, -turn) if abs(turn) > 1.0 else 0.0
        (c, s), small = cosine_and_sine(turn), 1.0 - 0.5 * rest * rest
        lanes[harmonic + layout.COSINE, i], lanes[harmonic + layout.SINE, i] = cosine_and_sine(
            phase
        )
        lanes[harmonic + layout.ROTATE_COSINE, i] = c * small - s * rest
        lanes[harmonic + layout.ROTATE_SINE, i] = s * small + c * rest
