"""Numba's helpers for intrinsics, which its guide to extensions imports from a private module."""

from numba.core.cgutils import (
    alloca_once,
    get_item_pointer,
    get_or_insert_function,
    intp_t,
    unpack_tuple,
)
from numba.core.imputils import lower_constant

__all__ = [
    "alloca_once",
    "get_item_pointer",
    "get_or_insert_function",
    "intp_t",
    "lower_constant",
    "unpack_tuple",
]
