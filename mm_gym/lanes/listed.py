"""Lists of lanes, and rows set, copied, gathered and scattered in the lanes listed.

Lists are in ascending order. If one is a run of neighbours, as in a reset of all lanes, the
compiler vectorises the loops over it.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes.memory import copy_row, fill, span


@borrowing_kernel
def place_of(lane, which):
    """Return the place in a list of lanes, in ascending order, of the first one from `lane` on."""
    low, high = 0, which.shape[0]
    while low < high:
        middle = (low + high) // 2
        if which[middle] < lane:
            low = middle + 1
        else:
            high = middle
    return low


@borrowing_kernel
def run_of(which):
    """Return the first lane listed and the end of the run that the list is; the same if none."""
    count = which.shape[0]
    if count == 0 or which[count - 1] - which[0] != count - 1:
        return 0, 0
    return which[0], which[0] + count


@borrowing_kernel
def set_row(rows, row, value, which):
    """Set a row to a value in the lanes listed."""
    first, last = run_of(which)
    fill(rows, row, value, first, last)
    if last == first:
        for k in span(0, which.shape[0]):
            rows[row, which[k]] = value


@borrowing_kernel
def copy_within(rows, source, target, which):
    """Copy a row to another one in the lanes listed."""
    first, last = run_of(which)
    copy_row(rows, source, target, first, last)
    if last == first:
        for k in span(0, which.shape[0]):
            rows[target, which[k]] = rows[source, which[k]]


@borrowing_kernel
def gather_row(rows, row, gathered, which, first):
    """Copy a row of the lanes listed to the same row of others, side by side from `first` on."""
    for k in span(0, which.shape[0]):
        gathered[row, np.uintp(first) + k] = rows[row, np.uintp(which[k])]


@borrowing_kernel
def scatter_row(gathered, source, rows, target, which, first):
    """Copy a row of lanes side by side, from `first` on, to a row of the lanes listed."""
    for k in span(0, which.shape[0]):
        rows[target, np.uintp(which[k])] = gathered[source, np.uintp(first) + k]
