"""Filtered noise: exact samples of a linear filter driven by white noise, times an envelope.

Tags such as (E8) are equations of docs/excitation.md. The kernels work on lane i, whose filter has
its rows from `row` on.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels.jit import borrowing_kernel, kernel
from mm_gym.kernels.random import normals

# Rows of a filter. Its matrices are packed by rows: the transition in full, the Cholesky factors of
# the covariances of a sample interval (SPREAD) and of the stationary distribution (START_SPREAD) as
# lower triangles. OUTPUT: what the states contribute to the noise.
RMS, LOW_PASS, LOW_PASS_DAMPING, HIGH_PASS, HIGH_PASS_DAMPING, RISE, PLATEAU, DECAY = range(8)
STATE, VALUE, TRANSITION, SPREAD, START_SPREAD, OUTPUT = 8, 12, 13, 29, 39, 49
FILTER_ROWS = 53
FILTER = range(LOW_PASS, HIGH_PASS_DAMPING + 1)  # what its matrices follow from

ORDER = 4
"""States of a filter: x, x' / w of the low-pass, then y, y' / w of the high-pass."""

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4; its remainder is below round-off."""


@borrowing_kernel
def _envelope(lanes, row, time, i):
    """Return the envelope (E8) at a time [s] of the episode."""
    rise = lanes[row + RISE, i]
    if time < rise:
        return (time / rise) * (time / rise)
    past = time - rise - lanes[row + PLATEAU, i]
    return math.exp(-lanes[row + DECAY, i] * past) if past > 0.0 else 1.0


@borrowing_kernel
def _order(lanes, row, i):
    """Return the number of states: four with a high-pass, two without."""
    return ORDER if lanes[row + HIGH_PASS, i] > 0.0 else ORDER // 2


@borrowing_kernel
def _write_value(lanes, row, order, time, i):
    """Write the noise at a time [s] of the episode from the filter's state."""
    total = 0.0
    for k in range(order):
        total += lanes[row + OUTPUT + k, i] * lanes[row + STATE + k, i]
    lanes[row + VALUE, i] = lanes[row + RMS, i] * _envelope(lanes, row, time, i) * total


@borrowing_kernel
def _add_normals(lanes, row, spread, order, streams, i):
    """Add normal numbers with a given covariance to the state.

    Parameters
    ----------
    lanes
        (rows, lanes) float64; the state is written.
    row
        First row of the filter.
    spread
        Which Cholesky factor, `SPREAD` or `START_SPREAD`.
    order
        Number of states.
    streams
        (2, lanes) uint64, advanced.
    i
        The lane.
    """
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
    """Draw the filter's state from its stationary distribution."""
    order = _order(lanes, row, i)
    for k in range(ORDER):
        lanes[row + STATE + k, i] = 0.0
    _add_normals(lanes, row, START_SPREAD, order, streams, i)
    _write_value(lanes, row, order, 0.0, i)


@borrowing_kernel
def advance_filter(lanes, row, streams, time, i):
    """Advance the filter by one sample interval, exactly in distribution, to a time [s] (E12)."""
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
    """Write the matrices of a filter over a sample interval, for an output of variance 1.

    The output is linear between its samples, and its variance is the average over time (E15).
    The low-pass (E9) drives, if its frequency is not 0, the high-pass (E11). The covariances follow
    from that of a short time by doubling (E14); after many doublings the covariance is the
    stationary one, the solution of Lyapunov's equation.

    Parameters
    ----------
    lanes
        (rows, lanes) float64; the frequencies [rad/s] and damping ratios are read, the matrices
        written.
    row
        First row of the filter.
    passes_velocity
        Whether the low-pass hands on x + 2 z x' / w (E10), as soil does, instead of x.
    step
        Sample interval [s].
    i
        The lane.
    """
    f, out = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    w, damping = lanes[row + LOW_PASS, i], 2.0 * lanes[row + LOW_PASS_DAMPING, i]
    f[0, 1], f[1, 0], f[1, 1] = w, -w, -damping * w  # (E9)
    out[0], out[1] = 1.0, damping if passes_velocity else 0.0  # (E10)
    high, high_damping = lanes[row + HIGH_PASS, i], 2.0 * lanes[row + HIGH_PASS_DAMPING, i]
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
            lanes[row + TRANSITION + ORDER * k + j, i] = transition[k, j]
    _write_root(covariance, lanes, row + SPREAD, i)
    for _ in range(80):  # 2^80 sample intervals: the first state has decayed for any damping
        transition, covariance = _doubled(transition, covariance)
    _write_root(covariance, lanes, row + START_SPREAD, i)
    present = following = 0.0  # covariances of a sample with itself and with the next
    for k in range(ORDER):
        for j in range(ORDER):
            present += out[k] * covariance[k, j] * out[j]
            for m in range(ORDER):
                reached = lanes[row + TRANSITION + ORDER * k + m, i]
                following += out[k] * reached * covariance[m, j] * out[j]
    variance = (2.0 * present + following) / 3.0  # (E15)
    for k in range(ORDER):
        lanes[row + OUTPUT + k, i] = out[k] / math.sqrt(variance)


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
def _write_root(covariance, lanes, row, i):
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
            lanes[row + k * (k + 1) // 2 + j, i] = root[k, j]
