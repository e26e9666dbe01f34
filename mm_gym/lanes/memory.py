"""Rows of lanes: filled, copied, looped over, allocated on cache lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

Number = TypeVar("Number", bound=np.generic)

CACHE_LINE = 64
"""Bytes. Rows begin on a cache line, so that no vector of lanes straddles two."""

PAGE = 512
"""Numbers of eight bytes after which addresses collide in the first-level cache."""


def rows_of(rows: int, count: int, dtype: type[Number]) -> NDArray[Number]:
    """Return zeroed rows of at least `count` columns, the first one beginning on a cache line.

    Long rows are padded to an odd number of half pages and a bit: if they were a multiple of a page
    apart, the entries of a lane in all rows would compete for the same few places of the
    first-level cache.
    """
    length = count if count < PAGE else count + (PAGE // 2 + 40 - count) % PAGE
    size = rows * length * np.dtype(dtype).itemsize
    buffer = np.zeros(size + CACHE_LINE, np.uint8)
    start = -buffer.ctypes.data % CACHE_LINE
    return buffer[start : start + size].view(dtype).reshape(rows, length)


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
