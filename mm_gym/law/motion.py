"""The equations of motion: (1) and (2) of docs/model.md, over every kind of number.

A number is a float, a vector of lanes, or an array.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.groups import read
from mm_gym.law.carriage_spring import secant
from mm_gym.law.springs import pair_force, stiffness


class Coefficients(NamedTuple):
    """What the equations of motion read of a lane's parameters, in SI units.

    Attributes
    ----------
    by_m1, by_m2
        1 / m1 and 1 / m2 [1/kg].
    linear, cubic
        k1 alpha [N/m] and k1 beta [N/m^3] of the carriage's spring.
    d
        Damping of the carriage [N s/m].
    k2
        Stiffness of springs small on large [N/m].
    twice_k0, by_l0, stretch
        2 k0 [N/m], 1 / l0 [1/m] and stretch of springs of finite stretch.
    """

    by_m1: Any
    by_m2: Any
    linear: Any
    cubic: Any
    d: Any
    k2: Any
    twice_k0: Any
    by_l0: Any
    stretch: Any


@inlined_kernel
def coefficients(m1, m2, k1, alpha, beta, d, k2, k0, by_l0, stretch):
    """Return what the equations read.

    Parameters
    ----------
    m1, m2, k1, alpha, beta, d, k0, stretch
        Parameters of a lane.
    k2
        Stiffness of springs small on large [N/m]; with finite stretch nothing reads it.
    by_l0
        1 / l0 [1/m]; without finite stretch nothing reads it.
    """
    return Coefficients(1.0 / m1, 1.0 / m2, k1 * alpha, k1 * beta, d, k2, k0 + k0, by_l0, stretch)


@inlined_kernel
def read_coefficients(lanes, i, count):
    """Return the coefficients of the lanes i .. i + count - 1 of (rows, count) lanes."""
    k0, stretch = read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count)
    k2, by_l0 = k0, k0
    if lanes[layout.L0, i] > 0.0:  # in all lanes or none; what nothing reads costs no division
        by_l0 = 1.0 / read(lanes, layout.L0, i, count)
    else:
        k2 = stiffness(k0, stretch)
    return coefficients(
        read(lanes, layout.M1, i, count),
        read(lanes, layout.M2, i, count),
        read(lanes, layout.K1, i, count),
        read(lanes, layout.ALPHA, i, count),
        read(lanes, layout.BETA, i, count),
        read(lanes, layout.D, i, count),
        k2,
        k0,
        by_l0,
        stretch,
    )


@inlined_kernel
def control_forces(model, force):
    """Return what a control force adds to that between the masses, and to that on the carriage.

    One of both is 0. Added to the interface's force at rest, the first costs a method nothing.

    Parameters
    ----------
    model
        (m,) read.
    force
        That of the actuator [N], a number or a vector of lanes.
    """
    inner = model[layout.BETWEEN] * force
    return inner, force - inner


@inlined_kernel
def rates(p, is_finite, x1, offset, v1, link, push, shake):
    """Return the accelerations [m/s^2] of carriage and sphere.

    Parameters
    ----------
    p
        `Coefficients`.
    is_finite
        Whether the sphere's springs are of finite stretch.
    x1, offset
        Displacement of the carriage, and of the sphere relative to it [m].
    v1
        Velocity of the carriage [m/s].
    link
        Force of the interface on the carriage [N].
    push, shake
        Force on the carriage [N], and acceleration of the ground [m/s^2].
    """
    if is_finite:
        springs = pair_force(p.twice_k0, p.stretch, offset, offset * p.by_l0)  # (6)
    else:
        springs = p.k2 * offset  # (5)
    inner = link + springs
    outer = fma(secant(p.linear, p.cubic, x1), x1, fma(p.d, v1, -push))
    return fma(inner - outer, p.by_m1, -shake), fma(-inner, p.by_m2, -shake)
