"""Bounds of how fast a motion can be."""

from __future__ import annotations

import math

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes import layout


@inlined_kernel
def largest_eigenvalue(m1, m2, outer, inner):
    """Return the largest eigenvalue of [[outer + inner, -inner], [-inner, inner]] v = s M v.

    Outer joins the carriage to the ground, inner the sphere to the carriage: stiffnesses [N/m] give
    the square of the fastest undamped frequency [1/s^2], dampings [N s/m] the fastest decay [1/s].
    It rises with both coefficients and falls with the masses.
    """
    first, second = (outer + inner) / m1, inner / m2
    both = inner / math.sqrt(m1) / math.sqrt(m2)
    return 0.5 * (first + second) + math.hypot(0.5 * (first - second), both)


@inlined_kernel
def fastest_rate(m1, m2, k1, k2, c, d):
    """Return a bound of the linear motion's rates [1/s]: of the spectral norm of A.

    With positions scaled by the root of stiffness and velocities by the root of mass, A is the skew
    matrix of the undamped motion minus the scaled damping; the norm of A is at most the sum of
    theirs.

    A stiffness k1 < 0 has the bound of -k1: the stiffness matrix with k1 lies between those with
    k1 - |k1| and |k1|, of which the latter has the larger norm.

    Parameters
    ----------
    m1, m2
        Masses [kg] of carriage and sphere.
    k1, k2
        Stiffness [N/m] of the carriage's spring, of either sign, and of the sphere's.
    c, d
        Damping [N s/m] of the interface, and of the carriage.
    """
    return math.sqrt(largest_eigenvalue(m1, m2, abs(k1), k2)) + largest_eigenvalue(m1, m2, d, c)


@inlined_kernel
def fastest_harmonic(p, harmonics):
    """Return the highest frequency [rad/s] of a lane's harmonics; p (rows,) is the lane."""
    fastest = 0.0
    for j in range(harmonics):
        fastest = max(fastest, p[layout.HARMONICS + layout.HARMONIC_ROWS * j + layout.FREQUENCY])
    return fastest
