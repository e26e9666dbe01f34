"""Rows of lanes: filled, copied, looped over, allocated on cache lines."""

from __future__ import annotations

import numpy as np

from mm_gym.kernels.jit import borrowing_kernel, kernel


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
def copy_as_columns(rows, target, first, last):
    """Copy rows to the columns of a row-major target, as many as it has.

    Four at a time, because then the compiler transposes in registers.
    """
    width = target.shape[1]
    in_fours = width - width % 4
    for k in range(0, in_fours, 4):
        a, b, c, d = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        for i in span(first, last):
            target[i, k], target[i, k + 1] = a[i], b[i]
            target[i, k + 2], target[i, k + 3] = c[i], d[i]
    for k in range(in_fours, width):
        for i in span(first, last):
            target[i, k] = rows[k, i]


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
