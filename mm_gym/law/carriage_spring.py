"""The spring of the carriage: (1) and (9) of docs/model.md, and its escape beyond a barrier."""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma


@inlined_kernel
def secant(linear, cubic, x1):
    """Return the slope from the middle to the force at a displacement x1 [m]."""
    return fma(cubic * x1, x1, linear)


@inlined_kernel
def carriage_force(k1, alpha, beta, x1):
    """Return the force [N] that the carriage's spring resists a displacement x1 [m] with."""
    return k1 * secant(alpha, beta, x1) * x1  # (1) of docs/model.md


@inlined_kernel
def carriage_energy(k1, alpha, beta, x1):
    """Return the energy [J] of the carriage's spring."""
    return k1 * (0.5 * alpha * x1**2 + 0.25 * beta * x1**4)  # (9) of docs/model.md


@inlined_kernel
def escape_distance(m1, k1, alpha, beta, duration):
    """Return |x1| [m] beyond which a carriage that moves outwards has escaped; infinite if never.

    It is ten times the barrier sqrt(-alpha / beta), where the cubic force is a hundred times the
    linear one, and at least where the cubic force alone takes the carriage from rest to infinity,
    in 1.85 sqrt(m1 / (-k1 beta)) / |x1|, within a sixteenth of a duration [s].
    """
    if beta >= 0.0:
        return math.inf
    return max(10.0 * math.sqrt(abs(alpha / beta)), 32.0 * math.sqrt(m1 / (-beta * k1)) / duration)


@inlined_kernel
def has_escaped(x1, v1, distance):
    """Tell whether a carriage is beyond its escape distance [m] and moves outwards."""
    return (abs(x1) > distance) & (x1 * v1 > 0.0)


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
        Length of a sample interval [s], which `escape_distance` depends on.
    first, last
        The lanes first .. last - 1.
    """
    found = False
    for i in range(first, last):
        m1, k1 = lanes[layout.M1, i], lanes[layout.K1, i]
        alpha, beta = lanes[layout.ALPHA, i], lanes[layout.BETA, i]
        if abs(lanes[layout.X1, i]) > escape_distance(m1, k1, alpha, beta, duration):
            found = True
            if not ends[layout.TERMINATED, i]:
                return False
    return found
