"""Numbers with tangents: a value, and how fast it changes along each of LANES directions.

What kernels do with them they do with the value as with any number, and with all directions at
once: forward-mode differentiation (Griewank and Walther, *Evaluating Derivatives*, 2008, ch. 3).
Choices are made by the value.
"""

# ruff: noqa: ANN401, ARG001, ARG005, PLW0108 - as in `lanes.simd`

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import cosine_and_sine, exp_of, log_of, power
from mm_gym.lanes.simd import LANES, NUMBERS, VECTOR, alike, everywhere, root
from mm_gym.lanes.simd_masks import where
from mm_gym.lanes.simd_memory import ROWS, from_row

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


class _Tangent(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Tangent({LANES})")


class _Tangents(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Tangents({LANES})")


TANGENT, TANGENTS = _Tangent(), _Tangents()


@register_model(_Tangent)
class _TangentModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, ir.LiteralStructType([ir.DoubleType(), NUMBERS]))


@register_model(_Tangents)
class _TangentsModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, NUMBERS.as_pointer())


@intrinsic
def _tangent(_context, value, slopes):
    def build(context, builder, _signature, arguments):
        kind = context.get_value_type(TANGENT)
        whole = builder.insert_value(ir.Constant(kind, ir.Undefined), arguments[0], 0)
        return builder.insert_value(whole, arguments[1], 1)

    return TANGENT(value, slopes), build


@intrinsic
def _value(_context, x):
    return types.float64(x), lambda _c, builder, _s, arguments: builder.extract_value(
        arguments[0], 0
    )


@intrinsic
def _slopes(_context, x):
    return VECTOR(x), lambda _c, builder, _s, arguments: builder.extract_value(arguments[0], 1)


def tangent(value: float, slopes: NDArray[np.float64]) -> Any:
    """Return a number with its slopes along all directions."""
    raise NotImplementedError  # compiled code only: Python differentiates by what it calls


@overload(tangent)
def _compiled_tangent(value, slopes):
    return lambda value, slopes: _tangent(float(value), slopes)


def value_of(x: Any) -> float:
    """Return the value of a number with or without tangents."""
    return x


@overload(value_of)
def _compiled_value(x):
    return (lambda x: _value(x)) if x == TANGENT else (lambda x: float(x))


def slopes_of(x: Any) -> NDArray[np.float64]:
    """Return the slopes of a number, 0 of one without tangents."""
    return np.zeros(LANES)


@overload(slopes_of)
def _compiled_slopes(x):
    return (lambda x: _slopes(x)) if x == TANGENT else (lambda x: everywhere(0.0))


def _define(function: Callable[..., Any], implementation: Callable[..., Any]) -> None:
    """Define a function of two numbers of which one has tangents."""

    @overload(function)
    def _(x, y):
        return implementation if TANGENT in (x, y) else None


def _plus(slopes: Any, x: Any, weight: float) -> Any:
    """Return slopes, or None, plus those of a number times a weight."""
    raise NotImplementedError


@overload(_plus)
def _compiled_plus(slopes, x, weight):
    if x != TANGENT:
        return lambda slopes, x, weight: slopes
    if slopes == types.none:
        return lambda slopes, x, weight: slopes_of(x) * weight
    return lambda slopes, x, weight: fma(slopes_of(x), weight, slopes)


def _own(x: Any) -> Any:
    """Return a number's slopes, or None."""
    raise NotImplementedError


@overload(_own)
def _compiled_own(x):
    return (lambda x: slopes_of(x)) if x == TANGENT else (lambda x: None)


_define(
    operator.add,
    lambda x, y: tangent(value_of(x) + value_of(y), _plus(_own(x), y, 1.0)),
)
_define(
    operator.sub,
    lambda x, y: tangent(value_of(x) - value_of(y), _plus(_own(x), y, -1.0)),
)
_define(
    operator.mul,
    lambda x, y: tangent(
        value_of(x) * value_of(y), _plus(_plus(None, y, value_of(x)), x, value_of(y))
    ),
)
_define(operator.lt, lambda x, y: value_of(x) < value_of(y))
_define(operator.le, lambda x, y: value_of(x) <= value_of(y))
_define(operator.gt, lambda x, y: value_of(x) > value_of(y))
_define(operator.ge, lambda x, y: value_of(x) >= value_of(y))
_define(operator.eq, lambda x, y: value_of(x) == value_of(y))


@overload(operator.truediv)
def _quotient(x, y):
    def divide(x, y):
        quotient, by = value_of(x) / value_of(y), 1.0 / value_of(y)
        return tangent(quotient, _plus(_own(x), y, -quotient) * by)

    return divide if TANGENT in (x, y) else None


@overload(operator.neg)
def _negative(x):
    return (lambda x: tangent(-value_of(x), -slopes_of(x))) if x == TANGENT else None


@overload(abs)
def _absolute(x):
    return (lambda x: -x if value_of(x) < 0.0 else x) if x == TANGENT else None


@overload(fma)
def _fused(x, y, z):
    def multiply_and_add(x, y, z):
        slopes = _plus(_plus(_own(z), y, value_of(x)), x, value_of(y))
        return tangent(fma(value_of(x), value_of(y), value_of(z)), slopes)

    return multiply_and_add if TANGENT in (x, y, z) else None


@overload(where)
def _chosen(condition, x, y):
    def choose(condition, x, y):
        slopes = slopes_of(x) if condition else slopes_of(y)
        return tangent(value_of(x) if condition else value_of(y), slopes)

    return choose if TANGENT in (x, y) else None


@overload(alike)
def _constant(x, value):
    return (lambda x, value: tangent(value, everywhere(0.0))) if x == TANGENT else None


@overload(math.cos)
def _cosine(x):
    def project(x):
        cosine, sine = cosine_and_sine(value_of(x))
        return tangent(cosine, slopes_of(x) * -sine)

    return project if x == TANGENT else None


@overload(math.sin)
def _sine(x):
    def project(x):
        cosine, sine = cosine_and_sine(value_of(x))
        return tangent(sine, slopes_of(x) * cosine)

    return project if x == TANGENT else None


@overload(root)
def _root(x):
    def extract(x):
        value = root(value_of(x))
        return tangent(value, slopes_of(x) * (0.5 / value))

    return extract if x == TANGENT else None


@overload(exp_of)
def _exponential(x):
    def grow(x):
        value = exp_of(value_of(x))
        return tangent(value, slopes_of(x) * value)

    return grow if x == TANGENT else None


@overload(power)
def _power(x, exponent):
    def raise_to(x, exponent):
        base, n = value_of(x), value_of(exponent)
        value = power(base, n)
        slopes = slopes_of(x) * (n * power(base, n - 1.0))
        return tangent(value, fma(slopes_of(exponent), value * log_of(base), slopes))

    return raise_to if TANGENT in (x, exponent) else None


@intrinsic
def _tangents_of(_context, rows):
    return TANGENTS(rows), lambda _c, _b, _s, arguments: arguments[0]


def tangents_of(rows: NDArray[np.float64]) -> Any:
    """Return rows of vectors as half as many numbers with tangents, lent as they are.

    The value of number k is the first of row 2 k, its slopes are in row 2 k + 1. The index k, j
    is that of its slope along direction j alone.
    """
    raise NotImplementedError


@overload(tangents_of)
def _compiled_tangents(rows):
    return (lambda rows: _tangents_of(rows)) if rows == ROWS else None


@intrinsic
def _vectors_of(_context, rows):
    return ROWS(rows), lambda _c, _b, _s, arguments: arguments[0]


def vectors_of(rows: Any) -> NDArray[np.float64]:
    """Return numbers with tangents as the rows of vectors that they are kept in."""
    raise NotImplementedError


@overload(vectors_of)
def _compiled_vectors(rows):
    return (lambda rows: _vectors_of(rows)) if rows == TANGENTS else None


def _place(builder: Any, rows: Any, k: Any, part: int) -> Any:
    """Return the address of the row of a number's value, or of its slopes."""
    row = builder.add(builder.shl(k, ir.Constant(k.type, 1)), ir.Constant(k.type, part))
    return builder.gep(rows, [row])


@intrinsic
def _get(_context, rows, k):
    def build(context, builder, _signature, arguments):
        first = builder.bitcast(_place(builder, *arguments, 0), ir.DoubleType().as_pointer())
        kind = context.get_value_type(TANGENT)
        whole = builder.insert_value(ir.Constant(kind, ir.Undefined), builder.load(first), 0)
        slopes = builder.load(_place(builder, *arguments, 1), align=64)
        return builder.insert_value(whole, slopes, 1)

    return TANGENT(rows, k), build


@intrinsic
def _set(_context, rows, k, x):
    def build(context, builder, _signature, arguments):
        rows, k, x = arguments
        first = builder.bitcast(_place(builder, rows, k, 0), ir.DoubleType().as_pointer())
        builder.store(builder.extract_value(x, 0), first)
        builder.store(builder.extract_value(x, 1), _place(builder, rows, k, 1), align=64)
        return context.get_dummy_value()

    return types.none(rows, k, x), build


@intrinsic
def _from(_context, rows, k):
    return TANGENTS(rows, k), lambda _c, builder, _s, arguments: _place(builder, *arguments, 0)


@overload(operator.getitem)
def _getitem(rows, k):
    if rows == TANGENTS and isinstance(k, types.BaseTuple):
        return lambda rows, k: vectors_of(rows)[2 * k[0] + 1, k[1]]
    return (lambda rows, k: _get(rows, np.int64(k))) if rows == TANGENTS else None


@overload(operator.setitem)
def _setitem(rows, k, x):
    if rows != TANGENTS:
        return None

    def set_slope(rows, k, x):
        vectors_of(rows)[2 * k[0] + 1, k[1]] = x

    if isinstance(k, types.BaseTuple):
        return set_slope
    return lambda rows, k, x: _set(rows, np.int64(k), tangent(value_of(x), slopes_of(x)))


@overload(from_row)
def _compiled_from(rows, k):
    return (lambda rows, k: _from(rows, np.int64(k))) if rows == TANGENTS else None
