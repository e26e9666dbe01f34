"""Matrices of the filters of noise over a sample interval.

Tags such as (E8) are equations of docs/excitation.md.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels.jit import kernel

ORDER = 4
"""States of a filter: x, x' / w of the low-pass, then y, y' / w of the high-pass, if it has one."""

# Matrices, packed by rows: the transition in full, the Cholesky factors of the covariances of a
# sample interval (SPREAD) and of the stationary distribution (START_SPREAD) as lower triangles.
# OUTPUT: what the states contribute to the noise.
TRANSITION, SPREAD, START_SPREAD, OUTPUT, MATRICES = 0, 16, 26, 36, 40

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4; its remainder is below round-off."""


@kernel
def write_matrices(matrices, first, low_pass, high_pass, passes_velocity, step, i):
    """Write the matrices of a filter over a sample interval, for an output of variance 1.

    The output is linear between its samples, and its variance is the average over time (E15).
    The low-pass (E9) drives, if its frequency is not 0, the high-pass (E11). The covariances follow
    from that of a short time by doubling (E14); after many doublings the covariance is the
    stationary one, the solution of Lyapunov's equation.

    Parameters
    ----------
    matrices
        (rows, lanes) float64, written.
    first
        The first row.
    low_pass, high_pass
        Frequency [rad/s] and damping ratio of both.
    passes_velocity
        Whether the low-pass hands on x + 2 z x' / w (E10), as soil does, instead of x.
    step
        Sample interval [s].
    i
        The lane.
    """
    f, out = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    w, damping = low_pass[0], 2.0 * low_pass[1]
    f[0, 1], f[1, 0], f[1, 1] = w, -w, -damping * w  # (E9)
    out[0], out[1] = 1.0, damping if passes_velocity else 0.0  # (E10)
    high, high_damping = high_pass[0], 2.0 * high_pass[1]
    if high > 0.0:
        f[2, 3] = high  # (E11)
        f[3, 0], f[3, 1], f[3, 2], f[3, 3] = (
            high * out[0],
            high * out[1],
            -high,
            -high * high_damping,
        )
        out[2], out[3] = -1.0, -high_damping
    rate = w * (1.0 + damping) + high * (2.0 + damping + high_damping)
    halvings = max(0, math.ceil(math.log2(rate * step * 16.0)))
    transition, covariance = _short_step(f, w, step * 0.5**halvings)
    for _ in range(halvings):
        transition, covariance = _doubled(transition, covariance)
    for k in range(ORDER):
        for j in range(ORDER):
            matrices[first + TRANSITION + ORDER * k + j, i] = transition[k, j]
    _write_root(covariance, matrices, first + SPREAD, i)
    for _ in range(80):  # 2^80 sample intervals: the first state has decayed for any damping
        transition, covariance = _doubled(transition, covariance)
    _write_root(covariance, matrices, first + START_SPREAD, i)
    present = following = 0.0  # covariances of a sample with itself and with the next
    for k in range(ORDER):
        for j in range(ORDER):
            present += out[k] * covariance[k, j] * out[j]
            for m in range(ORDER):
                reached = matrices[first + TRANSITION + ORDER * k + m, i]
                following += out[k] * reached * covariance[m, j] * out[j]
    variance = (2.0 * present + following) / 3.0  # (E15)
    for k in range(ORDER):
        matrices[first + OUTPUT + k, i] = out[k] / math.sqrt(variance)


@kernel
def _short_step(f, w, step):
    """Return exp(f h) and the state's covariance (E13) after a short h, by their Taylor series."""
    transition, term = np.eye(ORDER), np.eye(ORDER)
    covariance, form = np.zeros((ORDER, ORDER)), np.zeros((ORDER, ORDER))
    form[1, 1] = covariance[1, 1] = w * step
    for n in range(2, SERIES + 2):
        term = _product(f, term) * (step / (n - 1.0))
        transition = transition + term
        half = _product(f, form)
        form = (half + half.T) * (step / n)
        covariance = covariance + form
    return transition, covariance


@kernel
def _doubled(transition, covariance):
    """Return transition and covariance over twice the time (E14)."""
    spread = _product(_product(transition, covariance), transition.T)
    return _product(transition, transition), covariance + spread


@kernel
def _product(a, b):
    """Return a b; a library's product would round differently on other machines."""
    out = np.zeros((ORDER, ORDER))
    for i in range(ORDER):
        for j in range(ORDER):
            for k in range(ORDER):
                out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def _write_root(covariance, matrices, row, i):
    """Write the Cholesky factor, packed by rows; pivots as small as round-off count as zero."""
    root = np.zeros((ORDER, ORDER))
    for k in range(ORDER):
        for j in range(k + 1):
            rest = covariance[k, j]
            for m in range(j):
                rest -= root[k, m] * root[j, m]
            if j == k:
                root[k, k] = math.sqrt(rest) if rest > 1e-15 * covariance[k, k] else 0.0
            else:
                root[k, j] = rest / root[j, j] if root[j, j] > 0.0 else 0.0
            matrices[row + k * (k + 1) // 2 + j, i] = root[k, j]
