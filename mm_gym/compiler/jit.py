"""The decorators of all kernels: compiled without the GIL, and kept on disk."""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numba

from mm_gym.compiler.dispatcher import KernelDispatcher, OnceDispatcher

if TYPE_CHECKING:
    from collections.abc import Callable

    from numba.core.compiler import CompileResult

COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled, or run as plain Python for a debugger: NUMBA_DISABLE_JIT=1."""


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel. No fastmath: results must not depend on how many lanes run together."""
    return _compiled(function, nrt=True)


def borrowing_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that allocates no array and returns none.

    It leaves out the counting of references to the arrays that it is lent, which for one lane takes
    as long as the arithmetic.
    """
    return _compiled(function, nrt=False)


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a borrowing kernel into its callers: a call of a dozen arguments has its cost."""
    return _compiled(function, nrt=False, inline=True)


@cache
def plain(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel as plain Python, its helpers too: for decimals, arrays, or a few numbers.

    Helpers are the kernels of its own module that it calls by name.
    """
    function: Any = getattr(kernel, "py_func", kernel)
    known = function.__globals__
    helpers = {
        name: plain(known[name])
        for name in function.__code__.co_names
        if hasattr(known.get(name), "py_func")
    }
    return FunctionType(function.__code__, known | helpers, function.__name__)


def sharing_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a borrowing kernel whose loops over `numba.prange` numba's threads share."""
    return _compiled(function, nrt=False, parallel=True)


def entry_point(kernel: Callable[..., Any], *arguments: object) -> Callable[..., Any]:
    """Return what Python calls for such arguments, without a look at their types.

    That look takes longer than a control step of one lane. What is called with other types
    misreads them.
    """
    return compiled_for(kernel, *arguments).entry_point if COMPILED else kernel


def compiled_for(kernel: Callable[..., Any], *arguments: object) -> CompileResult:
    """Return what a kernel is compiled to for such arguments."""
    dispatcher: Any = kernel
    kinds = tuple([numba.typeof(argument) for argument in arguments])
    dispatcher.compile(kinds)
    return dispatcher.overloads[kinds]


def _compiled(
    function: Callable[..., Any], *, nrt: bool, inline: bool = False, parallel: bool = False
) -> Callable[..., Any]:
    if not COMPILED:
        return function
    options = {
        "nopython": True,
        "nogil": True,
        "error_model": "numpy",
        "_nrt": nrt,
        "forceinline": inline,
        "parallel": parallel,
        "no_cfunc_wrapper": True,
    }
    return (OnceDispatcher if parallel else KernelDispatcher)(function, options)
