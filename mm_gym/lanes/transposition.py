"""Rows copied to the columns of a row-major array, transposed in registers.

A compiler left to find the transposition in a loop over lanes takes three times as long.
"""

# ruff: noqa: ANN401 - numba gives types

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from mm_gym.arrays import Single
from mm_gym.compiler.jit import COMPILED, borrowing_kernel
from mm_gym.compiler.llvm_code import get_item_pointer
from mm_gym.lanes.memory import span

if TYPE_CHECKING:
    from collections.abc import Callable


def _exchanged(builder: Any, vectors: list[Any], width: int) -> list[Any]:
    """Return vectors with blocks of `width` numbers exchanged between those `width` apart."""
    count = len(vectors)
    integer = ir.IntType(32)
    orders = [
        ir.Constant(
            ir.VectorType(integer, count),
            [
                p + side * width if p // width % 2 == 0 else count + p - (1 - side) * width
                for p in range(count)
            ],
        )
        for side in (0, 1)
    ]
    exchanged = list(vectors)
    for j in (j for j in range(count) if j // width % 2 == 0):
        pair = vectors[j], vectors[j + width]
        for side in (0, 1):
            exchanged[j + side * width] = builder.shuffle_vector(*pair, orders[side])
    return exchanged


def _transposing(count: int) -> Callable[..., None]:
    """Return what transposes a square of so many rows and lanes, a power of two."""

    def transpose(rows: Single, row: int, i: int, target: Single, column: int) -> None:
        target[i : i + count, column : column + count] = rows[row : row + count, i : i + count].T

    if not COMPILED:
        return transpose

    @intrinsic
    def compiled(_context, rows, row, i, target, column):
        def build(context, builder, signature, arguments):
            rows, row, i, target, column = (
                context.cast(builder, value, kind, types.intp)
                if isinstance(kind, types.Integer)
                else context.make_array(kind)(context, builder, value)
                for value, kind in zip(arguments, signature.args, strict=True)
            )
            source, copy = signature.args[0], signature.args[3]
            vector = ir.VectorType(context.get_value_type(source.dtype), count)

            def address(kind, array, place):
                first = get_item_pointer(context, builder, kind, array, place, wraparound=False)
                return builder.bitcast(first, vector.as_pointer())

            def after(place, k):
                return builder.add(place, ir.Constant(place.type, k))

            square = [
                builder.load(address(source, rows, (after(row, k), i)), align=4)
                for k in range(count)
            ]
            width = 1
            while width < count:
                square, width = _exchanged(builder, square, width), 2 * width
            for k in range(count):
                builder.store(square[k], address(copy, target, (after(i, k), column)), align=4)
            return context.get_dummy_value()

        return types.none(rows, row, i, target, column), build

    return compiled


EIGHT, FOUR = 8, 4
"""Sides of the squares that are transposed at once."""

_transpose_eight, _transpose_four = _transposing(EIGHT), _transposing(FOUR)


@borrowing_kernel
def copy_as_columns(rows, target, first, last):
    """Copy rows to the columns of a row-major target, as many as it has.

    Parameters
    ----------
    rows
        (k, lanes) float32, read.
    target
        (lanes, c) float32, written.
    first, last
        The lanes first .. last - 1.
    """
    width = target.shape[1]
    squared = last - (last - first) % EIGHT if width >= FOUR else first
    for i in range(first, squared, EIGHT):
        if width >= EIGHT:
            _copy_eight_lanes(rows, target, i)
        else:
            _copy_four_lanes(rows, target, i)
            _copy_four_lanes(rows, target, i + FOUR)
    for k in range(width):
        for i in span(squared, last):
            target[i, k] = rows[k, i]


@borrowing_kernel
def _copy_eight_lanes(rows, target, i):
    """Copy the lanes i .. i + 7; columns of two squares are written twice."""
    width = target.shape[1]
    for k in range(0, width - EIGHT, EIGHT):
        _transpose_eight(rows, k, i, target, k)
    _transpose_eight(rows, width - EIGHT, i, target, width - EIGHT)


@borrowing_kernel
def _copy_four_lanes(rows, target, i):
    """Copy the lanes i .. i + 3, of four to seven rows, in the same way."""
    width = target.shape[1]
    _transpose_four(rows, 0, i, target, 0)
    if width > FOUR:
        _transpose_four(rows, width - FOUR, i, target, width - FOUR)
