"""Calls of compiled functions by address: the loop that calls them is compiled without them."""

from __future__ import annotations

from collections.abc import Callable

import numba
from numba import types
from numba.extending import intrinsic

from mm_gym.compiler.jit import COMPILED, LINKED, compiled_for
from mm_gym.compiler.llvm_code import unpack_tuple


def address_of(work: Callable[..., object], *arguments: object) -> int:
    """Return the address of a function's machine code for arguments like these.

    It is valid as long as the function exists. Where kernels are not linked it is the function
    itself.
    """
    if not LINKED:
        return work  # pyright: ignore[reportReturnType] - as `call` takes it
    compiled = compiled_for(work, *arguments)
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def _call_of(context, builder, values, kinds, returned):
    """Build the call of what is at an address; return numba's status and the result."""
    convention = context.call_conv
    kind = convention.get_function_type(returned, kinds)
    pointer = builder.inttoptr(values[0], kind.as_pointer())
    given = unpack_tuple(builder, values[1])
    return convention.call_function(builder, pointer, returned, kinds, given)


@intrinsic
def _call(_context, address, arguments):
    """Build the call of a kernel, which returns its status."""

    def build(context, builder, signature, values):
        return _call_of(context, builder, values, signature.args[1].types, types.int64)[1]

    return types.int64(address, arguments), build


@intrinsic
def _call_and_tell(_context, address, arguments):
    """Build the call of what returns nothing; it tells whether an error was raised."""

    def build(context, builder, signature, values):
        status, _ = _call_of(context, builder, values, signature.args[1].types, types.none)
        return status.is_error

    return types.boolean(address, arguments), build


@numba.njit
def _call_function(work, arguments):
    return work(*arguments)


@numba.njit
def _call_function_and_tell(work, arguments):
    try:
        work(*arguments)
    except Exception:  # noqa: BLE001 - whatever a user's function raises
        return True
    return False


def _chosen(linked, compiled, plain):
    return linked if LINKED else compiled if COMPILED else plain


call = _chosen(_call, _call_function, _call_function)
"""(address, arguments) -> status: call a kernel."""

call_and_tell = _chosen(_call_and_tell, _call_function_and_tell, _call_function)
"""(address, arguments) -> bool: call a function that returns nothing; tell whether it raised.

In plain Python, its error is the caller's.
"""
