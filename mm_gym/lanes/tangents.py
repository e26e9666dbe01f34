"""Numbers with tangents: a value, and how fast it changes along each of LANES directions.

What kernels do with them they do with the value as with any number, and with all directions at
once: forward-mode differentiation (Griewank and Walther, *Evaluating Derivatives*, 2008, ch. 3).
Choices are made by the value.
"""

# ruff: noqa: ANN401, ARG001, ARG005, PLW0108 - as in `lanes.simd`

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from mm_gym.arrays import Array
from mm_gym.compiler.llvm_code import compiled_as, defines, instruction, value_type
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import cosine_and_sine, exp_of, log_of, power
from mm_gym.lanes.simd import LANES, NUMBERS, VECTOR, alike, everywhere, root
from mm_gym.lanes.simd_masks import where
from mm_gym.lanes.simd_memory import ROWS, from_row

_NUMBER = ir.LiteralStructType([ir.DoubleType(), NUMBERS])
TANGENT = value_type(f"Tangent({LANES})", _NUMBER)
TANGENTS = value_type(f"Tangents({LANES})", NUMBERS.as_pointer())


def _has_tangents(*kinds: types.Type) -> bool:
    return TANGENT in kinds


def _built(builder: Any, value: Any, slopes: Any) -> Any:
    """Return a number with tangents of its value and its slopes."""
    whole = builder.insert_value(ir.Constant(_NUMBER, ir.Undefined), value, 0)
    return builder.insert_value(whole, slopes, 1)


_tangent = instruction(
    2, TANGENT, lambda _context, builder, _kinds, value, slopes: _built(builder, value, slopes)
)


def tangent(value: float, slopes: Array) -> Any:
    """Return a number with its slopes along all directions."""
    raise NotImplementedError  # compiled code only: Python differentiates by what it calls


defines(tangent, lambda *_: True)(lambda value, slopes: _tangent(float(value), slopes))


@compiled_as(
    types.float64, lambda _context, builder, _kinds, x: builder.extract_value(x, 0), _has_tangents
)
def value_of(x: Any) -> float:
    """Return the value of a number with or without tangents."""
    return x


defines(value_of, lambda x: x != TANGENT)(lambda x: float(x))


@compiled_as(
    VECTOR, lambda _context, builder, _kinds, x: builder.extract_value(x, 1), _has_tangents
)
def slopes_of(x: Any) -> Array:
    """Return the slopes of a number, 0 of one without tangents."""
    return np.zeros(LANES)


defines(slopes_of, lambda x: x != TANGENT)(lambda x: everywhere(0.0))


def _define(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a decorator of what a function does with numbers of which one has tangents."""
    return defines(function, _has_tangents)


def _plus(slopes: Any, x: Any, weight: float) -> Any:
    """Return slopes, or None, plus those of a number times a weight."""
    raise NotImplementedError


defines(_plus, lambda _, x, __: x != TANGENT)(lambda slopes, x, weight: slopes)


@defines(_plus, lambda slopes, x, _: x == TANGENT and slopes == types.none)
def _first(slopes, x, weight):
    return slopes_of(x) * weight


@defines(_plus, lambda slopes, x, _: x == TANGENT and slopes != types.none)
def _next(slopes, x, weight):
    return fma(slopes_of(x), weight, slopes)


def _own(x: Any) -> Any:
    """Return a number's slopes, or None."""
    raise NotImplementedError


defines(_own, _has_tangents)(lambda x: slopes_of(x))
defines(_own, lambda x: x != TANGENT)(lambda x: None)


_define(operator.add)(lambda x, y: tangent(value_of(x) + value_of(y), _plus(_own(x), y, 1.0)))
_define(operator.sub)(lambda x, y: tangent(value_of(x) - value_of(y), _plus(_own(x), y, -1.0)))
_define(operator.neg)(lambda x: tangent(-value_of(x), -slopes_of(x)))
_define(operator.lt)(lambda x, y: value_of(x) < value_of(y))
_define(operator.le)(lambda x, y: value_of(x) <= value_of(y))
_define(operator.gt)(lambda x, y: value_of(x) > value_of(y))
_define(operator.ge)(lambda x, y: value_of(x) >= value_of(y))
_define(operator.eq)(lambda x, y: value_of(x) == value_of(y))
_define(abs)(lambda x: -x if value_of(x) < 0.0 else x)


@_define(operator.mul)
def _product(x, y):
    slopes = _plus(_plus(None, y, value_of(x)), x, value_of(y))
    return tangent(value_of(x) * value_of(y), slopes)


@_define(operator.truediv)
def _quotient(x, y):
    quotient, by = value_of(x) / value_of(y), 1.0 / value_of(y)
    return tangent(quotient, _plus(_own(x), y, -quotient) * by)


@_define(fma)
def _fused(x, y, z):
    slopes = _plus(_plus(_own(z), y, value_of(x)), x, value_of(y))
    return tangent(fma(value_of(x), value_of(y), value_of(z)), slopes)


@_define(where)
def _chosen(condition, x, y):
    slopes = slopes_of(x) if condition else slopes_of(y)
    return tangent(value_of(x) if condition else value_of(y), slopes)


@defines(alike, lambda x, _: x == TANGENT)
def _constant(x, value):
    return tangent(value, everywhere(0.0))


@_define(math.cos)
def _cosine(x):
    cosine, sine = cosine_and_sine(value_of(x))
    return tangent(cosine, slopes_of(x) * -sine)


@_define(math.sin)
def _sine(x):
    cosine, sine = cosine_and_sine(value_of(x))
    return tangent(sine, slopes_of(x) * cosine)


@_define(root)
def _root(x):
    value = root(value_of(x))
    return tangent(value, slopes_of(x) * (0.5 / value))


@_define(exp_of)
def _exponential(x):
    value = exp_of(value_of(x))
    return tangent(value, slopes_of(x) * value)


@_define(power)
def _power(x, exponent):
    base, n = value_of(x), value_of(exponent)
    value = power(base, n)
    slopes = slopes_of(x) * (n * power(base, n - 1.0))
    return tangent(value, fma(slopes_of(exponent), value * log_of(base), slopes))


def _lent(_context: Any, _builder: Any, _kinds: Any, rows: Any) -> Any:
    return rows


@compiled_as(TANGENTS, _lent, lambda rows: rows == ROWS)
def tangents_of(rows: Array) -> Any:
    """Return rows of vectors as half as many numbers with tangents, lent as they are.

    The value of number k is the first of row 2 k, its slopes are in row 2 k + 1. The index k, j
    is that of its slope along direction j alone.
    """
    raise NotImplementedError


@compiled_as(ROWS, _lent, lambda rows: rows == TANGENTS)
def vectors_of(rows: Any) -> Array:
    """Return numbers with tangents as the rows of vectors that they are kept in."""
    raise NotImplementedError


def _place(builder: Any, rows: Any, k: Any, part: int) -> Any:
    """Return the address of the row of a number's value, or of its slopes."""
    row = builder.add(builder.shl(k, ir.Constant(k.type, 1)), ir.Constant(k.type, part))
    return builder.gep(rows, [row])


def _built_get(_context: Any, builder: Any, _kinds: Any, rows: Any, k: Any) -> Any:
    first = builder.bitcast(_place(builder, rows, k, 0), ir.DoubleType().as_pointer())
    return _built(builder, builder.load(first), builder.load(_place(builder, rows, k, 1), align=64))


def _built_set(_context: Any, builder: Any, _kinds: Any, rows: Any, k: Any, x: Any) -> None:
    first = builder.bitcast(_place(builder, rows, k, 0), ir.DoubleType().as_pointer())
    builder.store(builder.extract_value(x, 0), first)
    builder.store(builder.extract_value(x, 1), _place(builder, rows, k, 1), align=64)


_get = instruction(2, TANGENT, _built_get)
_set = instruction(3, types.none, _built_set)
_from = instruction(
    2, TANGENTS, lambda _context, builder, _kinds, rows, k: _place(builder, rows, k, 0)
)


def _is_number(rows: types.Type, k: types.Type, *_: types.Type) -> bool:
    return rows == TANGENTS and not isinstance(k, types.BaseTuple)


def _is_slope(rows: types.Type, k: types.Type, *_: types.Type) -> bool:
    return rows == TANGENTS and isinstance(k, types.BaseTuple)


defines(operator.getitem, _is_number)(lambda rows, k: _get(rows, np.int64(k)))
defines(operator.getitem, _is_slope)(lambda rows, k: vectors_of(rows)[2 * k[0] + 1, k[1]])
defines(from_row, _is_number)(lambda rows, k: _from(rows, np.int64(k)))


@defines(operator.setitem, _is_number)
def _number_set(rows, k, x):
    _set(rows, np.int64(k), tangent(value_of(x), slopes_of(x)))


@defines(operator.setitem, _is_slope)
def _slope_set(rows, k, x):
    vectors_of(rows)[2 * k[0] + 1, k[1]] = x
