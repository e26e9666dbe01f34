"""A word on a terminal before compilation, in place of silence."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

SECONDS_PER_BYTE = 2.2e-4
"""Processor time over the size of the byte code of all kernels compiled, measured for the
tasks on a Zen 5 core; on other machines, and with other processes, it is more or less."""

NOT_KEPT = "each process compiles anew, for compiled code cannot be written"
"""How the warning begins, of a process that keeps nothing."""

_expected: set[Any] = set()
_announced: list[float] = []


def expect(*kernels: Callable[..., Any]) -> None:
    """Name kernels that will soon be called, so that the announcement counts all of them."""
    _expected.update(kernels)


def announce(kernel: Callable[..., Any]) -> None:
    """Say once in a process, and on a terminal only, that kernels are compiled and for how long."""
    if _announced or sys.stderr is None or not sys.stderr.isatty():
        return
    _announced.append(seconds(kernel, *_expected))
    about = max(1, round(_announced[0]))
    print(f"mm_gym: compiling once, about {about} s", file=sys.stderr, flush=True)  # noqa: T201


def seconds(*kernels: Callable[..., Any]) -> float:
    """Return an estimate of the time that it takes to compile kernels and all that they call."""
    functions: set[Any] = set()
    for kernel in kernels:
        _add(kernel, functions)
    return SECONDS_PER_BYTE * sum(len(function.__code__.co_code) for function in functions)


def _add(kernel: Callable[..., Any], functions: set[Any]) -> None:
    function: Any = getattr(kernel, "py_func", None)
    if function is None or function in functions:
        return
    functions.add(function)
    for other in _named(function):
        _add(other, functions)


def _named(function: Callable[..., Any]) -> Iterator[Any]:
    """Yield what a function names: what it closes over, globals, and the contents of modules."""
    for cell in function.__closure__ or ():
        yield cell.cell_contents
    names = function.__code__.co_names
    for name in names:
        value = function.__globals__.get(name)
        yield value
        if isinstance(value, ModuleType):
            yield from (getattr(value, inner, None) for inner in names)
