"""Masks, the results of comparing vectors of lanes: choose by them, and tell where they hold.

All of it takes single numbers and conditions too.
"""

# ruff: noqa: FBT001 - conditions come first, as NumPy has it

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types

from mm_gym.compiler.llvm_code import compiled_as, defines
from mm_gym.lanes.simd import LANES, MASK, VECTOR, spread

_BITS = ir.IntType(LANES)


def _is_mask(condition: types.Type, *_: types.Type) -> bool:
    return condition == MASK


def _is_one(condition: types.Type) -> bool:
    return condition != MASK


@compiled_as(
    VECTOR,
    lambda _context, builder, kinds, mask, x, y: builder.select(
        mask, spread(builder, kinds[1], x), spread(builder, kinds[2], y)
    ),
    _is_mask,
)
def where(condition: bool, x: float, y: float) -> float:
    """Return x where a condition holds, otherwise y."""
    return np.where(condition, x, y)[()]


@defines(
    where,  # `lanes.tangents` has the rest
    lambda condition, *kinds: (
        condition != MASK and all(isinstance(kind, types.Number | types.Boolean) for kind in kinds)
    ),
)
def _where(condition, x, y):
    return x if condition else y


def _compared(value):
    """Return what compares the bits of a mask with a constant."""

    def build(_context, builder, _kinds, mask):
        bits = builder.bitcast(mask, _BITS)
        return builder.icmp_unsigned("==", bits, ir.Constant(_BITS, value))

    return build


@compiled_as(types.boolean, _compared(0), _is_mask)
def none(condition: bool) -> bool:
    """Tell whether a condition holds in no lane."""
    return not np.any(condition)


defines(none, _is_one)(lambda condition: not condition)


@compiled_as(types.boolean, _compared(-1), _is_mask)
def all_hold(condition: bool) -> bool:
    """Tell whether a condition holds in every lane."""
    return bool(np.all(condition))


defines(all_hold, _is_one)(lambda condition: condition)


def larger(x: float, y: float) -> float:
    """Return the larger of two; the first where one is not a number."""
    return where(y > x, y, x)


def smaller(x: float, y: float) -> float:
    """Return the smaller of two; the first where one is not a number."""
    return where(y < x, y, x)


for _function in (larger, smaller):
    defines(_function, lambda *_: True)(_function)


@compiled_as(
    types.int64,
    lambda _context, builder, _kinds, mask: builder.zext(
        builder.bitcast(mask, _BITS), ir.IntType(64)
    ),
    _is_mask,
)
def bits(condition: bool) -> int:
    """Return an integer of which bit k tells whether a condition holds in lane k."""
    return sum(1 << int(k) for k in np.flatnonzero(condition))


defines(bits, _is_one)(lambda condition: 1 if condition else 0)


@compiled_as(
    types.int64,
    lambda _context, builder, _kinds, number: builder.cttz(number, ir.Constant(ir.IntType(1), 0)),
)
def lowest(number: int) -> int:
    """Return the place of the lowest bit that is set, of a number that is not 0."""
    return (number & -number).bit_length() - 1


@compiled_as(types.int64, lambda _context, builder, _kinds, number: builder.ctpop(number))
def how_many(number: int) -> int:
    """Return how many bits are set of a number that is not negative."""
    return int(number).bit_count()
