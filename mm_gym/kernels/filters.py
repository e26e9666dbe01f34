"""Matrices of the filters of noise over a sample interval.

Tags such as (E8) are equations of docs/excitation.md.

Matrices of four states are four blocks of two by two, each packed by rows: those of the low-pass,
of the high-pass on it, of it on the high-pass, and of the high-pass. A filter without high-pass has
the first block alone. They are tuples, because an array for each product would take longer than
the arithmetic.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels.jit import borrowing_kernel, inlined_kernel, kernel

ORDER = 4
"""States of a filter: x, x' / w of the low-pass, then y, y' / w of the high-pass, if it has one."""

# Matrices, packed by rows: the transition in full, the Cholesky factors of the covariances of a
# sample interval (SPREAD) and of the stationary distribution (START_SPREAD) as lower triangles.
# OUTPUT: what the states contribute to the noise.
TRANSITION, SPREAD, START_SPREAD, OUTPUT, MATRICES = 0, 16, 26, 36, 40

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4; its remainder is below round-off."""

ZERO, UNIT = (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0)
"""Blocks."""


@kernel
def write_matrices(matrices, first, filters, passes_velocity, step, which):
    """Write the matrices of filters over a sample interval, for an output of variance 1.

    The output is linear between its samples, and its variance is the average over time (E15).
    The low-pass (E9) drives, if its frequency is not 0, the high-pass (E11).

    Parameters
    ----------
    matrices
        (rows, lanes) float64, written; without high-pass only the numbers of the first two states.
    first
        The first row.
    filters
        (4, lanes) float64, read: frequency [rad/s] and damping ratio of the low-pass, then of the
        high-pass.
    passes_velocity
        Whether the low-pass hands on x + 2 z x' / w (E10), as soil does, instead of x.
    step
        Sample interval [s].
    which
        (b,) int64, read: the lanes.
    """
    transition, covariance = np.zeros((ORDER, ORDER)), np.zeros((ORDER, ORDER))
    for i in which:
        w, damping = filters[0, i], 2.0 * filters[1, i]
        high, high_damping = filters[2, i], 2.0 * filters[3, i]
        has_high_pass = high > 0.0
        order = ORDER if has_high_pass else ORDER // 2
        passed = damping if passes_velocity else 0.0  # (E10)
        f = (
            (0.0, w, -w, -damping * w),  # (E9)
            ZERO,
            (0.0, 0.0, high, high * passed),
            (0.0, high, -high, -high * high_damping),  # (E11)
        )
        rate = w * (1.0 + damping) + high * (2.0 + damping + high_damping)
        halvings = max(0, math.ceil(math.log2(rate * step * 16.0)))
        if has_high_pass:  # compiled for each
            reached, added, stationary = _moments(f, w, step, halvings, True)
        else:
            reached, added, stationary = _moments(f, w, step, halvings, False)
        _unpack(reached, transition)
        for k in range(order):
            for j in range(order):
                matrices[first + TRANSITION + ORDER * k + j, i] = transition[k, j]
        _unpack(added, covariance)
        _write_root(covariance, order, matrices, first + SPREAD, i)
        _unpack(stationary, covariance)
        _write_root(covariance, order, matrices, first + START_SPREAD, i)
        out = (1.0, passed, -1.0, -high_damping)
        _write_output(out, transition, covariance, order, matrices, first + OUTPUT, i)


@inlined_kernel
def _moments(f, w, step, halvings, has_high_pass):
    """Return a filter's transition and covariances, over a sample interval and stationary.

    They follow from those of a short time by doubling (E14): after many doublings the covariance is
    the stationary one, the solution of Lyapunov's equation.

    Parameters
    ----------
    f
        The filter [1/s].
    w
        Frequency of its low-pass [rad/s].
    step, halvings
        Sample interval [s], and how many times it is halved for the short time.
    has_high_pass
        Whether it has a high-pass.
    """
    transition, covariance = _short_step(f, w, step * 0.5**halvings, has_high_pass)
    for _ in range(halvings):
        transition, covariance = _doubled(transition, covariance, has_high_pass)
    reached, added = transition, covariance
    for _ in range(80):  # 2^80 sample intervals: the first state has decayed for any damping
        transition, grown = _doubled(transition, covariance, has_high_pass)
        if grown == covariance:  # what is added later is smaller still
            break
        covariance = grown
    return reached, added, covariance


@inlined_kernel
def _short_step(f, w, step, has_high_pass):
    """Return exp(f h) and the state's covariance (E13) after a short h, by their Taylor series."""
    transition = term = (UNIT, ZERO, ZERO, UNIT)
    covariance = form = ((0.0, 0.0, 0.0, w * step), ZERO, ZERO, ZERO)
    for n in range(2, SERIES + 2):
        term = _scaled(_product(f, term, has_high_pass), step / (n - 1.0))
        transition = _sum(transition, term)
        half = _product(f, form, has_high_pass)
        form = _scaled(_sum(half, _transposed(half)), step / n)
        covariance = _sum(covariance, form)
    return transition, covariance


@inlined_kernel
def _doubled(transition, covariance, has_high_pass):
    """Return transition and covariance over twice the time (E14)."""
    moved = _product(transition, covariance, has_high_pass)
    spread = _product(moved, _transposed(transition), has_high_pass)
    return _product(transition, transition, has_high_pass), _sum(covariance, spread)


@inlined_kernel
def _product(a, b, has_high_pass):
    """Return a b; a library's product would round differently on other machines."""
    low = _add_product(ZERO, a[0], b[0])
    if not has_high_pass:
        return low, ZERO, ZERO, ZERO
    return (
        _add_product(low, a[1], b[2]),
        _add_product(_add_product(ZERO, a[0], b[1]), a[1], b[3]),
        _add_product(_add_product(ZERO, a[2], b[0]), a[3], b[2]),
        _add_product(_add_product(ZERO, a[2], b[1]), a[3], b[3]),
    )


@borrowing_kernel
def _add_product(total, a, b):
    """Return total + a b of blocks."""
    return (
        total[0] + a[0] * b[0] + a[1] * b[2],
        total[1] + a[0] * b[1] + a[1] * b[3],
        total[2] + a[2] * b[0] + a[3] * b[2],
        total[3] + a[2] * b[1] + a[3] * b[3],
    )


@borrowing_kernel
def _sum(a, b):
    """Return a + b."""
    return _plus(a[0], b[0]), _plus(a[1], b[1]), _plus(a[2], b[2]), _plus(a[3], b[3])


@borrowing_kernel
def _plus(a, b):
    """Return a + b of blocks."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@borrowing_kernel
def _scaled(a, factor):
    """Return a times a number."""
    return _times(a[0], factor), _times(a[1], factor), _times(a[2], factor), _times(a[3], factor)


@borrowing_kernel
def _times(a, factor):
    """Return a block times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor, a[3] * factor


@borrowing_kernel
def _transposed(a):
    """Return the transpose of a."""
    return _turned(a[0]), _turned(a[2]), _turned(a[1]), _turned(a[3])


@borrowing_kernel
def _turned(a):
    """Return the transpose of a block."""
    return a[0], a[2], a[1], a[3]


@borrowing_kernel
def _unpack(a, out):
    """Write the blocks of a into an array (4, 4)."""
    (out[0, 0], out[0, 1], out[1, 0], out[1, 1]) = a[0]
    (out[0, 2], out[0, 3], out[1, 2], out[1, 3]) = a[1]
    (out[2, 0], out[2, 1], out[3, 0], out[3, 1]) = a[2]
    (out[2, 2], out[2, 3], out[3, 2], out[3, 3]) = a[3]


@borrowing_kernel
def _write_root(covariance, order, matrices, row, i):
    """Write the Cholesky factor, packed by rows; pivots as small as round-off count as zero."""
    for k in range(order):
        below = row + k * (k + 1) // 2
        for j in range(k + 1):
            rest, right = covariance[k, j], row + j * (j + 1) // 2
            for m in range(j):
                rest -= matrices[below + m, i] * matrices[right + m, i]
            if j == k:
                rest = math.sqrt(rest) if rest > 1e-15 * covariance[k, k] else 0.0
            else:
                pivot = matrices[right + j, i]
                rest = rest / pivot if pivot > 0.0 else 0.0
            matrices[below + j, i] = rest


@borrowing_kernel
def _write_output(out, transition, covariance, order, matrices, row, i):
    """Write what the states contribute to noise of variance 1, given the filter's output."""
    present = following = 0.0  # covariances of a sample with itself and with the next
    for k in range(order):
        for j in range(order):
            present += out[k] * covariance[k, j] * out[j]
            for m in range(order):
                following += out[k] * transition[k, m] * covariance[m, j] * out[j]
    variance = (2.0 * present + following) / 3.0  # (E15)
    for k in range(order):
        matrices[row + k, i] = out[k] / math.sqrt(variance)
