"""Do vectors of lanes give the same results as numbers, compiled and in Python?"""

from __future__ import annotations

import numpy as np
import pytest

from mm_gym.compiler.jit import kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, alike, read_bits, root, write_bits
from mm_gym.lanes.simd_masks import bits, larger, lowest, none, smaller, where
from mm_gym.lanes.simd_memory import rows_of


@kernel
def operations(c):
    """Write the results of all operations on the first two rows to the others."""
    x, y = c[0], c[1]
    c[2], c[3], c[4], c[5], c[6] = x + y, x - y, x * y, x / y, -x
    c[7], c[8], c[9] = abs(x), larger(x, y), smaller(x, y)
    c[10], c[11] = where(x < y, x, 1.0), where((x >= y) & (y > 0.0), 2.0, y)
    c[12], c[13] = where(x == y, 3.0, 4.0), where(x <= y, x, y)
    c[14], c[15] = read_bits(x), write_bits(read_bits(abs(x)))
    c[16], c[17] = alike(x, 5.0), fma(x, y, 2.0) - fma(2.0, x, y)
    c[18], c[19] = root(abs(x)), alike(x, 1.0 if none(x == 7.0) else 0.0)


@kernel
def operations_in_rows(numbers):
    """Do the same for all lanes at once."""
    operations(rows_of(numbers))


ROWS = 20


@pytest.mark.parametrize("special", [0.0, -0.0, np.inf, np.nan, 1e-310])
def test_vectors_give_the_same_results_as_numbers(special: float) -> None:
    rng = np.random.default_rng(0)
    numbers = on_cache_line(ROWS * LANES)
    start = numbers.reshape(ROWS, LANES)
    start[:2] = rng.choice([-1.0, 1.0], (2, LANES)) * 10.0 ** rng.uniform(-9, 9, (2, LANES))
    start[0, 1], start[1, 2], start[0, 3] = special, special, start[1, 3]
    lanes = [np.ascontiguousarray(column) for column in start.T]
    with np.errstate(all="ignore"):
        operations_in_rows(numbers)
        for lane in lanes:
            operations(lane)
    assert np.array_equal(start, np.stack(lanes, axis=1), equal_nan=True)


@kernel
def lanes_above(numbers, level):
    """Return the bits of the lanes whose first number is above a level."""
    return bits(rows_of(numbers)[0] > level)


@pytest.mark.parametrize("lane", [0, 1, LANES // 2, LANES - 1])
def test_bits_tell_the_lanes(lane: int) -> None:
    numbers = on_cache_line(LANES)
    numbers[:] = np.arange(LANES)
    above = lanes_above(numbers, lane - 0.5)
    assert above == 2**LANES - 2**lane
    assert lowest(above) == lane
    assert lanes_above(numbers, LANES) == 0


def test_none_sees_a_single_lane() -> None:
    numbers = on_cache_line(ROWS * LANES)
    numbers[:] = 1.0
    operations_in_rows(numbers)
    assert numbers[-1] == 1.0
    numbers[LANES - 1] = 7.0
    operations_in_rows(numbers)
    assert numbers[-1] == 0.0
