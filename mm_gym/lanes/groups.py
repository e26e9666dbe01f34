"""Groups of lanes, read from their rows as vectors and written back."""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.simd import LANES, element, everywhere, with_element
from mm_gym.lanes.simd_masks import all_hold
from mm_gym.lanes.simd_memory import load, store


@inlined_kernel
def read(lanes, row, i, count):
    """Return a row of the lanes i .. i + count - 1, the last one repeated up to LANES."""
    if count == LANES:
        return load(lanes, row, i)
    numbers = everywhere(lanes[row, i + count - 1])
    for k in range(count - 1):
        numbers = with_element(numbers, k, lanes[row, i + k])
    return numbers


@inlined_kernel
def write(lanes, row, i, count, numbers):
    """Write a row of the lanes i .. i + count - 1."""
    if count == LANES:
        store(lanes, row, i, numbers)
    else:
        for k in range(count):
            lanes[row, i + k] = element(numbers, k)


@inlined_kernel
def write_state(lanes, i, count, x1, x2, v1, v2):
    """Write the state [m, m/s] of those of the lanes i .. i + count - 1 where it is finite.

    Returns
    -------
    int
        Status.
    """
    finite = abs(x1) + abs(x2) + abs(v1) + abs(v2) < np.inf
    if count == LANES and all_hold(finite):
        write_states(lanes, i, x1, x2, v1, v2)
        return layout.OK
    status = layout.OK
    for k in range(count):
        y1, y2, w1, w2 = element(x1, k), element(x2, k), element(v1, k), element(v2, k)
        if abs(y1) + abs(y2) + abs(w1) + abs(w2) < np.inf:
            lanes[layout.X1, i + k], lanes[layout.X2, i + k] = y1, y2
            lanes[layout.V1, i + k], lanes[layout.V2, i + k] = w1, w2
        else:
            status = layout.DIVERGED
    return status


@inlined_kernel
def write_states(lanes, i, x1, x2, v1, v2):
    """Write the state [m, m/s] of LANES lanes."""
    store(lanes, layout.X1, i, x1)
    store(lanes, layout.X2, i, x2)
    store(lanes, layout.V1, i, v1)
    store(lanes, layout.V2, i, v2)
