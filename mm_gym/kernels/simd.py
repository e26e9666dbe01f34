"""Vectors of doubles, one number of each of several lanes, which kernels use like numbers.

What is written once works on one lane or on LANES of them, in the same operations: a compiler left
to find them in loops over lanes misses many.
"""

# ruff: noqa: ANN401, ARG001, PLW0108 - numba gives overloads types, and wants plain functions

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import COMPILED

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

LANES = 16
"""Numbers in a vector: two of the widest registers, so that one hides the other's latency."""

_NUMBERS = ir.VectorType(ir.DoubleType(), LANES)
_INTEGERS = ir.VectorType(ir.IntType(64), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Vector({LANES})")


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Mask({LANES})")


class _Rows(types.Type):
    def __init__(self) -> None:
        super().__init__(f"Rows({LANES})")


VECTOR, MASK, ROWS = _Vector(), _Mask(), _Rows()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, _NUMBERS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, _BITS)


@register_model(_Rows)
class _RowsModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: object) -> None:
        super().__init__(manager, fe_type, _NUMBERS.as_pointer())


def spread(builder: Any, kind: types.Type, value: Any) -> Any:
    """Return a vector as it is, a number once for each lane."""
    if kind == VECTOR:
        return value
    if isinstance(kind, types.Integer):
        value = builder.sitofp(value, ir.DoubleType())
    first = builder.insert_element(
        ir.Constant(_NUMBERS, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
    )
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(_NUMBERS, ir.Undefined), order)


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
    kind = ir.FunctionType(_NUMBERS, [_NUMBERS] * len(arguments))
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
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
    return lambda condition, x, y: x if condition else y


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
def _fused(_context, x, y, z):
    def build(_context, builder, signature, arguments):
        pairs = zip(signature.args, arguments, strict=True)
        return call(builder, "fma", *(spread(builder, kind, value) for kind, value in pairs))

    return VECTOR(x, y, z), build


@overload(fma)
def _fma_of_vectors(x, y, z):
    return (lambda x, y, z: _fused(x, y, z)) if VECTOR in (x, y, z) else None


def _recasting(build: Callable[..., Any]) -> Callable[..., Any]:
    """Return an intrinsic of a number or vector, given the types of integers and numbers."""

    def codegen(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wide = signature.args[0] == VECTOR
        whole, number = (_INTEGERS, _NUMBERS) if wide else (ir.IntType(64), ir.DoubleType())
        return build(builder, arguments[0], whole, number)

    return intrinsic(lambda _context, x: (x(x), codegen))


_read_bits = _recasting(
    lambda builder, x, whole, number: builder.sitofp(builder.bitcast(x, whole), number)
)
_write_bits = _recasting(
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
    return lambda x, value: value  # noqa: ARG005


@intrinsic
def _rows_of(_context, numbers):
    def build(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.bitcast(array.data, _NUMBERS.as_pointer())

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


@overload(operator.getitem)
def _getitem(rows, k):
    return (lambda rows, k: _get(rows, k)) if rows == ROWS else None


@intrinsic
def _set(_context, rows, k, value):
    def build(context, builder, signature, arguments):
        value = spread(builder, signature.args[2], arguments[2])
        builder.store(value, builder.gep(arguments[0], [arguments[1]]), align=64)
        return context.get_dummy_value()

    return types.none(rows, k, value), build


@overload(operator.setitem)
def _setitem(rows, k, value):
    return (lambda rows, k, value: _set(rows, k, value)) if rows == ROWS else None


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
    first = cgutils.get_item_pointer(context, builder, kind, array, place, wraparound=False)
    return builder.bitcast(first, _NUMBERS.as_pointer())


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


def rows_on_stack(count: int) -> Callable[[], NDArray[np.float64]]:
    """Return what a kernel calls for so many rows of a vector each, which live until it returns."""
    if not COMPILED:
        return lambda: np.empty((count, LANES))

    @intrinsic
    def rows(_context):
        def build(_context, builder, _signature, _arguments):
            return cgutils.alloca_once(builder, _NUMBERS, size=ir.Constant(ir.IntType(64), count))

        return ROWS(), build

    return rows


@intrinsic
def _stay_apart(_context):
    def build(context, builder, _signature, _arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), build


def stay_apart() -> None:
    """Keep the kernel that calls this from being inlined.

    Its callers may not prefer the widest vectors, and would have them cut up.
    """


@overload(stay_apart, inline="always")
def _compiled_stay_apart():
    return lambda: _stay_apart()
