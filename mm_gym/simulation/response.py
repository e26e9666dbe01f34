"""Accelerations, base force and channels of a trajectory, from its states and what acts on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout
from mm_gym.law import carriage_spring, dry_friction, springs
from mm_gym.law.interface import MOST_STATES
from mm_gym.methods.support import Support


def spring_force(support: Support, p: Array, state: Array, stretch: Array) -> Array:
    """Return the force (n,) [N] of the sphere's springs, of some stretch, on the carriage."""
    return _stretched(p, state, stretch) + _by_value(support, support.interface.springs, p, state)


def _stretched(p: Array, state: Array, stretch: Array) -> Array:
    """Return the same (n,) [N] of springs that are no part of the interface."""
    force = plain(springs.spring_force)(
        p[layout.K0], p[layout.L0], stretch, state[:, 1] - state[:, 0]
    )
    return np.broadcast_to(force, len(state)).astype(np.float64)


def interface_force(support: Support, p: Array, state: Array) -> Array:
    """Return the force (n,) [N] of the interface on the carriage.

    Parameters
    ----------
    support
        All values that the scene can reach.
    p
        (rows,) the lane's parameters, or (rows, n) those at each state.
    state
        (n, 4) x1, x2 [m], v1, v2 [m/s], with the interface's own states behind them.
    """
    if support.is_general:
        return _by_value(support, support.interface.force, p, state)
    slip = state[:, 3] - state[:, 2]
    c, vr, chi = p[layout.C], float(np.max(p[layout.VR])), p[layout.CHI]
    intercept = plain(dry_friction.slip_intercept)(p[layout.KINETIC_FORCE], chi, vr)
    regime = np.where(np.abs(slip) <= plain(dry_friction.threshold)(vr), 0.0, np.sign(slip))
    force = np.empty(len(slip))
    for side in (-1.0, 0.0, 1.0):
        slope, constant = plain(dry_friction.interface_line)(side, c, chi, intercept)
        force = np.where(regime == side, slope * slip + constant, force)
    return force


def interface_energy(support: Support, p: Array, state: Array) -> Array:
    """Return the energy (n,) [J] that the interface can give back; see `interface_force`."""
    return _by_value(support, support.interface.energy, p, state)


def _by_value(support: Support, kernel: Callable[..., Any], p: Array, state: Array) -> Array:
    """Return what a kernel of the interface says (n,); see `interface_force`."""
    own, slip = np.zeros((MOST_STATES, len(state))), state[:, 3] - state[:, 2]
    own[: state.shape[1] - 4] = state[:, 4:].T
    rows, offset = p[list(support.interface_rows)], state[:, 1] - state[:, 0]
    return np.zeros(len(state)) + plain(kernel)(rows, offset, slip, tuple(own))


def damped(support: Support, p: Array, applied: Array) -> Array:
    """Return the parameters (rows,), or (rows, n) with what a device holds at n instants."""
    if not support.damped_row:
        return p
    each = np.tile(p[:, None], (1, len(applied)))
    each[support.damped_row] = applied[:, 2]
    return each


def base_force(support: Support, p: Array, state: Array, applied: Array) -> Array:
    """Return the force (n,) [N] on the base.

    It is that of the carriage's spring and damper, and the reaction to the control force if its
    actuator stands on the base. Arguments are those of `acceleration`.
    """
    x1, v1, p = state[:, 0], state[:, 2], damped(support, p, applied)
    spring = plain(carriage_spring.carriage_force)(
        p[layout.K1], p[layout.ALPHA], p[layout.BETA], x1
    )
    own = spring + p[layout.D] * v1
    return own if support.is_between else own - applied[:, 0]


def acceleration(
    support: Support, p: Array, state: Array, applied: Array, disturbance: Array
) -> Array:
    """Return the absolute accelerations (n, 2) [m/s^2] of carriage and sphere, (1) and (2).

    Parameters
    ----------
    support, p, state
        As for `interface_force`.
    applied, disturbance
        (n, 2) force [N] and stretch [-], or (n, 3) with damping or voltage behind them; (n,)
        disturbing force [N].
    """
    if p[layout.M1] == 0.0:
        msg = "carriage.mass: 0 has no finite acceleration; give it some mass"
        raise SimulationError(msg)
    inner = interface_force(support, damped(support, p, applied), state)
    inner = inner + _stretched(p, state, applied[:, 1])
    outer = disturbance - base_force(support, p, state, applied)
    if support.is_between:
        inner = inner + applied[:, 0]
    return np.column_stack([(inner + outer) / p[layout.M1], -inner / p[layout.M2]])


def root_mean_square(time: Array, values: Array) -> float:
    """Return the root of the mean of the square over time, whose instants need not be even."""
    if len(time) == 1:
        return float(abs(values[0]))
    area = np.sum(0.5 * np.diff(time) * (values[1:] ** 2 + values[:-1] ** 2))
    return float(np.sqrt(area / (time[-1] - time[0])))
