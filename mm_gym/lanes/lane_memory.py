"""Memory of the lanes, laid out for the cache."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

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
