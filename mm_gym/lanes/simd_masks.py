"""Masks, the results of comparing vectors of lanes: choose by them, and tell where they hold.

All of it takes single numbers and conditions too.
"""

# ruff: noqa: ARG001, PLW0108 - as in `lanes.simd`

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from mm_gym.lanes.simd import LANES, MASK, VECTOR, spread


@intrinsic
def _select(_context, mask, x, y):
    def build(_context, builder, signature, arguments):
        chosen = spread(builder, signature.args[1], arguments[1])
        return builder.select(
            arguments[0], chosen, spread(builder, signature.args[2], arguments[2])
        )

    return VECTOR(mask, x, y), build


def where(condition: bool, x: float, y: float) -> float:  # noqa: FBT001 - as NumPy has it
    """Return x where a condition holds, otherwise y."""
    return np.where(condition, x, y)[()]


@overload(where)
def _where(condition, x, y):
    if condition == MASK:
        return lambda condition, x, y: _select(condition, x, y)
    if all(isinstance(kind, types.Number | types.Boolean) for kind in (x, y)):
        return lambda condition, x, y: x if condition else y
    return None  # `lanes.tangents` has the rest


@intrinsic
def _none(_context, mask):
    def build(_context, builder, _signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(mask), build


def none(condition: bool) -> bool:  # noqa: FBT001 - as above
    """Tell whether a condition holds in no lane."""
    return not np.any(condition)


@overload(none)
def _compiled_none(condition):
    if condition == MASK:
        return lambda condition: _none(condition)
    return lambda condition: not condition


@intrinsic
def _all_hold(_context, mask):
    def build(_context, builder, _signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANES), -1))

    return types.boolean(mask), build


def all_hold(condition: bool) -> bool:  # noqa: FBT001 - as above
    """Tell whether a condition holds in every lane."""
    return bool(np.all(condition))


@overload(all_hold)
def _compiled_all_hold(condition):
    if condition == MASK:
        return lambda condition: _all_hold(condition)
    return lambda condition: condition


def larger(x: float, y: float) -> float:
    """Return the larger of two; the first where one is not a number."""
    return where(y > x, y, x)


@overload(larger)
def _larger(x, y):
    return lambda x, y: where(y > x, y, x)


def smaller(x: float, y: float) -> float:
    """Return the smaller of two; the first where one is not a number."""
    return where(y < x, y, x)


@overload(smaller)
def _smaller(x, y):
    return lambda x, y: where(y < x, y, x)


@intrinsic
def _bits(_context, mask):
    def build(_context, builder, _signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.zext(bits, ir.IntType(64))

    return types.int64(mask), build


def bits(condition: bool) -> int:  # noqa: FBT001 - as above
    """Return an integer of which bit k tells whether a condition holds in lane k."""
    return sum(1 << int(k) for k in np.flatnonzero(condition))


@overload(bits)
def _compiled_bits(condition):
    if condition == MASK:
        return lambda condition: _bits(condition)
    return lambda condition: 1 if condition else 0


@intrinsic
def _lowest(_context, number):
    def build(_context, builder, _signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(number), build


def lowest(number: int) -> int:
    """Return the place of the lowest bit that is set, of a number that is not 0."""
    return (number & -number).bit_length() - 1


@overload(lowest)
def _compiled_lowest(number):
    return lambda number: _lowest(number)


@intrinsic
def _how_many(_context, number):
    def build(_context, builder, _signature, arguments):
        return builder.ctpop(arguments[0])

    return types.int64(number), build


def how_many(number: int) -> int:
    """Return how many bits are set of a number that is not negative."""
    return int(number).bit_count()


@overload(how_many)
def _compiled_how_many(number):
    return lambda number: _how_many(number)
