"""Vectors of doubles, one number of each of several lanes, which kernels use like numbers.

What is written once works on one lane or on LANES of them, in the same operations: a compiler left
to find them in loops over lanes misses many.
"""

# ruff: noqa: ANN401, ARG001, ARG005 - numba gives types

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import types

from mm_gym.arrays import Array
from mm_gym.compiler.llvm_code import (
    compiled_as,
    defines,
    get_or_insert_function,
    value_type,
)
from mm_gym.lanes.arithmetic import fma


def _is_wide() -> bool:
    """Tell whether kernels are compiled for AVX-512, of this processor or the one that is named."""
    name, features = numba.config.CPU_NAME or "", numba.config.CPU_FEATURES
    if features is None:
        return bool(get_host_cpu_features().get("avx512f"))
    return "+avx512f" in features or name.endswith(("-v4", "-avx512"))


LANES = 16 if _is_wide() else 8
"""Numbers in a vector: two of the widest registers, so that one hides the other's latency.

Kernels kept on disk are those of one processor. A lane's result does not depend on it.
"""

NUMBERS = ir.VectorType(ir.DoubleType(), LANES)
"""The compiler's type of a vector."""

_SINGLES = ir.VectorType(ir.FloatType(), LANES)
_INTEGERS = ir.VectorType(ir.IntType(64), LANES)
_ONE = 0x3FF << 52
"""Bits of the double 1."""

_INFINITE = 0x7FF << 52
"""Bits of the double infinity."""

VECTOR = value_type(f"Vector({LANES})", NUMBERS)
MASK = value_type(f"Mask({LANES})", ir.VectorType(ir.IntType(1), LANES))


def is_number(kind: types.Type, *_: types.Type) -> bool:
    """Tell whether a type, the first one of several, is that of a number."""
    return isinstance(kind, types.Number)


def spread(builder: Any, kind: types.Type, value: Any) -> Any:
    """Return a vector as it is, a number once for each lane."""
    if kind == VECTOR:
        return value
    if isinstance(kind, types.Integer):
        value = builder.sitofp(value, ir.DoubleType())
    return _copies(builder, NUMBERS, value)


def _copies(builder: Any, kind: Any, value: Any) -> Any:
    """Return a vector of a kind with a value in every lane."""
    unset = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(unset, value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, unset, order)


def _on_vectors(
    function: Callable[..., Any], result: types.Type, build: Callable[..., Any]
) -> None:
    """Let a function of kernels take vectors, and numbers next to them."""

    def build_spread(_context: Any, builder: Any, kinds: Any, *values: Any) -> Any:
        pairs = zip(kinds, values, strict=True)
        return build(builder, *(spread(builder, kind, value) for kind, value in pairs))

    compiled_as(result, build_spread, lambda *kinds: VECTOR in kinds)(function)


def call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call a function of LLVM's on vectors of one kind."""
    vector = arguments[0].type
    kind = ir.FunctionType(vector, [vector] * len(arguments))
    suffix = "f32" if vector == _SINGLES else "f64"
    function = get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}{suffix}")
    return builder.call(function, arguments)


def root(x: float) -> float:
    """Return the square root, not a number below zero."""
    return np.sqrt(x)


defines(root, is_number)(lambda x: math.sqrt(x))  # noqa: PLW0108 - numba wants a plain function

_on_vectors(operator.neg, VECTOR, lambda builder, x: builder.fneg(x))
_on_vectors(abs, VECTOR, lambda builder, x: call(builder, "fabs", x))
_on_vectors(root, VECTOR, lambda builder, x: call(builder, "sqrt", x))
_on_vectors(operator.add, VECTOR, lambda builder, x, y: builder.fadd(x, y))
_on_vectors(operator.sub, VECTOR, lambda builder, x, y: builder.fsub(x, y))
_on_vectors(operator.mul, VECTOR, lambda builder, x, y: builder.fmul(x, y))
_on_vectors(operator.truediv, VECTOR, lambda builder, x, y: builder.fdiv(x, y))
_on_vectors(operator.lt, MASK, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_on_vectors(operator.le, MASK, lambda builder, x, y: builder.fcmp_ordered("<=", x, y))
_on_vectors(operator.gt, MASK, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_on_vectors(operator.ge, MASK, lambda builder, x, y: builder.fcmp_ordered(">=", x, y))
_on_vectors(operator.eq, MASK, lambda builder, x, y: builder.fcmp_ordered("==", x, y))
_on_vectors(fma, VECTOR, lambda builder, x, y, z: call(builder, "fma", x, y, z))

compiled_as(
    MASK,
    lambda _context, builder, _kinds, x, y: builder.and_(x, y),
    lambda x, y: x == MASK and y == MASK,
)(operator.and_)


def _built_near_root(_context: Any, builder: Any, _kinds: Any, x: Any, y: Any, k: Any) -> Any:
    most, one = (ir.Constant(ir.IntType(64), value) for value in (_INFINITE, _ONE))
    above, below = (builder.bitcast(value, _INTEGERS) for value in (x, y))
    # Never below 0, so that the shift is one without a sign.
    apart = builder.sub(builder.add(above, _copies(builder, _INTEGERS, most)), below)
    bits = builder.lshr(apart, _copies(builder, _INTEGERS, k))
    zero = _copies(builder, _INTEGERS, builder.sub(one, builder.lshr(most, k)))
    return builder.bitcast(builder.add(bits, zero), NUMBERS)


@compiled_as(VECTOR, _built_near_root)
def near_root(x: Array, y: Array, k: int) -> Array:
    """Return (x / y)**(1 / 2**k), neither below 0, up to 10 % away.

    There is no division in it: a double's bits are nearly its logarithm.
    """
    above, below = (np.asarray(value, np.float64).view(np.uint64) for value in (x, y))
    bits = (above + np.uint64(_INFINITE) - below) >> np.uint64(k)
    return (bits + np.uint64(_ONE - (_INFINITE >> k))).view(np.float64)


def _built_in_single(build: Callable[..., Any]) -> Callable[..., Any]:
    """Return what builds an operation in single precision, in a fraction of the time."""

    def build_rough(_context: Any, builder: Any, _kinds: Any, *values: Any) -> Any:
        result = build(builder, *(builder.fptrunc(value, _SINGLES) for value in values))
        return builder.fpext(result, NUMBERS)

    return build_rough


@compiled_as(VECTOR, _built_in_single(lambda builder, x, y: builder.fdiv(x, y)))
def rough_quotient(x: Array, y: Array) -> Array:
    """Return x / y in single precision."""
    return np.float64(np.float32(x) / np.float32(y))


@compiled_as(VECTOR, _built_in_single(lambda builder, x: call(builder, "sqrt", x)))
def rough_root(x: Array) -> Array:
    """Return the square root in single precision."""
    return np.float64(np.sqrt(np.float32(x)))


def recast(build: Callable[..., Any]) -> Callable[..., Callable[..., Any]]:
    """Return a decorator of a function of a number or vector, which kernels build from its bits.

    It is built as (builder, value, type of integers, type of numbers) -> value.
    """

    def built(_context: Any, builder: Any, kinds: Any, x: Any) -> Any:
        whole, number = (
            (_INTEGERS, NUMBERS) if kinds[0] == VECTOR else (ir.IntType(64), ir.DoubleType())
        )
        return build(builder, x, whole, number)

    return compiled_as(None, built)


@recast(lambda builder, x, whole, number: builder.sitofp(builder.bitcast(x, whole), number))
def read_bits(x: float) -> float:
    """Return the bits of a double, read as an integer."""
    return np.asarray(x, np.float64).view(np.int64) * 1.0


@recast(lambda builder, x, whole, number: builder.bitcast(builder.fptosi(x, whole), number))
def write_bits(x: float) -> float:
    """Return the double whose bits, read as an integer, are x without its fraction."""
    return np.asarray(x).astype(np.int64).view(np.float64)[()]


@compiled_as(
    VECTOR,
    lambda _context, builder, kinds, _x, value: spread(builder, kinds[1], value),
    lambda x, value: x == VECTOR,
)
def alike(x: float, value: float) -> float:
    """Return a number of the kind of x: once for each lane if x is a vector."""
    return value


defines(alike, is_number)(lambda x, value: value)


@compiled_as(types.float64, lambda _context, builder, _kinds, x, k: builder.extract_element(x, k))
def element(x: Array, k: int) -> float:
    """Return the number of lane k."""
    return x[k]


@compiled_as(
    VECTOR, lambda _context, builder, _kinds, x, k, value: builder.insert_element(x, value, k)
)
def with_element(x: Array, k: int, value: float) -> Array:
    """Return a vector with the number of lane k replaced."""
    changed = np.broadcast_to(x, LANES).copy()
    changed[k] = value
    return changed


@compiled_as(VECTOR, lambda _context, builder, _kinds, x: _copies(builder, NUMBERS, x))
def everywhere(x: float) -> Array:
    """Return a vector of a number in every lane."""
    return np.full(LANES, x)
