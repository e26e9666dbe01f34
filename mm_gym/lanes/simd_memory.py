"""Vectors of lanes in memory: loaded from lanes and stored, or kept in rows of a vector each."""

# ruff: noqa: ANN401, ARG001, PLW0108 - as in `lanes.simd`

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

from mm_gym.compiler.jit import COMPILED
from mm_gym.compiler.llvm_code import alloca_once, get_item_pointer, get_or_insert_function
from mm_gym.lanes.simd import LANES, NUMBERS, VECTOR, spread

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


class _Rows(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Rows({LANES})")


ROWS = _Rows()


@register_model(_Rows)
class _RowsModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, NUMBERS.as_pointer())


@intrinsic
def _rows_of(_context, numbers):
    def build(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.bitcast(array.data, NUMBERS.as_pointer())

    return ROWS(numbers), build


def rows_of(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an array, beginning on a cache line, as rows of a vector each.

    It is lent: the array must live as long, and no bounds are checked.
    """
    return numbers.reshape(-1, LANES)


@overload(rows_of)
def _compiled_rows_of(numbers):
    return lambda numbers: _rows_of(numbers)


@intrinsic
def _get(_context, rows, k):
    def build(_context, builder, _signature, arguments):
        return builder.load(builder.gep(arguments[0], [arguments[1]]), align=64)

    return VECTOR(rows, k), build


def _place(builder: Any, rows: Any, k: Any) -> Any:
    """Return the address of the number of a row and a lane."""
    row = builder.gep(rows, [builder.extract_value(k, 0)])
    numbers = builder.bitcast(row, ir.DoubleType().as_pointer())
    return builder.gep(numbers, [builder.extract_value(k, 1)])


@intrinsic
def _get_number(_context, rows, k):
    def build(_context, builder, _signature, arguments):
        return builder.load(_place(builder, *arguments))

    return types.float64(rows, k), build


@overload(operator.getitem)
def _getitem(rows, k):
    if rows == ROWS and isinstance(k, types.BaseTuple):
        return lambda rows, k: _get_number(rows, (np.int64(k[0]), np.int64(k[1])))
    return (lambda rows, k: _get(rows, k)) if rows == ROWS else None


@intrinsic
def _set(_context, rows, k, value):
    def build(context, builder, signature, arguments):
        value = spread(builder, signature.args[2], arguments[2])
        builder.store(value, builder.gep(arguments[0], [arguments[1]]), align=64)
        return context.get_dummy_value()

    return types.none(rows, k, value), build


@intrinsic
def _set_number(_context, rows, k, value):
    def build(context, builder, _signature, arguments):
        builder.store(arguments[2], _place(builder, *arguments[:2]))
        return context.get_dummy_value()

    return types.none(rows, k, value), build


@overload(operator.setitem)
def _setitem(rows, k, value):
    if rows == ROWS and isinstance(k, types.BaseTuple):
        return lambda rows, k, value: _set_number(
            rows, (np.int64(k[0]), np.int64(k[1])), float(value)
        )
    return (lambda rows, k, value: _set(rows, k, value)) if rows == ROWS else None


@intrinsic
def _from_row(_context, rows, k):
    def build(_context, builder, _signature, arguments):
        return builder.gep(arguments[0], [arguments[1]])

    return ROWS(rows, k), build


def from_row(rows: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return the rows from one of them on, lent as they are."""
    return rows[k:]


@overload(from_row)
def _compiled_from_row(rows, k):
    return (lambda rows, k: _from_row(rows, k)) if rows == ROWS else None


@intrinsic
def _load(_context, lanes, row, i):
    def build(context, builder, signature, arguments):
        return builder.load(_pointer(context, builder, signature, arguments), align=8)

    return VECTOR(lanes, row, i), build


@intrinsic
def _store(_context, lanes, row, i, value):
    def build(context, builder, signature, arguments):
        builder.store(arguments[3], _pointer(context, builder, signature, arguments), align=8)
        return context.get_dummy_value()

    return types.none(lanes, row, i, value), build


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the address of LANES lanes of a row."""
    kind = signature.args[0]
    array = context.make_array(kind)(context, builder, arguments[0])
    place = [
        context.cast(builder, value, given, types.intp)
        for value, given in zip(arguments[1:3], signature.args[1:3], strict=True)
    ]
    first = get_item_pointer(context, builder, kind, array, place, wraparound=False)
    return builder.bitcast(first, NUMBERS.as_pointer())


def load(lanes: NDArray[np.float64], row: int, i: int) -> NDArray[np.float64]:
    """Return a row of the lanes i .. i + LANES - 1, which must exist."""
    return lanes[row, i : i + LANES].copy()


@overload(load)
def _compiled_load(lanes, row, i):
    return lambda lanes, row, i: _load(lanes, row, i)


def store(lanes: NDArray[np.float64], row: int, i: int, value: NDArray[np.float64]) -> None:
    """Write a row of the lanes i .. i + LANES - 1, which must exist."""
    lanes[row, i : i + LANES] = value


@overload(store)
def _compiled_store(lanes, row, i, value):
    return lambda lanes, row, i, value: _store(lanes, row, i, value)


def rows_on_stack(count: int) -> Callable[[], NDArray[np.float64]]:
    """Return what a kernel calls for so many rows of a vector each, which live until it returns."""
    if not COMPILED:
        return lambda: np.zeros((count, LANES))

    @intrinsic
    def rows(_context):
        def build(_context, builder, _signature, _arguments):
            return alloca_once(builder, NUMBERS, size=ir.Constant(ir.IntType(64), count))

        return ROWS(), build

    return rows


def lane_copier(count: int) -> Callable[..., None]:
    """Return what copies a lane of `count` rows, (rows, lane), to a lane of others, as given next.

    It does so number by number: the vectors gathered and scattered that a compiler makes of a loop
    take several times as long.
    """
    if not COMPILED:

        def copy(one: Any, k: int, other: Any, slot: int) -> None:
            other[:count, slot] = one[:count, k]

        return copy

    @intrinsic
    def copy_lane(_context, one, k, other, slot):
        def build(context, builder, _signature, arguments):
            double = ir.DoubleType().as_pointer()
            source, target = (
                builder.gep(builder.bitcast(rows, double), [lane])
                for rows, lane in (arguments[:2], arguments[2:])
            )
            for row in range(count):
                apart = [ir.Constant(ir.IntType(64), LANES * row)]
                builder.store(builder.load(builder.gep(source, apart)), builder.gep(target, apart))
            return context.get_dummy_value()

        return types.none(one, types.int64, other, types.int64), build

    return copy_lane


@intrinsic
def _prefetch(_context, lanes, row, i):
    def build(context, builder, signature, arguments):
        byte, integer = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, integer, integer, integer])
        function = get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        place = builder.bitcast(_pointer(context, builder, signature, arguments), byte)
        to_write, keep, data = (ir.Constant(integer, value) for value in (1, 3, 1))
        builder.call(function, [place, to_write, keep, data])
        return context.get_dummy_value()

    return types.none(lanes, row, i), build


def prefetch(lanes: NDArray[np.float64], row: int, i: int) -> None:
    """Fetch a lane's number into the cache, for what comes a little later."""


@overload(prefetch)
def _compiled_prefetch(lanes, row, i):
    return lambda lanes, row, i: _prefetch(lanes, row, i)
