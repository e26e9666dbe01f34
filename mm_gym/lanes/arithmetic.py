"""Arithmetic that the kernels share."""

from __future__ import annotations

from numba import types

from mm_gym.compiler.jit import kernel
from mm_gym.compiler.llvm_code import compiled_as


@compiled_as(
    types.float64,
    lambda _context, builder, _kinds, x, y, z: builder.fma(x, y, z),
    lambda *kinds: all(isinstance(kind, types.Number) for kind in kinds),  # `lanes.simd` has more
)
def fma(x: float, y: float, z: float) -> float:
    """Return x y + z, in a kernel rounded once.

    One instruction instead of two, and explicit where fastmath would leave it to the compiler to
    fuse or not: results stay independent of how many lanes run side by side.
    """
    return x * y + z


def _preferring_widest_vectors(_context, builder, _kinds):
    # llvmlite knows some attributes only, LLVM any in quotes.
    set.add(builder.function.attributes, '"prefer-vector-width"="512"')


@compiled_as(types.none, _preferring_widest_vectors)
def prefer_widest_vectors() -> None:
    """Ask for vectors of 512 bits in the kernel that calls this, where the processor has them.

    Compilers settle for 256, lest a few wide instructions slow the whole program down. Worth it
    where arithmetic, not memory, takes the time.
    """


@compiled_as(types.none, lambda _context, builder, _: builder.function.attributes.add("noinline"))
def stay_apart() -> None:
    """Keep the kernel that calls this from being inlined.

    Its callers may not prefer the widest vectors, and would have them cut up.
    """


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
