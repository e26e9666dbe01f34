"""Arithmetic that the kernels share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import types
from numba.extending import intrinsic, overload

from mm_gym.compiler.jit import kernel

if TYPE_CHECKING:
    from collections.abc import Callable


@intrinsic
def _fma(_context, x, y, z):
    def build(_context, builder, _signature, arguments):
        return builder.fma(*arguments)

    return types.float64(x, y, z), build


def fma(x: float, y: float, z: float) -> float:
    """Return x y + z, in a kernel rounded once.

    One instruction instead of two, and explicit where fastmath would leave it to the compiler to
    fuse or not: results stay independent of how many lanes run side by side.
    """
    return x * y + z


@overload(fma)
def _compiled_fma(x, y, z) -> Callable[..., float] | None:
    if not all(isinstance(kind, types.Number) for kind in (x, y, z)):
        return None  # `lanes.simd` has the rest
    return lambda x, y, z: _fma(x, y, z)  # noqa: PLW0108 - numba wants a plain function


@intrinsic
def _prefer_widest_vectors(_context):
    def build(context, builder, _signature, _arguments):
        # llvmlite knows some attributes only, LLVM any in quotes.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), build


def prefer_widest_vectors() -> None:
    """Ask for vectors of 512 bits in the kernel that calls this, where the processor has them.

    Compilers settle for 256, lest a few wide instructions slow the whole program down. Worth it
    where arithmetic, not memory, takes the time.
    """


@overload(prefer_widest_vectors, inline="always")
def _compiled_prefer_widest_vectors() -> Callable[..., None]:
    return lambda: _prefer_widest_vectors()  # noqa: PLW0108 - numba wants a plain function


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
def _compiled_stay_apart() -> Callable[..., None]:
    return lambda: _stay_apart()  # noqa: PLW0108 - numba wants a plain function


@kernel
def clip(value, low, high):
    """Return the value limited to [low, high]."""
    return min(max(value, low), high)


@kernel
def write_inverse_square(c, row, inverse, n):
    """Write term n of the series u = q**-2, from n q_0 u_n = -sum (n + j) q_j u_(n - j).

    Terms of q are in c from `row` on, up to the n-th; those of u from `inverse` on.
    """
    if n == 0:
        c[inverse] = 1.0 / (c[row] * c[row])
        return
    total = 0.0
    for j in range(1, n + 1):
        total -= (n + j) * c[row + j] * c[inverse + n - j]
    c[inverse + n] = total / (n * c[row])
