"""Kernels of one's own, compiled and kept as those of the package are.

`kernel` compiles a function, `borrowing_kernel` one that allocates no array and returns none, and
`inlined_kernel` one of those into its callers.
"""

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel

__all__ = ["borrowing_kernel", "inlined_kernel", "kernel"]
