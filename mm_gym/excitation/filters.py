"""Matrices of the filters of noise over a sample interval.

Tags such as (E8) are equations of docs/excitation.md.

Matrices of four states are four blocks of two by two, each packed by rows: those of the low-pass,
of the high-pass on it, of it on the high-pass, and of the high-pass. A filter without high-pass has
the first block alone. They are tuples, because an array for each product would take longer than
the arithmetic.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.arithmetic import stay_apart
from mm_gym.lanes.groups import read, write
from mm_gym.lanes.simd import LANES, alike, element, everywhere, root, with_element
from mm_gym.lanes.simd_masks import all_hold, where
from mm_gym.lanes.simd_memory import rows_on_stack

if TYPE_CHECKING:
    from numpy.typing import NDArray

ORDER = 4
"""States of a filter: x, x' / w of the low-pass, then y, y' / w of the high-pass, if it has one."""

# Matrices, packed by rows: the transition in full, the Cholesky factors of the covariances of a
# sample interval (SPREAD) and of the stationary distribution (START_SPREAD) as lower triangles.
# OUTPUT: what the states contribute to the noise.
TRANSITION, SPREAD, START_SPREAD, OUTPUT, MATRICES = 0, 16, 26, 36, 40

COVARIANCE, OWN = MATRICES, MATRICES + ORDER * ORDER
"""Scratch behind them: a covariance in full, and what the states contribute before it is scaled."""

SERIES = 14
"""Terms of the filter's Taylor series over a phase of 2^-4; its remainder is below round-off."""


def filter_matrices(
    filters: NDArray[np.float64], interval: float, *, passes_velocity: bool
) -> NDArray[np.float64]:
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
        (rows, lanes) float64, written from the first row on; without high-pass only the numbers of
        the first two states.
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
            _write_group(matrices, first, filters, passes_velocity, step, own, False)
        k += count


@inlined_kernel
def _write_group(matrices, first, filters, passes_velocity, step, own, has_high_pass):
    """Write the matrices of up to LANES lanes side by side; `own`, (b,), lists them."""
    w, damping = _gathered(filters, 0, own), 2.0 * _gathered(filters, 1, own)
    high, high_damping = _gathered(filters, 2, own), 2.0 * _gathered(filters, 3, own)
    zero = alike(w, 0.0)
    passed = damping if passes_velocity else zero  # (E10)
    f = (
        (zero, w, -w, -damping * w),  # (E9)
        (zero, zero, zero, zero),
        (zero, zero, high, high * passed),
        (zero, high, -high, -high * high_damping),  # (E11)
    )
    rate = w * (1.0 + damping) + high * (2.0 + damping + high_damping)
    short, halvings, most = zero, zero, 0
    for k in range(LANES):
        count = _halvings_of(element(rate, k) * step)
        short = with_element(short, k, step * 0.5**count)
        halvings = with_element(halvings, k, float(count))
        most = max(most, count)
    reached, added, stationary = _moments(f, w, short, halvings, most, has_high_pass)
    numbers, order = _scratch(), ORDER if has_high_pass else ORDER // 2
    _unpack(reached, numbers, TRANSITION)
    _unpack(added, numbers, COVARIANCE)
    _write_root(numbers, order, SPREAD)
    _unpack(stationary, numbers, COVARIANCE)
    _write_root(numbers, order, START_SPREAD)
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
def _moments(f, w, short, halvings, most, has_high_pass):
    """Return the filters' transition and covariances, over a sample interval and stationary.

    They follow from those of a short time [s] by doubling (E14), in each lane so many times: after
    many doublings the covariance is the stationary one, the solution of Lyapunov's equation.
    """
    transition, covariance = _short_step(f, w, short, has_high_pass)
    for n in range(most):
        further, grown = _doubled(transition, covariance, has_high_pass)
        transition = _chosen(halvings > n, further, transition)
        covariance = _chosen(halvings > n, grown, covariance)
    reached, added, done = transition, covariance, alike(w, 0.0)
    for _ in range(80):  # 2^80 sample intervals: the first state has decayed for any damping
        transition, grown = _doubled(transition, covariance, has_high_pass)
        # What is added later is smaller still.
        done = where(_are_same(grown, covariance, has_high_pass), 1.0, done)
        covariance = _chosen(done > 0.0, covariance, grown)
        if all_hold(done > 0.0):
            break
    return reached, added, covariance


@inlined_kernel
def _short_step(f, w, step, has_high_pass):
    """Return exp(f h) and the state's covariance (E13) after a short h, by their Taylor series."""
    zero, one = alike(w, 0.0), alike(w, 1.0)
    none, unit = (zero, zero, zero, zero), (one, zero, zero, one)
    transition = term = (unit, none, none, unit)
    covariance = form = ((zero, zero, zero, w * step), none, none, none)
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
    zero = alike(a[0][0], 0.0)
    none = zero, zero, zero, zero
    low = _add_product(none, a[0], b[0])
    if not has_high_pass:
        return low, none, none, none
    return (
        _add_product(low, a[1], b[2]),
        _add_product(_add_product(none, a[0], b[1]), a[1], b[3]),
        _add_product(_add_product(none, a[2], b[0]), a[3], b[2]),
        _add_product(_add_product(none, a[2], b[1]), a[3], b[3]),
    )


@inlined_kernel
def _chosen(condition, a, b):
    """Return a in lanes where a condition holds, otherwise b."""
    return (
        _chosen_block(condition, a[0], b[0]),
        _chosen_block(condition, a[1], b[1]),
        _chosen_block(condition, a[2], b[2]),
        _chosen_block(condition, a[3], b[3]),
    )


@inlined_kernel
def _chosen_block(condition, a, b):
    """Do so with blocks."""
    return (
        where(condition, a[0], b[0]),
        where(condition, a[1], b[1]),
        where(condition, a[2], b[2]),
        where(condition, a[3], b[3]),
    )


@inlined_kernel
def _are_same(a, b, has_high_pass):
    """Tell in which lanes all entries of a and b are equal."""
    low = _are_same_blocks(a[0], b[0])
    if not has_high_pass:
        return low
    others = _are_same_blocks(a[1], b[1]) & _are_same_blocks(a[2], b[2])
    return low & others & _are_same_blocks(a[3], b[3])


@inlined_kernel
def _are_same_blocks(a, b):
    """Do so with blocks."""
    return (a[0] == b[0]) & (a[1] == b[1]) & (a[2] == b[2]) & (a[3] == b[3])


@inlined_kernel
def _add_product(total, a, b):
    """Return total + a b of blocks."""
    return (
        total[0] + a[0] * b[0] + a[1] * b[2],
        total[1] + a[0] * b[1] + a[1] * b[3],
        total[2] + a[2] * b[0] + a[3] * b[2],
        total[3] + a[2] * b[1] + a[3] * b[3],
    )


@inlined_kernel
def _sum(a, b):
    """Return a + b."""
    return _plus(a[0], b[0]), _plus(a[1], b[1]), _plus(a[2], b[2]), _plus(a[3], b[3])


@inlined_kernel
def _plus(a, b):
    """Return a + b of blocks."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@inlined_kernel
def _scaled(a, factor):
    """Return a times a number."""
    return _times(a[0], factor), _times(a[1], factor), _times(a[2], factor), _times(a[3], factor)


@inlined_kernel
def _times(a, factor):
    """Return a block times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor, a[3] * factor


@inlined_kernel
def _transposed(a):
    """Return the transpose of a."""
    return _turned(a[0]), _turned(a[2]), _turned(a[1]), _turned(a[3])


@inlined_kernel
def _turned(a):
    """Return the transpose of a block."""
    return a[0], a[2], a[1], a[3]


@inlined_kernel
def _unpack(a, numbers, first):
    """Write the blocks of a as rows of 4 by 4 numbers from the first on."""
    for k in range(2):
        _unpack_row(a[0], a[1], k, numbers, first + ORDER * k)
        _unpack_row(a[2], a[3], k, numbers, first + ORDER * (k + 2))


@inlined_kernel
def _unpack_row(left, right, k, numbers, first):
    """Write row k of two blocks side by side."""
    numbers[first], numbers[first + 1] = left[2 * k], left[2 * k + 1]
    numbers[first + 2], numbers[first + 3] = right[2 * k], right[2 * k + 1]


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
