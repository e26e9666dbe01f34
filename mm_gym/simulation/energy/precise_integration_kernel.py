"""Precise integration: matrix exponentials by doubled steps, in double precision.

Zhong and Williams, *A precise time step integration method*, Proc. Instn Mech. Engrs C 208 (1994).
The step is halved until its Taylor series is short, and doubled back; the whole step, its half, its
quarter, ... are the levels. Each holds D = exp(A h) - I: (I + D)^2 - I = 2 D + D D loses nothing
while D is small.

With a quadratic form W in z, the energy integral of z' W z over a step follows on the same levels:
Q(2 h) = Q(h) + (I + D)' Q(h) (I + D).
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel

SMALLEST_PHASE = 2.0**-6
"""Largest rate times step on the last level."""

TERMS = 11
"""Terms of the last level's series: 2 * SMALLEST_PHASE to their number is below round-off."""


@kernel
def halvings(phase):
    """Return how often a step is halved until rate times step is at most SMALLEST_PHASE."""
    return max(0, math.ceil(math.log2(max(phase, 1e-300) / SMALLEST_PHASE)))


@kernel
def add_product(out, factor, a, b):
    """Add factor a b to the matrix out; a has rows of zeros."""
    n = a.shape[0]
    for i in range(n):
        for k in range(n):
            scale = factor * a[i, k]
            if scale != 0.0:
                for j in range(n):
                    out[i, j] += scale * b[k, j]


@kernel
def clear(a):
    """Write zeros; the broadcasting of a slice would take seconds to compile."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            a[i, j] = 0.0


@kernel
def add_scaled(out, factor, a):
    """Add factor a to the matrix out."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] += factor * a[i, j]


@kernel
def shortest_step(a, step, out):
    """Write exp(a step) - I for a short step, by its Taylor series."""
    term, following = np.zeros(a.shape), np.zeros(a.shape)
    add_scaled(term, step, a)
    add_scaled(out, step, a)
    for order in range(2, TERMS + 1):
        clear(following)
        add_product(following, step / order, a, term)
        term, following = following, term
        add_scaled(out, 1.0, term)


@kernel
def first_form(a, weight, step, out):
    """Write the integral of exp(a t)' W exp(a t) over a short step.

    It is the sum of step^(k + 1) / (k + 1)! L^k(W), L(W) = W a + a' W.
    """
    n = a.shape[0]
    term, half = np.zeros((n, n)), np.zeros((n, n))
    add_scaled(term, step, weight)
    add_scaled(out, step, weight)
    for order in range(2, TERMS + 1):
        clear(half)
        add_product(half, step / order, term, a)
        for i in range(n):
            for j in range(n):
                term[i, j] = half[i, j] + half[j, i]
        add_scaled(out, 1.0, term)


@kernel
def double_up(a, step, levels):
    """Write the levels (depth + 1, n, n) of one regime, the whole step first."""
    depth = levels.shape[0] - 1
    shortest_step(a, step * 0.5**depth, levels[depth])
    for j in range(depth - 1, -1, -1):
        add_scaled(levels[j], 2.0, levels[j + 1])
        add_product(levels[j], 1.0, levels[j + 1], levels[j + 1])


@kernel
def double_forms_up(a, weight, step, levels, forms):
    """Write the integral of z' W z over each level as a form (n, n) of z at its start."""
    depth = levels.shape[0] - 1
    first_form(a, weight, step * 0.5**depth, forms[depth])
    half = np.zeros(a.shape)
    for j in range(depth - 1, -1, -1):
        clear(half)
        add_scaled(half, 1.0, forms[j + 1])
        add_product(half, 1.0, forms[j + 1], levels[j + 1])
        add_scaled(forms[j], 1.0, forms[j + 1])
        add_scaled(forms[j], 1.0, half)
        add_product(forms[j], 1.0, levels[j + 1].T, half)
