"""The motion about a point, with the inputs of actuators, disturbance and ground.

The laws are (1) to (6) of docs/model.md and their slopes.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Context, Decimal, localcontext
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import CompileError, refuse
from mm_gym.lanes import layout
from mm_gym.law import carriage_spring, dry_friction, springs
from mm_gym.law.interface import Interface
from mm_gym.methods.support import Support
from mm_gym.state_space.equations import state_space, values_of
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS

Decimals = NDArray[np.object_]

DRIVERS = ("force", "stretch", "damping", "voltage", "disturbance", "ground", "one")
"""What drives the motion, in the order of the columns of `Tangent.drivers`; one is constant."""


class Tangent(NamedTuple):
    """The motion x' = A x + drivers d about a point, in decimals."""

    a: Decimals  # (4, 4), for deviations of x1, x2, v1, v2
    drivers: Decimals  # (4, 7), see `DRIVERS`; the last is the motion at the point itself
    spring: tuple[float, float]  # slopes of the springs' force over offset [N/m] and stretch [N]
    spring_force: float  # on the carriage at the point [N]


ROUND_OFF = 1e-12  # what is left of a slope that is 0


@cache
def _slopes_with(interface: Interface) -> Callable[..., None]:
    from mm_gym.sensitivity.tangent_kernel import slopes_with  # noqa: PLC0415 - few need it

    return slopes_with(interface)


class InterfaceSlopes(NamedTuple):
    """An interface in value form at a point; 0 of any other."""

    force: float = 0.0  # on the carriage [N]
    damping: float = 0.0  # slope of the force over the slip velocity [N s/m]
    stiffness: float = 0.0  # over the offset [N/m]
    spring_force: float = 0.0  # what of the force is that of springs
    spring_stiffness: float = 0.0
    over_held: float = 0.0  # over the parameter that an actuator holds, if it is the interface's


def interface_slopes(support: Support, row: Array) -> InterfaceSlopes:
    """Return the slopes of an interface in value form, at the state of a lane (rows,).

    States of its own are 0 at the point, and follow motions that are small and slow; a point at
    which they would leave 0 by themselves is refused.
    """
    if not support.is_general:
        return InterfaceSlopes()
    found, interface = np.zeros((4, 6)), support.interface
    point = np.array([row[layout.X2] - row[layout.X1], row[layout.V2] - row[layout.V1], 0.0, 0.0])
    rows = support.interface_rows
    held = rows.index(support.damped_row) if support.damped_row in rows else -1
    _slopes_with(interface)(row[list(rows)], held, point, found)
    force, stiffness, damping, *over_own, over_held = found[0].tolist()
    own = slice(2, 2 + len(interface.states))
    by_own, by_motion = found[own, 1:][:, own], found[own, 1:3]
    moved = np.abs(by_motion[:, 1] * point[1]).max(initial=0.0)
    if point[1] != 0.0 and np.abs(by_own).max(initial=0.0) > ROUND_OFF * moved:
        relaxes = f"at which the state of interface.kind = {interface.kind!r} relaxes"
        refuse("about", f"a slip velocity of {point[1]:g} m/s, {relaxes}", "0")
    follows = np.array(over_own)[: len(by_own)] @ _following(by_own, by_motion)
    stiffness, damping = stiffness + float(follows[0]), damping + float(follows[1])
    of_springs = float(found[1, 0]), float(found[1, 1])
    return InterfaceSlopes(force, damping, stiffness, *of_springs, over_held)


def _following(by_own: Array, by_motion: Array) -> Array:
    """Return how states s of their own (n,) follow slow motions, over offset and slip, (n, 2).

    The power series of their response s = X0 + X1 p + ... to an offset exp(p t), in p: with
    s' = D s + (a + b p) exp(p t), -D X0 = a, X0 - D X1 = b and X1 - D X2 = 0. Where D has no
    inverse, the equation of the next order says what one leaves open.
    """
    n = len(by_own)
    none, one = np.zeros((n, n)), np.eye(n)
    orders = np.block([[-by_own, none, none], [one, -by_own, none], [none, one, -by_own]])
    given = np.concatenate([by_motion[:, 0], by_motion[:, 1], np.zeros(n)])
    found = np.asarray(np.linalg.lstsq(orders, given)[0], np.float64)
    return np.column_stack([found[:n], found[n : 2 * n]])


def values_about(support: Support, row: Array) -> dict[str, Decimal]:
    """Return `values_of` a lane, an interface in value form by its slopes."""
    values = values_of(row)
    link = interface_slopes(support, row)
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        values["c"] += Decimal(link.damping)
        values["k2"] += Decimal(link.stiffness)
    return values


def tangent(support: Support, row: Array) -> Tangent:
    """Return the motion about the state that a lane (rows,) is in."""
    if row[layout.M1] == 0.0:
        msg = "carriage.mass: 0 leaves three states; state_space needs some mass"
        raise CompileError(msg)
    x1, x2, v1, v2 = (float(value) for value in row[:4])
    offset, w = x2 - x1, v2 - v1
    values = values_of(row)
    link = interface_slopes(support, row)
    beta, vr = float(row[layout.BETA]), float(row[layout.VR])
    over_offset, over_stretch = _spring_slopes(row, offset)
    if row[layout.L0] > 0.0:
        values["k2"] = Decimal(over_offset)
    if vr > 0.0 and abs(w) > vr:
        values["c"] = Decimal(float(row[layout.CHI]))
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        values["c"] += Decimal(link.damping)
        values["k2"] += Decimal(link.stiffness)
        k1 = Decimal(float(row[layout.K1]))
        values["k1"] += 3 * k1 * Decimal(beta) * Decimal(x1) ** 2  # the slope of (1)
        system = state_space(values)
        m1, m2 = values["m1"], values["m2"]
        slope = Decimal(over_stretch)
        zero = 0 * m1
        stretch = np.array([zero, zero, slope / m1, -slope / m2])
        force, spring_force = _forces(row, link.force)
        moving = [v1, v2, force[0] / float(m1), force[1] / float(m2)]
        one = np.array([Decimal(value) for value in moving])
        control = system.control(is_between=support.is_between)
        # The slope of c w, of -d v1, or of the interface's force, over what is actuated.
        speeds = {layout.D: (system.force, -v1), layout.C: (system.pair, w)}
        column, speed = speeds.get(support.damped_row, (system.pair, link.over_held))
        held = {support.device: column * Decimal(speed)}
        devices = [held.get(name, 0 * column) for name in ("damping", "voltage")]
        drivers = np.column_stack([control, stretch, *devices, system.force, system.ground, one])
    slopes = over_offset + link.spring_stiffness, over_stretch
    return Tangent(system.a, drivers, slopes, spring_force + link.spring_force)


def _spring_slopes(row: Array, offset: float) -> tuple[float, float]:
    """Return the slopes of the springs' force over the offset [N/m] and over the stretch [N]."""
    k0, l0, stretch = (float(row[k]) for k in (layout.K0, layout.L0, layout.STRETCH))
    if l0 == 0.0:  # (5)
        return float(plain(springs.stiffness)(k0, stretch)), -12.0 * k0 * offset / stretch**4
    square = (offset / l0) ** 2
    product = stretch**2 - square  # (6)
    return (
        2.0 * k0 * (1.0 + 2.0 * stretch / product**2 + 8.0 * stretch * square / product**3),
        4.0 * k0 * offset * (1.0 / product**2 - 4.0 * stretch**2 / product**3),
    )


def _forces(row: Array, link: float) -> tuple[tuple[float, float], float]:
    """Return the forces [N] on both masses at the point, and the springs' on the carriage."""
    x1, x2, v1, v2 = (float(value) for value in row[:4])
    k0, l0, stretch = (float(row[k]) for k in (layout.K0, layout.L0, layout.STRETCH))
    held = float(plain(springs.spring_force)(k0, l0, stretch, x2 - x1))
    c, vr, kinetic, chi = (
        float(row[k]) for k in (layout.C, layout.VR, layout.KINETIC_FORCE, layout.CHI)
    )
    inner = float(plain(dry_friction.interface_force)(c, vr, kinetic, chi, v2 - v1)) + link + held
    k1, alpha, beta, d = (float(row[k]) for k in (layout.K1, layout.ALPHA, layout.BETA, layout.D))
    outer = -d * v1 - float(plain(carriage_spring.carriage_force)(k1, alpha, beta, x1))
    return (inner + outer, -inner), held
