"""Escapes of the carriage that the end of an episode settles."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.law.forces import escape_distance


@borrowing_kernel
def are_terminated(lanes, ends, duration, first, last):
    """Tell whether every lane whose carriage has escaped is terminated, and there is one.

    Parameters
    ----------
    lanes
        (rows, count) read: displacement and parameters.
    ends
        (3, count) bool, read: how the step ended.
    duration
        Length of a sample interval [s], which `forces.escape_distance` depends on.
    first, last
        The lanes first .. last - 1.
    """
    found = False
    for i in range(first, last):
        m1, k1, alpha, beta = (
            lanes[at.M1, i],
            lanes[at.K1, i],
            lanes[at.ALPHA, i],
            lanes[at.BETA, i],
        )
        if abs(lanes[at.X1, i]) > escape_distance(m1, k1, alpha, beta, duration):
            found = True
            if not ends[at.TERMINATED, i]:
                return False
    return found
