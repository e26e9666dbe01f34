"""Rows of lanes: filled, copied, looped over, allocated on cache lines."""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, kernel


@borrowing_kernel
def fill(rows, row, value, first, last):
    """Set a row's lanes to a value."""
    for i in span(first, last):
        rows[row, i] = value


@borrowing_kernel
def copy_rows(rows, row, target, first, last):
    """Copy rows from the given one on, as many as the target has."""
    for k in range(target.shape[0]):
        for i in span(first, last):
            target[k, i] = rows[row + k, i]


@borrowing_kernel
def copy_row(lanes, source, target, first, last):
    """Copy a row's lanes."""
    for i in span(first, last):
        lanes[target, i] = lanes[source, i]


@kernel
def on_cache_line(size):
    """Return an array of which no vector straddles two cache lines."""
    numbers = np.empty(size + 7)
    start = (-numbers.ctypes.data % 64) // 8
    return numbers[start : start + size]


@kernel
def span(first, last):
    """Return range(first, last) of unsigned integers.

    A signed index might be negative and count from the end: that possibility keeps a loop from
    being vectorised.
    """
    return range(np.uintp(first), np.uintp(last))
