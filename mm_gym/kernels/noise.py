"""Filtered noise: its filter's exact transition over a sample interval, and its envelope."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.random import normals

# Rows of a filter.
RMS, LOW_PASS, LOW_PASS_DAMPING, HIGH_PASS, HIGH_PASS_DAMPING, RISE, PLATEAU, DECAY = range(8)
STATE, VALUE, TRANSITION, SPREAD, START_SPREAD, OUTPUT = 8, 12, 13, 29, 39, 49
FILTER_ROWS = 53

ORDER = 4
"""States of a filter: x, x' of the low-pass, then of the high-pass, in units of the input."""


SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4: below round-off."""


@borrowing_kernel
def _envelope(lanes, row, time, i):
    """Return the envelope of filtered noise at a time [s] of the episode."""
    rise = lanes[row + RISE, i]
    if time < rise:
        return (time / rise) * (time / rise)
    past = time - rise - lanes[row + PLATEAU, i]
    return math.exp(-lanes[row + DECAY, i] * past) if past > 0.0 else 1.0


@borrowing_kernel
def _order(lanes, row, i):
    """Return the number of states in use."""
    return ORDER if lanes[row + HIGH_PASS, i] > 0.0 else ORDER // 2


@borrowing_kernel
def _write_value(lanes, row, order, time, i):
    """Write the noise at a time [s] from the filter's state."""
    total = 0.0
    for k in range(order):
        total += lanes[row + OUTPUT + k, i] * lanes[row + STATE + k, i]
    lanes[row + VALUE, i] = lanes[row + RMS, i] * _envelope(lanes, row, time, i) * total


@borrowing_kernel
def _add_normals(lanes, row, spread, order, streams, i):
    """Add independent normal numbers times a lower triangle, packed by rows, to the state."""
    for column in range(0, order, 2):
        pair = normals(streams, i)
        for side in range(2):
            j = column + side
            for k in range(j, order):
                lanes[row + STATE + k, i] += (
                    lanes[row + spread + k * (k + 1) // 2 + j, i] * pair[side]
                )


@borrowing_kernel
def start_filter(lanes, row, streams, i):
    """Draw the filter's state from its stationary law."""
    order = _order(lanes, row, i)
    for k in range(ORDER):
        lanes[row + STATE + k, i] = 0.0
    _add_normals(lanes, row, START_SPREAD, order, streams, i)
    _write_value(lanes, row, order, 0.0, i)


@borrowing_kernel
def advance_filter(lanes, row, streams, time, i):
    """Advance the filter by one sample interval, exactly in law, to a time [s]."""
    order = _order(lanes, row, i)
    x = (
        lanes[row + STATE, i],
        lanes[row + STATE + 1, i],
        lanes[row + STATE + 2, i],
        lanes[row + STATE + 3, i],
    )
    for k in range(order):
        own = row + TRANSITION + ORDER * k
        lanes[row + STATE + k, i] = (
            lanes[own, i] * x[0]
            + lanes[own + 1, i] * x[1]
            + lanes[own + 2, i] * x[2]
            + lanes[own + 3, i] * x[3]
        )
    _add_normals(lanes, row, SPREAD, order, streams, i)
    _write_value(lanes, row, order, time, i)


@kernel
def prepare_filter(lanes, row, passes_velocity, step, i):
    """Write transition, spread and output of a filter driven by white noise, output of variance 1.

    Low-pass x'' / w^2 + 2 z x' / w + x = noise, passed on as x, or for soil as x + 2 z x' / w
    (Kanai and Tajimi); then, if its frequency is not 0, the high-pass y'' of
    y'' / w^2 + 2 z y' / w + y = input. The covariances follow by doubling,
    Q(2 h) = Q(h) + F Q(h) F', from a Taylor series at a short h; for ever, it is the solution of
    Lyapunov's equation.
    """
    f, out = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    w, damping = lanes[row + LOW_PASS, i], 2.0 * lanes[row + LOW_PASS_DAMPING, i]
    f[0, 1], f[1, 0], f[1, 1] = w, -w, -damping * w
    out[0], out[1] = 1.0, damping if passes_velocity else 0.0
    high, high_damping = lanes[row + HIGH_PASS, i], 2.0 * lanes[row + HIGH_PASS_DAMPING, i]
    if high > 0.0:
        f[2, 3] = high
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
            lanes[row + TRANSITION + ORDER * k + j, i] = transition[k, j]
    _write_root(covariance, lanes, row + SPREAD, i)
    for _ in range(80):  # until the first state is forgotten, whatever the damping
        transition, covariance = _doubled(transition, covariance)
    _write_root(covariance, lanes, row + START_SPREAD, i)
    variance = 0.0
    for k in range(ORDER):
        for j in range(ORDER):
            variance += out[k] * covariance[k, j] * out[j]
    for k in range(ORDER):
        lanes[row + OUTPUT + k, i] = out[k] / math.sqrt(variance)


@kernel
def _short_step(f, w, step):
    """Return exp(f h) and the covariance of the state after a short h, by their Taylor series."""
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
    """Return transition and covariance over twice the time."""
    spread = _product(_product(transition, covariance), transition.T)
    return _product(transition, transition), covariance + spread


@kernel
def _product(a, b):
    """Return a b; a library's product would round differently from one machine to the next."""
    out = np.zeros((ORDER, ORDER))
    for i in range(ORDER):
        for j in range(ORDER):
            for k in range(ORDER):
                out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def _write_root(covariance, lanes, row, i):
    """Write the Cholesky factor, packed by rows; what round-off leaves of a zero pivot is zero."""
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
            lanes[row + k * (k + 1) // 2 + j, i] = root[k, j]
