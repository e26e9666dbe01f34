"""Functions and types of kernels, written in LLVM's instructions.

The helpers that are imported here are those that numba's guide to extensions takes from private
modules.
"""

# ruff: noqa: ANN401, PLW0108 - LLVM's values have no types here, and numba reads lambdas' code

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter, Signature, signature
from typing import Any

from numba import types
from numba.core.cgutils import (
    alloca_once,
    get_item_pointer,
    get_or_insert_function,
    intp_t,
    unpack_tuple,
)
from numba.core.imputils import lower_constant
from numba.extending import intrinsic, models, overload, register_model

__all__ = [
    "alloca_once",
    "compiled_as",
    "defines",
    "get_item_pointer",
    "get_or_insert_function",
    "instruction",
    "intp_t",
    "lower_constant",
    "unpack_tuple",
    "value_type",
]

_REPRESENTED: dict[str, Any] = {}
"""Name of a type of kernels -> the compiler's type of its values."""


class _Value(types.Type):
    """A type of kernels whose values are one value of the compiler's."""


@register_model(_Value)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, _REPRESENTED[fe_type.name])


def value_type(name: str, represented: Any) -> types.Type:
    """Return a type of kernels whose values are represented by one of the compiler's."""
    _REPRESENTED[name] = represented
    return _Value(name)


def instruction(count: int, result: types.Type, build: Callable[..., Any]) -> Callable[..., Any]:
    """Return what kernels call with `count` arguments.

    Parameters
    ----------
    result
        Type of what it returns; `types.none` for nothing.
    build
        (context, builder, types of the arguments, *values) -> value.
    """

    def define(_context: Any, *kinds: types.Type) -> tuple[Any, Callable[..., Any]]:
        def codegen(context: Any, builder: Any, given: Any, values: Any) -> Any:
            built = build(context, builder, given.args, *values)
            return context.get_dummy_value() if result == types.none else built

        return result(*kinds), codegen

    names = ["context", *(f"x{k}" for k in range(count))]
    define.__signature__ = Signature(
        [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    )
    return intrinsic(define)


_CALLS: dict[int, Callable[..., Callable[..., Any]]] = {
    1: lambda function: lambda x: function(x),
    2: lambda function: lambda x, y: function(x, y),
    3: lambda function: lambda x, y, z: function(x, y, z),
    4: lambda function: lambda w, x, y, z: function(w, x, y, z),
}
"""Number of arguments -> what a kernel is told to do in place of a call: numba reads its code."""


def compiled_as(
    result: types.Type, build: Callable[..., Any], when: Callable[..., bool] | None = None
) -> Callable[..., Callable[..., Any]]:
    """Return a decorator of a function that is an `instruction` in kernels.

    Where `when` is given, it is only for arguments of which it holds, by their types.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        count = len(signature(function).parameters)
        call = _CALLS[count](instruction(count, result, build))
        defines(function, when or (lambda *_: True))(call)
        return function

    return decorate


def defines(function: Callable[..., Any], when: Callable[..., bool]) -> Callable[..., Any]:
    """Return a decorator of what a function does in kernels, for arguments of which `when` holds.

    `when` takes their types.
    """

    def decorate(implementation: Callable[..., Any]) -> Callable[..., Any]:
        def choose(*kinds: types.Type) -> Callable[..., Any] | None:
            return implementation if when(*kinds) else None

        choose.__signature__ = signature(implementation)
        overload(function)(choose)
        return implementation

    return decorate
