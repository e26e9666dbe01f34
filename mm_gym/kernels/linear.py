"""Exact propagation of a linear plant by a precomputed transition matrix."""

from __future__ import annotations

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import borrowing_kernel

# Slots of the model: 4 rows of the transition matrix, then per tone 4 responses to its cosine and 4
# to its sine, then 4 to each term of both jets.
TRANSITION = at.MODEL_OWN  # [exp(A dt) | response to a held force], row-major (4, 5)
RESPONSES = TRANSITION + 20


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance x' = A x + B u + E z by one control step; u is held, z turns (Van Loan, 1978)."""
    # Scalars: an array of coefficients would be checked for overlap with every row before the loop.
    to_x1, to_x2 = five(model, TRANSITION), five(model, TRANSITION + 5)
    to_v1, to_v2 = five(model, TRANSITION + 10), five(model, TRANSITION + 15)
    x1s, x2s = lanes[at.X1, first:last], lanes[at.X2, first:last]
    v1s, v2s = lanes[at.V1, first:last], lanes[at.V2, first:last]
    us = lanes[at.FORCE, first:last]
    for i in range(last - first):
        x1, x2, v1, v2, u = x1s[i], x2s[i], v1s[i], v2s[i], us[i]
        x1s[i] = product(to_x1, x1, x2, v1, v2, u)
        x2s[i] = product(to_x2, x1, x2, v1, v2, u)
        v1s[i] = product(to_v1, x1, x2, v1, v2, u)
        v2s[i] = product(to_v2, x1, x2, v1, v2, u)
    for j in range(int(model[at.TONE_COUNT])):
        tone = at.TONES + at.TONE_ROWS * j
        amplitudes = lanes[tone + at.AMPLITUDE, first:last]
        cosines, sines = lanes[tone + at.COSINE, first:last], lanes[tone + at.SINE, first:last]
        for row in range(4):
            on_cosine, on_sine = model[RESPONSES + 8 * j + row], model[RESPONSES + 8 * j + 4 + row]
            reached = lanes[row, first:last]
            for i in range(last - first):
                reached[i] += amplitudes[i] * (on_cosine * cosines[i] + on_sine * sines[i])
    terms, jets = int(model[at.TERMS]), int(model[at.JETS])
    responses = RESPONSES + 8 * int(model[at.TONE_COUNT])
    for n in range(2 * terms):
        coefficients = lanes[jets + n, first:last]
        for row in range(4):
            on_term, reached = model[responses + 4 * n + row], lanes[row, first:last]
            for i in range(last - first):
                reached[i] += on_term * coefficients[i]
    return at.OK


@borrowing_kernel
def five(model, k):
    """Return the five coefficients from slot k."""
    return model[k], model[k + 1], model[k + 2], model[k + 3], model[k + 4]


@borrowing_kernel
def product(m, x1, x2, v1, v2, u):
    """Return a row of the transition matrix times state and force."""
    return fma(m[0], x1, fma(m[1], x2, fma(m[2], v1, fma(m[3], v2, m[4] * u))))
