"""Functions and types of kernels, written in LLVM's instructions.

The helpers that are imported here are those that numba's guide to extensions takes from private
modules, and those by which numba's own `intrinsic` and `overload` make a function known.
"""

# ruff: noqa: ANN401 - LLVM's values have no types here

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from inspect import Parameter, Signature, signature
from typing import Any

from numba import types
from numba.extending import intrinsic, models, register_model

from mm_gym.compiler.guard import INSTALL, lacks
from mm_gym.compiler.jit import inlined_kernel

try:
    from numba.core.cgutils import (
        alloca_once,
        get_item_pointer,
        get_or_insert_function,
        intp_t,
        unpack_tuple,
    )
    from numba.core.imputils import lower_constant
    from numba.core.typing.templates import AbstractTemplate, infer_global, make_intrinsic_template
except ImportError as error:  # kernels cannot be written without them
    msg = f"{lacks(error)}; {INSTALL}"
    raise ImportError(msg) from error

__all__ = [
    "alloca_once",
    "chooses",
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
    names = ["context", *(f"x{k}" for k in range(count))]
    return intrinsic(_definition(names, result, build, lambda *_: True))


def _definition(
    names: Sequence[str],
    result: types.Type | None,
    build: Callable[..., Any],
    when: Callable[..., bool],
) -> Callable[..., Any]:
    """Return what numba asks for type and code of an instruction, with arguments of these names."""

    def define(_context: Any, *kinds: types.Type) -> tuple[Any, Callable[..., Any]] | None:
        def codegen(context: Any, builder: Any, given: Any, values: Any) -> Any:
            built = build(context, builder, given.args, *values)
            return context.get_dummy_value() if result == types.none else built

        return ((result or kinds[0])(*kinds), codegen) if when(*kinds) else None

    define.__signature__ = Signature(
        [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    )
    return define


def compiled_as(
    result: types.Type | None, build: Callable[..., Any], when: Callable[..., bool] | None = None
) -> Callable[..., Callable[..., Any]]:
    """Return a decorator of a function that is an `instruction` in kernels.

    Without a type, the result has that of the first argument. Where `when` is given, it is only for
    arguments of which it holds, by their types.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        names = ["context", *signature(function).parameters]
        define = _definition(names, result, build, when or (lambda *_: True))
        template = make_intrinsic_template(function, define, function.__name__)
        infer_global(function, types.Function(template))
        return function

    return decorate


def chooses(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a decorator of what returns, by the arguments' types, what a function does in kernels.

    It returns None for arguments of other types. Numba's `overload` does the same, but also makes
    machine code of each choice, which nothing ever runs.
    """

    def decorate(choose: Callable[..., Callable[..., Any] | None]) -> Callable[..., Any]:
        @cache
        def chosen(*kinds: types.Type) -> Any:
            implementation = choose(*kinds)
            return implementation and inlined_kernel(implementation)

        class Template(AbstractTemplate):
            key = function

            def generic(self, args: Any, kws: Any) -> Any:
                kernel = chosen(*args)
                return kernel and types.Dispatcher(kernel).get_call_type(self.context, args, kws)

            def get_impl_key(self, sig: Any) -> Any:
                return chosen(*sig.args).get_overload(sig)

        infer_global(function, types.Function(Template))
        return choose

    return decorate


def defines(function: Callable[..., Any], when: Callable[..., bool]) -> Callable[..., Any]:
    """Return a decorator of what a function does in kernels, for arguments of which `when` holds.

    `when` takes their types.
    """

    def decorate(implementation: Callable[..., Any]) -> Callable[..., Any]:
        chooses(function)(lambda *kinds: implementation if when(*kinds) else None)
        return implementation

    return decorate
