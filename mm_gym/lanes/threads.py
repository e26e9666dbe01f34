"""A loop over ranges of lanes, run by numba's threads.

The kernels that it runs are not compiled into the loop but called by address. So each is compiled
once, its code is the same with one thread and with several, and one loop serves all kernels with
arguments of the same types.
"""

# ruff: noqa: ARG001 - numba gives types, and wants intrinsics to be plain functions

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from mm_gym.compiler.addresses import call
from mm_gym.compiler.jit import borrowing_kernel, sharing_kernel
from mm_gym.compiler.llvm_code import get_or_insert_function, intp_t
from mm_gym.lanes import layout

# `numba.get_num_threads` and `set_num_threads` would keep the kernel from being cached.


@intrinsic
def _thread_count(_context):
    """Return how many of numba's threads run the loops of this one."""

    def build(_context, builder, _signature, _values):
        kind = ir.FunctionType(intp_t, [])
        read = get_or_insert_function(builder.module, kind, "get_num_threads")
        return builder.call(read, [])

    return types.intp(), build


@intrinsic
def _set_thread_count(_context, count):
    """Set how many of them do."""

    def build(context, builder, _signature, values):
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [number])
        change = get_or_insert_function(builder.module, kind, "set_num_threads")
        builder.call(change, [builder.trunc(values[0], number)])
        return context.get_dummy_value()

    return types.none(types.intp), build


@borrowing_kernel
def nothing(first, last):
    """Do nothing: the second kernel where there is only one to run."""
    return layout.OK


@sharing_kernel
def in_threads(work, then, statuses, length, count, arguments, more):
    """Run two kernels, one after the other, on each range of lanes.

    Parameters
    ----------
    work : int
        Address of a kernel ``(*arguments, first, last) -> status``.
    then : int
        Address of a kernel ``(*more, first, last) -> status``, whose status is ignored.
    statuses : (ranges,) int64, written
        Status of `work` on each range.
    length : int
        Number of lanes in a range; the last one may have fewer.
    count : int
        Number of lanes.
    arguments, more : tuple
        What the kernels read and write.

    Returns
    -------
    int
        The largest status.
    """
    before = _thread_count()
    _set_thread_count(min(before, statuses.shape[0]))
    for k in numba.prange(statuses.shape[0]):
        first = np.int64(k) * length
        last = min(first + length, count)
        statuses[k] = call(work, (*arguments, first, last))
        call(then, (*more, first, last))
    _set_thread_count(before)
    status = statuses[0]
    for k in range(1, statuses.shape[0]):
        status = max(status, statuses[k])
    return status
