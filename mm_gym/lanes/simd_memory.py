"""Vectors of lanes in memory: loaded from lanes and stored, or kept in rows of a vector each."""

# ruff: noqa: ANN401 - as in `lanes.simd`

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from mm_gym.arrays import Array
from mm_gym.compiler.jit import COMPILED
from mm_gym.compiler.llvm_code import (
    alloca_once,
    compiled_as,
    defines,
    get_item_pointer,
    get_or_insert_function,
    instruction,
    value_type,
)
from mm_gym.lanes.simd import LANES, NUMBERS, VECTOR, spread

ROWS = value_type(f"Rows({LANES})", NUMBERS.as_pointer())


def _data(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    array = context.make_array(kinds[0])(context, builder, numbers)
    return builder.bitcast(array.data, NUMBERS.as_pointer())


@compiled_as(ROWS, _data)
def rows_of(numbers: Array) -> Array:
    """Return an array, beginning on a cache line, as rows of a vector each.

    It is lent: the array must live as long, and no bounds are checked.
    """
    return numbers.reshape(-1, LANES)


def _place(builder: Any, rows: Any, k: Any) -> Any:
    """Return the address of the number of a row and a lane."""
    row = builder.gep(rows, [builder.extract_value(k, 0)])
    numbers = builder.bitcast(row, ir.DoubleType().as_pointer())
    return builder.gep(numbers, [builder.extract_value(k, 1)])


_get_number = instruction(
    2,
    types.float64,
    lambda _context, builder, _kinds, rows, k: builder.load(_place(builder, rows, k)),
)
_set_number = instruction(
    3,
    types.none,
    lambda _context, builder, _kinds, rows, k, value: builder.store(
        value, _place(builder, rows, k)
    ),
)


def _is_row(rows: types.Type, k: types.Type, *_: types.Type) -> bool:
    return rows == ROWS and not isinstance(k, types.BaseTuple)


def _is_number(rows: types.Type, k: types.Type, *_: types.Type) -> bool:
    return rows == ROWS and isinstance(k, types.BaseTuple)


compiled_as(
    VECTOR,
    lambda _context, builder, _kinds, rows, k: builder.load(builder.gep(rows, [k]), align=64),
    _is_row,
)(operator.getitem)
compiled_as(
    types.none,
    lambda _context, builder, kinds, rows, k, value: builder.store(
        spread(builder, kinds[2], value), builder.gep(rows, [k]), align=64
    ),
    _is_row,
)(operator.setitem)


@defines(operator.getitem, _is_number)
def _number(rows, k):
    return _get_number(rows, (np.int64(k[0]), np.int64(k[1])))


@defines(operator.setitem, _is_number)
def _number_set(rows, k, value):
    _set_number(rows, (np.int64(k[0]), np.int64(k[1])), float(value))


@compiled_as(
    ROWS,
    lambda _context, builder, _kinds, rows, k: builder.gep(rows, [k]),
    lambda rows, _: rows == ROWS,
)
def from_row(rows: Array, k: int) -> Array:
    """Return the rows from one of them on, lent as they are."""
    return rows[k:]


def _pointer(context: Any, builder: Any, kinds: Any, lanes: Any, *place: Any) -> Any:
    """Return the address of LANES lanes of a row."""
    array = context.make_array(kinds[0])(context, builder, lanes)
    row_and_lane = [
        context.cast(builder, value, kind, types.intp)
        for value, kind in zip(place, kinds[1:3], strict=True)
    ]
    first = get_item_pointer(context, builder, kinds[0], array, row_and_lane, wraparound=False)
    return builder.bitcast(first, NUMBERS.as_pointer())


@compiled_as(
    VECTOR,
    lambda context, builder, kinds, *place: builder.load(
        _pointer(context, builder, kinds, *place), align=8
    ),
)
def load(lanes: Array, row: int, i: int) -> Array:
    """Return a row of the lanes i .. i + LANES - 1, which must exist."""
    return lanes[row, i : i + LANES].copy()


@compiled_as(
    types.none,
    lambda context, builder, kinds, lanes, row, i, value: builder.store(
        value, _pointer(context, builder, kinds, lanes, row, i), align=8
    ),
)
def store(lanes: Array, row: int, i: int, value: Array) -> None:
    """Write a row of the lanes i .. i + LANES - 1, which must exist."""
    lanes[row, i : i + LANES] = value


def rows_on_stack(count: int) -> Callable[[], Array]:
    """Return what a kernel calls for so many rows of a vector each, which live until it returns."""
    if not COMPILED:
        return lambda: np.zeros((count, LANES))

    def build(_context, builder, _kinds):
        return alloca_once(builder, NUMBERS, size=ir.Constant(ir.IntType(64), count))

    return instruction(0, ROWS, build)


def lane_copier(count: int) -> Callable[..., None]:
    """Return what copies a lane of `count` rows, (rows, lane), to a lane of others, as given next.

    It does so number by number: the vectors gathered and scattered that a compiler makes of a loop
    take several times as long.
    """
    if not COMPILED:

        def copy(one: Any, k: int, other: Any, slot: int) -> None:
            other[:count, slot] = one[:count, k]

        return copy

    def build(_context: Any, builder: Any, _kinds: Any, *places: Any) -> None:
        double = ir.DoubleType().as_pointer()
        source, target = (
            builder.gep(builder.bitcast(rows, double), [lane])
            for rows, lane in (places[:2], places[2:])
        )
        for row in range(count):
            apart = [ir.Constant(ir.IntType(64), LANES * row)]
            builder.store(builder.load(builder.gep(source, apart)), builder.gep(target, apart))

    return instruction(4, types.none, build)


def _prefetched(context: Any, builder: Any, kinds: Any, *place: Any) -> None:
    byte, integer = ir.IntType(8).as_pointer(), ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [byte, integer, integer, integer])
    function = get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
    address = builder.bitcast(_pointer(context, builder, kinds, *place), byte)
    to_write, keep, data = (ir.Constant(integer, value) for value in (1, 3, 1))
    builder.call(function, [address, to_write, keep, data])


@compiled_as(types.none, _prefetched)
def prefetch(lanes: Array, row: int, i: int) -> None:
    """Fetch a lane's number into the cache, for what comes a little later."""
