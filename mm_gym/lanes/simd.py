"""Vectors of doubles, one number of each of several lanes, which kernels use like numbers.

What is written once works on one lane or on LANES of them, in the same operations: a compiler left
to find them in loops over lanes misses many.
"""

# ruff: noqa: ANN401, ARG001, PLW0108 - numba gives overloads types, and wants plain functions

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import types
from numba.extending import intrinsic, models, overload, register_model

from mm_gym.compiler.llvm_code import get_or_insert_function
from mm_gym.lanes.arithmetic import fma

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


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

_INTEGERS = ir.VectorType(ir.IntType(64), LANES)
_ONE = 0x3FF << 52
"""Bits of the double 1."""

_BITS = ir.VectorType(ir.IntType(1), LANES)


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Vector({LANES})")


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Mask({LANES})")


VECTOR, MASK = _Vector(), _Mask()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, NUMBERS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, _BITS)


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


def _operation(result: types.Type, build: Callable[..., Any], count: int) -> Callable[..., Any]:
    """Return an intrinsic of vectors and numbers."""

    def codegen(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pairs = zip(signature.args, arguments, strict=True)
        return build(builder, *(spread(builder, kind, value) for kind, value in pairs))

    if count == 1:
        return intrinsic(lambda _context, x: (result(x), codegen))
    return intrinsic(lambda _context, x, y: (result(x, y), codegen))


def call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call a function of LLVM's on vectors."""
    kind = ir.FunctionType(NUMBERS, [NUMBERS] * len(arguments))
    function = get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
    return builder.call(function, arguments)


def _absolute(builder: Any, x: Any) -> Any:
    return call(builder, "fabs", x)


def _compare(symbol: str) -> Callable[..., Any]:
    return lambda builder, x, y: builder.fcmp_ordered(symbol, x, y)


_UNARY = {
    operator.neg: lambda builder, x: builder.fneg(x),
    abs: _absolute,
}
_BINARY = {
    operator.add: (VECTOR, lambda builder, x, y: builder.fadd(x, y)),
    operator.sub: (VECTOR, lambda builder, x, y: builder.fsub(x, y)),
    operator.mul: (VECTOR, lambda builder, x, y: builder.fmul(x, y)),
    operator.truediv: (VECTOR, lambda builder, x, y: builder.fdiv(x, y)),
    operator.lt: (MASK, _compare("<")),
    operator.le: (MASK, _compare("<=")),
    operator.gt: (MASK, _compare(">")),
    operator.ge: (MASK, _compare(">=")),
    operator.eq: (MASK, _compare("==")),
}


def _define_unary(function: Callable[..., Any], build: Callable[..., Any]) -> None:
    operation = _operation(VECTOR, build, 1)

    @overload(function)
    def _(x):
        return (lambda x: operation(x)) if x == VECTOR else None


def _define_binary(
    function: Callable[..., Any], result: types.Type, build: Callable[..., Any]
) -> None:
    operation = _operation(result, build, 2)

    @overload(function)
    def _(x, y):
        return (lambda x, y: operation(x, y)) if VECTOR in (x, y) else None


for _function, _build in _UNARY.items():
    _define_unary(_function, _build)
for _function, (_result, _build) in _BINARY.items():
    _define_binary(_function, _result, _build)


@intrinsic
def _both(_context, x, y):
    return MASK(x, y), lambda _c, builder, _s, arguments: builder.and_(*arguments)


@overload(operator.and_)
def _and(x, y):
    return (lambda x, y: _both(x, y)) if x == MASK and y == MASK else None


@intrinsic
def _fused(_context, x, y, z):
    def build(_context, builder, signature, arguments):
        pairs = zip(signature.args, arguments, strict=True)
        return call(builder, "fma", *(spread(builder, kind, value) for kind, value in pairs))

    return VECTOR(x, y, z), build


@overload(fma)
def _fma_of_vectors(x, y, z):
    return (lambda x, y, z: _fused(x, y, z)) if VECTOR in (x, y, z) else None


_root = _operation(VECTOR, lambda builder, x: call(builder, "sqrt", x), 1)


def root(x: float) -> float:
    """Return the square root, not a number below zero."""
    return np.sqrt(x)


@overload(root)
def _compiled_root(x):
    if x == VECTOR:
        return lambda x: _root(x)
    return (lambda x: math.sqrt(x)) if isinstance(x, types.Number) else None


@intrinsic
def _inverse_root(_context, x, k):
    def build(_context, builder, _signature, arguments):
        x, k = arguments
        one = ir.Constant(ir.IntType(64), _ONE)
        whole = builder.bitcast(x, _INTEGERS)
        bits = builder.lshr(whole, _copies(builder, _INTEGERS, k))
        first = _copies(builder, _INTEGERS, builder.add(one, builder.lshr(one, k)))
        return builder.bitcast(builder.sub(first, bits), NUMBERS)

    return VECTOR(x, k), build


def inverse_root(x: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return x**(-1 / 2**k), up to 10 % too large: a double's bits are nearly its logarithm."""
    bits = np.asarray(x, np.float64).view(np.uint64) >> np.uint64(k)
    return (np.uint64(_ONE + (_ONE >> k)) - bits).view(np.float64)


@overload(inverse_root)
def _compiled_inverse_root(x, k):
    return lambda x, k: _inverse_root(x, k)


def recasting(build: Callable[..., Any]) -> Callable[..., Any]:
    """Return an intrinsic of a number or vector, given the types of integers and numbers."""

    def codegen(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wide = signature.args[0] == VECTOR
        whole, number = (_INTEGERS, NUMBERS) if wide else (ir.IntType(64), ir.DoubleType())
        return build(builder, arguments[0], whole, number)

    return intrinsic(lambda _context, x: (x(x), codegen))


_read_bits = recasting(
    lambda builder, x, whole, number: builder.sitofp(builder.bitcast(x, whole), number)
)
_write_bits = recasting(
    lambda builder, x, whole, number: builder.bitcast(builder.fptosi(x, whole), number)
)


def read_bits(x: float) -> float:
    """Return the bits of a double, read as an integer."""
    return np.asarray(x, np.float64).view(np.int64) * 1.0


@overload(read_bits)
def _compiled_read_bits(x):
    return lambda x: _read_bits(x)


def write_bits(x: float) -> float:
    """Return the double whose bits, read as an integer, are x without its fraction."""
    return np.asarray(x).astype(np.int64).view(np.float64)[()]


@overload(write_bits)
def _compiled_write_bits(x):
    return lambda x: _write_bits(x)


@intrinsic
def _spread_number(_context, x):
    return VECTOR(x), lambda _c, builder, signature, arguments: spread(
        builder, signature.args[0], arguments[0]
    )


def alike(x: float, value: float) -> float:
    """Return a number of the kind of x: once for each lane if x is a vector."""
    return value


@overload(alike)
def _compiled_alike(x, value):
    if x == VECTOR:
        return lambda x, value: _spread_number(value)  # noqa: ARG005
    return (lambda x, value: value) if isinstance(x, types.Number) else None  # noqa: ARG005


@intrinsic
def _element(_context, x, k):
    def build(_context, builder, _signature, arguments):
        return builder.extract_element(*arguments)

    return types.float64(x, k), build


def element(x: NDArray[np.float64], k: int) -> float:
    """Return the number of lane k."""
    return x[k]


@overload(element)
def _compiled_element(x, k):
    return lambda x, k: _element(x, k)


@intrinsic
def _with_element(_context, x, k, value):
    def build(_context, builder, _signature, arguments):
        x, k, value = arguments
        return builder.insert_element(x, value, k)

    return VECTOR(x, k, value), build


def with_element(x: NDArray[np.float64], k: int, value: float) -> NDArray[np.float64]:
    """Return a vector with the number of lane k replaced."""
    changed = np.broadcast_to(x, LANES).copy()
    changed[k] = value
    return changed


@overload(with_element)
def _compiled_with_element(x, k, value):
    return lambda x, k, value: _with_element(x, k, value)


@intrinsic
def _spread_wide(_context, x):
    return VECTOR(x), lambda _c, builder, _s, arguments: spread(
        builder, types.float64, arguments[0]
    )


def everywhere(x: float) -> NDArray[np.float64]:
    """Return a vector of a number in every lane."""
    return np.full(LANES, x)


@overload(everywhere)
def _compiled_everywhere(x):
    return lambda x: _spread_wide(x)
