"""The laws of the forces, one function each: docs/model.md, eqs 1 to 6, 9 and 10.

All methods, observations, energies and analyses take them from here. What is written in plain
numbers also serves decimals and arrays, see `mm_gym.compiler.jit.plain`.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.memory import span

REGIMES_READ = at.VR, at.MU1, at.MU2, at.FN
REGIMES_WRITTEN = at.C, at.KINETIC_FORCE
"""Rows of `write_regimes`."""


@inlined_kernel
def carriage_force(k1, alpha, beta, x1):
    """Return the force [N] that the carriage's spring resists a displacement x1 [m] with."""
    return k1 * (alpha + beta * x1 * x1) * x1  # (1) of docs/model.md


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


@inlined_kernel
def stiffness(k0, stretch):
    """Return k2 [N/m] of springs small on large; of springs of finite stretch, at the middle."""
    return 2 * k0 * (1 + 2 / (stretch * stretch * stretch))  # (5), eqs 15 and 16 of the paper


@inlined_kernel
def spring_force(k0, l0, stretch, offset):
    """Return the force [N] of the sphere's springs on the carriage; l0 is 0 if small on large."""
    if k0 == 0.0:
        return 0.0  # and not -0.0
    if l0 == 0.0:
        return stiffness(k0, stretch) * offset
    return pair_force(k0, l0, stretch, offset)


@inlined_kernel
def pair_force(k0, l0, stretch, offset):
    """Return the force [N] of the neo-Hookean pair of finite stretch on the carriage.

    There is no difference of the two sides' nearly equal stretches in it.
    """
    shortened = offset / l0
    product = stretch * stretch - shortened * shortened  # of both sides' stretches
    return 2.0 * k0 * offset * (1.0 + 2.0 * stretch / (product * product))  # (6)


@inlined_kernel
def spring_energy(k0, l0, stretch, offset):
    """Return the energy [J] of the sphere's springs in excess of the centred sphere's.

    The integral of `spring_force` over the offset, without differences of nearly equal numbers.
    """
    shortened = (offset / l0) ** 2 if l0 else 0.0
    return k0 * offset**2 * (1.0 + 2.0 / (stretch * (stretch**2 - shortened)))  # (10)


@inlined_kernel
def stick_slope(mu1, normal, vr):
    """Return the slope [N s/m] of dry friction while the sphere sticks, in truth creeps."""
    return mu1 * normal / vr  # (4), eq. 9 of the paper, |w| <= v_r


@inlined_kernel
def kinetic_force(mu2, normal):
    """Return the force [N] of dry friction where slip begins."""
    return mu2 * normal  # (4), eq. 9 of the paper, |w| = v_r from above


@inlined_kernel
def slip_intercept(kinetic, chi, vr):
    """Return the force [N] at w = 0 of the line that friction follows in slip to positive w."""
    return kinetic - chi * vr  # (4), eq. 9 of the paper, |w| > v_r: intercept + chi |w|


@borrowing_kernel
def write_regimes(lanes, first, last):
    """Write what (4) comes to in the lanes first .. last - 1: rows C and KINETIC_FORCE.

    So an interface is one slope C up to the slip velocity VR, none if that is 0, and beyond it
    KINETIC_FORCE and a slope CHI. Every episode begins with this; kernels read these rows alone.
    """
    if lanes[at.VR, first] == 0.0:  # all lanes of a scene have an interface of one kind
        return
    for i in span(first, last):
        lanes[at.C, i] = stick_slope(lanes[at.MU1, i], lanes[at.FN, i], lanes[at.VR, i])
        lanes[at.KINETIC_FORCE, i] = kinetic_force(lanes[at.MU2, i], lanes[at.FN, i])


@inlined_kernel
def interface_force(c, vr, kinetic, chi, w):
    """Return the force [N] of the interface on the carriage at a slip velocity w [m/s].

    The arguments before w are the rows that `write_regimes` speaks of.
    """
    if vr == 0.0 or abs(w) <= vr:
        return c * w  # (3), or (4) in stick
    force = kinetic + chi * (abs(w) - vr)  # (4) in slip
    return force if w > 0.0 else -force


@inlined_kernel
def interface_line(regime, c, chi, intercept):
    """Return slope [N s/m] and force [N] at w = 0 of the interface in one regime.

    The regime is the direction of slip, 1 or -1, or 0 for stick; the intercept is `slip_intercept`.
    """
    if regime == 0.0:
        return c, 0.0
    return chi, regime * intercept


@inlined_kernel
def threshold(vr):
    """Return the slip velocity [m/s] at which the regime changes; infinite without friction."""
    return vr if vr > 0.0 else math.inf


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
        fastest = max(fastest, p[at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY])
    return fastest
