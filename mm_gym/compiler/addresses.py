"""Calls of compiled functions by address: the loop that calls them is compiled without them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from mm_gym.compiler.jit import COMPILED, compiled_for

if TYPE_CHECKING:
    from collections.abc import Callable


def address_of(work: Callable[..., object], *arguments: object) -> int:
    """Return the address of a function's machine code for arguments like these.

    It is valid as long as the function exists. In plain Python it is the function itself.
    """
    if not COMPILED:
        return work  # pyright: ignore[reportReturnType] - as `call` takes it
    compiled = compiled_for(work, *arguments)
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def _called_by_address(build: Callable[..., Any]) -> Callable[..., Any]:
    """Return numba's intrinsic; in plain Python, a call of the function in the address's place."""
    return intrinsic(build) if COMPILED else lambda work, arguments: work(*arguments)


def _call_of(context, builder, values, kinds, returned):
    """Build the call of what is at an address; return numba's status and the result."""
    convention = context.call_conv
    kind = convention.get_function_type(returned, kinds)
    pointer = builder.inttoptr(values[0], kind.as_pointer())
    given = cgutils.unpack_tuple(builder, values[1])
    return convention.call_function(builder, pointer, returned, kinds, given)


@_called_by_address
def call(_context, address, arguments):
    """Call the kernel at an address, and return its status."""

    def build(context, builder, signature, values):
        return _call_of(context, builder, values, signature.args[1].types, types.int64)[1]

    return types.int64(address, arguments), build


@_called_by_address
def call_and_tell(_context, address, arguments):
    """Call the function at an address, which returns nothing; tell whether it raised an error."""

    def build(context, builder, signature, values):
        status, _ = _call_of(context, builder, values, signature.args[1].types, types.none)
        return status.is_error

    return types.boolean(address, arguments), build
