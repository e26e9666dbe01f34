"""The decorators of all kernels: compiled without the GIL, and kept on disk.

With a numba whose private names are not those that were tested, kernels are what `numba.njit` makes
of them: the same results, later and slower. `njit(cache=True)` is no help. Numba names the closures
of overloads by a number that every process begins anew, and a process that loads what two others
have kept takes one closure for another (https://github.com/numba/numba/issues/10486).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from types import CellType, FunctionType
from typing import TYPE_CHECKING, Any

import numba

from mm_gym.compiler.guard import INSTALL, dispatchers

if TYPE_CHECKING:
    from numba.core.compiler import CompileResult

COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled, or run as plain Python for a debugger: NUMBA_DISABLE_JIT=1."""

_dispatchers, OBSTACLE = dispatchers() if COMPILED else (None, None)
"""What makes kernels that are linked and kept, or what stands against it."""

LINKED = _dispatchers is not None
"""Whether kernels are linked, kept on disk, called by address and shared by threads."""

if OBSTACLE is not None:
    warnings.warn(
        f"{OBSTACLE}; each process compiles its kernels anew, which takes a minute or more, runs "
        f"them in one thread, and steps a single environment more slowly; {INSTALL}",
        RuntimeWarning,
        stacklevel=2,
    )


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

    Helpers are the kernels of its own module that it calls by name, and those that it closes over.
    """
    function: Any = getattr(kernel, "py_func", kernel)
    known = function.__globals__
    helpers = {
        name: plain(known[name])
        for name in function.__code__.co_names
        if hasattr(known.get(name), "py_func")
    }
    closure = tuple(
        CellType(plain(cell.cell_contents)) if hasattr(cell.cell_contents, "py_func") else cell
        for cell in function.__closure__ or ()
    )
    return FunctionType(function.__code__, known | helpers, function.__name__, None, closure)


def sharing_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a borrowing kernel whose loops over `numba.prange` numba's threads share."""
    return _compiled(function, nrt=False, parallel=True)


def entry_point(kernel: Callable[..., Any], *arguments: object) -> Callable[..., Any]:
    """Return what Python calls for such arguments, without a look at their types.

    That look takes longer than a control step of one lane. What is called with other types
    misreads them.
    """
    return compiled_for(kernel, *arguments).entry_point if LINKED else kernel


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
    if not LINKED:
        return numba.njit(nogil=True, error_model="numpy", forceinline=inline)(function)
    options = {
        "nopython": True,
        "nogil": True,
        "error_model": "numpy",
        "_nrt": nrt,
        "forceinline": inline,
        "parallel": parallel,
        "no_cfunc_wrapper": True,
    }
    make = _dispatchers.OnceDispatcher if parallel else _dispatchers.KernelDispatcher
    return make(function, options)
