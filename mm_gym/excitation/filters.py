"""Matrices of the filters of noise over a sample interval.

Tags such as (E8) are equations of docs/excitation.md.

A filter without high-pass has two states, those of the low-pass, and of each matrix the rows and
columns of these.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.arithmetic import stay_apart
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.listed import set_row
from mm_gym.lanes.simd import LANES, alike, element, everywhere, root, with_element
from mm_gym.lanes.simd_masks import all_hold, larger, where
from mm_gym.lanes.simd_memory import rows_on_stack

ORDER = 4
"""States of a filter: x, x' / w of the low-pass, then y, y' / w of the high-pass, if it has one."""

# Matrices, packed by rows: the transition in full, the Cholesky factors of the covariances of a
# sample interval (SPREAD) and of the stationary distribution (START_SPREAD) as lower triangles.
# OUTPUT: what the states contribute to the noise.
TRANSITION, SPREAD, START_SPREAD, OUTPUT, MATRICES = 0, 16, 26, 36, 40

# Scratch behind them: matrices in full, and what the states contribute before it is scaled.
COVARIANCE, STEP, GROWN, NEXT, TERM, FORM, FILTER, OWN = (
    MATRICES + ORDER * ORDER * k for k in range(8)
)

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4; its remainder is below round-off."""


def filter_matrices(filters: Array, interval: float, *, passes_velocity: bool) -> Array:
    """Return the matrices (`MATRICES`,) of noise over a sample interval [s].

    The filters are (2, 2): frequency [rad/s] and damping ratio of the low-pass and of the
    high-pass.
    """
    matrices = np.zeros((MATRICES, 1))
    lane = np.zeros(1, np.int64)
    write_matrices(matrices, 0, filters.reshape(-1, 1), passes_velocity, interval, lane)
    return matrices[:, 0]


@borrowing_kernel
def write_matrices(matrices, first, filters, passes_velocity, step, which):
    """Write the matrices of filters over a sample interval, for an output of variance 1.

    The output is linear between its samples, and its variance is the average over time (E15).
    The low-pass (E9) drives, if its frequency is not 0, the high-pass (E11).

    Parameters
    ----------
    matrices, first
        (rows, lanes) float64, written from the first row on; without high-pass the numbers of the
        last two states are 0.
    filters
        (4, lanes) float64, read: frequency [rad/s] and damping ratio of the low-pass, then of the
        high-pass.
    passes_velocity
        Whether the low-pass hands on x + 2 z x' / w (E10), as soil does, instead of x.
    """
    k = 0
    while k < which.shape[0]:
        has_high_pass, count = filters[2, which[k]] > 0.0, 1
        while (
            count < LANES
            and k + count < which.shape[0]
            and (filters[2, which[k + count]] > 0.0) == has_high_pass
        ):
            count += 1
        own = which[k : k + count]
        if has_high_pass:  # compiled for each
            _write_group(matrices, first, filters, passes_velocity, step, own, True)
        else:
            for row in range(first, first + MATRICES):  # an episode before may have had a high-pass
                set_row(matrices, row, 0.0, own)
            _write_group(matrices, first, filters, passes_velocity, step, own, False)
        k += count


@inlined_kernel
def _write_group(matrices, first, filters, passes_velocity, step, own, has_high_pass):
    """Write the matrices of up to LANES lanes side by side; `own`, (b,), lists them."""
    w, damping = _gathered(filters, 0, own), 2.0 * _gathered(filters, 1, own)
    high, high_damping = _gathered(filters, 2, own), 2.0 * _gathered(filters, 3, own)
    zero = alike(w, 0.0)
    passed = damping if passes_velocity else zero  # (E10)
    numbers, order = _scratch(), ORDER if has_high_pass else ORDER // 2
    for k in range(ORDER * ORDER):
        numbers[FILTER + k] = zero
    numbers[FILTER + 1], numbers[FILTER + 4], numbers[FILTER + 5] = w, -w, -damping * w  # (E9)
    numbers[FILTER + 11], numbers[FILTER + 12], numbers[FILTER + 13] = high, high, high * passed
    numbers[FILTER + 14], numbers[FILTER + 15] = -high, -high * high_damping  # (E11)
    rate = w * (1.0 + damping) + high * (2.0 + damping + high_damping)
    short, halvings, most = zero, zero, 0
    for k in range(LANES):
        count = _halvings_of(element(rate, k) * step)
        short = with_element(short, k, step * 0.5**count)
        halvings = with_element(halvings, k, float(count))
        most = max(most, count)
    _write_moments(numbers, w, short, halvings, most, order)
    one = alike(w, 1.0)
    numbers[OWN], numbers[OWN + 1], numbers[OWN + 2] = one, passed, -one
    numbers[OWN + 3] = -high_damping
    _write_output(numbers, order)
    for k in range(order):
        for j in range(order):
            _scatter(matrices, first + TRANSITION + ORDER * k + j, own, numbers[ORDER * k + j])
        _scatter(matrices, first + OUTPUT + k, own, numbers[OUTPUT + k])
    for k in range(order * (order + 1) // 2):
        _scatter(matrices, first + SPREAD + k, own, numbers[SPREAD + k])
        _scatter(matrices, first + START_SPREAD + k, own, numbers[START_SPREAD + k])


@borrowing_kernel
def _halvings_of(phase):
    """Return how many times a phase is halved until it is 2^-4 or less."""
    stay_apart()  # or a vector library might take the logarithm's place
    return max(0, math.ceil(math.log2(phase * 16.0)))


_scratch = rows_on_stack(OWN + ORDER)


@inlined_kernel
def _gathered(rows, row, own):
    """Return a row of the lanes listed, the last one repeated up to LANES."""
    count = own.shape[0]
    if own[count - 1] - own[0] == count - 1:
        return read(rows, row, own[0], count)
    numbers = everywhere(rows[row, own[count - 1]])
    for k in range(count - 1):
        numbers = with_element(numbers, k, rows[row, own[k]])
    return numbers


@inlined_kernel
def _scatter(rows, row, own, numbers):
    """Write a row of the lanes listed."""
    count = own.shape[0]
    if own[count - 1] - own[0] == count - 1:
        write(rows, row, own[0], count, numbers)
    else:
        for k in range(count):
            rows[row, own[k]] = element(numbers, k)


@inlined_kernel
def _write_moments(b, w, short, halvings, most, order):
    """Write the filters' transition, and the spreads of an interval and of the stationary state.

    They follow from those of a short time [s] by doubling (E14), in each lane so many times: after
    many doublings the covariance is the stationary one, the solution of Lyapunov's equation.
    """
    _write_short_step(b, w, short, order)
    for n in range(most):
        _double(b, order)
        for k in range(ORDER * order):
            for old, new in ((STEP, NEXT), (COVARIANCE, GROWN)):
                b[old + k] = where(halvings > n, b[new + k], b[old + k])
    for k in range(ORDER * order):
        b[TRANSITION + k] = b[STEP + k]
    _write_root(b, order, SPREAD)
    done = alike(w, 0.0)
    for _ in range(80):  # 2^80 sample intervals: the first state has decayed for any damping
        _double(b, order)
        change = alike(w, 0.0)
        for k in range(ORDER * order):
            b[STEP + k] = b[NEXT + k]
            change = larger(change, abs(b[GROWN + k] - b[COVARIANCE + k]))
        done = where(change > 0.0, done, 1.0)
        for k in range(ORDER * order):  # what is added later is smaller still
            b[COVARIANCE + k] = where(done > 0.0, b[COVARIANCE + k], b[GROWN + k])
        if all_hold(done > 0.0):
            break
    _write_root(b, order, START_SPREAD)


@inlined_kernel
def _write_short_step(b, w, short, order):
    """Write exp(f h) and the state's covariance (E13) after a short h, by their Taylor series."""
    for k in range(ORDER * order):
        unit = alike(w, 1.0 if k % (ORDER + 1) == 0 else 0.0)
        b[STEP + k] = b[TERM + k] = unit
        b[COVARIANCE + k] = b[FORM + k] = w * short if k == ORDER + 1 else alike(w, 0.0)
    for n in range(2, SERIES + 2):
        _multiply(b, FILTER, TERM, NEXT, order, False)
        _multiply(b, FILTER, FORM, GROWN, order, False)
        for row in range(order):
            for column in range(order):
                k, turned = ORDER * row + column, ORDER * column + row
                b[TERM + k] = b[NEXT + k] * (short / (n - 1.0))
                b[FORM + k] = (b[GROWN + k] + b[GROWN + turned]) * (short / n)
                b[STEP + k] = b[STEP + k] + b[TERM + k]
                b[COVARIANCE + k] = b[COVARIANCE + k] + b[FORM + k]


@inlined_kernel
def _double(b, order):
    """Write transition and covariance over twice the time (E14)."""
    _multiply(b, STEP, COVARIANCE, TERM, order, False)
    _multiply(b, TERM, STEP, GROWN, order, True)
    _multiply(b, STEP, STEP, NEXT, order, False)
    for k in range(ORDER * order):
        b[GROWN + k] = b[COVARIANCE + k] + b[GROWN + k]


@inlined_kernel
def _multiply(b, left, right, out, order, is_turned):
    """Write the product of two matrices, or the first times the other's transpose.

    A library's product would round differently on other machines.
    """
    along, across = (1, ORDER) if is_turned else (ORDER, 1)
    for row in range(order):
        for column in range(order):
            first, second = left + ORDER * row, right + across * column
            total = b[first] * b[second]
            for k in range(1, order):
                total = total + b[first + k] * b[second + along * k]
            b[out + ORDER * row + column] = total


@inlined_kernel
def _write_root(numbers, order, row):
    """Write the Cholesky factor, packed by rows; pivots as small as round-off count as zero."""
    for k in range(order):
        below, variance = row + k * (k + 1) // 2, numbers[COVARIANCE + (ORDER + 1) * k]
        for j in range(k + 1):
            rest, right = numbers[COVARIANCE + ORDER * k + j], row + j * (j + 1) // 2
            for m in range(j):
                rest = rest - numbers[below + m] * numbers[right + m]
            if j == k:
                rest = where(rest > 1e-15 * variance, root(rest), 0.0)
            else:
                pivot = numbers[right + j]
                rest = where(pivot > 0.0, rest / pivot, 0.0)
            numbers[below + j] = rest


@inlined_kernel
def _write_output(numbers, order):
    """Write what the states contribute to noise of variance 1, given the filter's output."""
    # Covariances of a sample with itself and with the next.
    present = following = alike(numbers[OWN], 0.0)
    for k in range(order):
        for j in range(order):
            out = numbers[OWN + j]
            present = present + numbers[OWN + k] * numbers[COVARIANCE + ORDER * k + j] * out
            for m in range(order):
                moved = numbers[OWN + k] * numbers[TRANSITION + ORDER * k + m]
                following = following + moved * numbers[COVARIANCE + ORDER * m + j] * out
    variance = (2.0 * present + following) / 3.0  # (E15)
    for k in range(order):
        numbers[OUTPUT + k] = numbers[OWN + k] / root(variance)
