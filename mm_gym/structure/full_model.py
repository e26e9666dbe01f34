"""The whole structure with the device on it, integrated without the kernels of mm_gym.

The state is q (n), x2, their velocities in the same order, and the interface's own state last, if
it has one. Displacements are relative to the ground.
"""

# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# SciPy's linear algebra is typed in part only

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError, StructureError
from mm_gym.law import INTERFACES, dry_friction, springs
from mm_gym.scene.mechanics import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene
    from mm_gym.structure.reduction import Reduction

    Array = NDArray[np.float64]

TOLERANCE = 1e-8
"""Relative tolerance of the integration of a nonlinear device: far below what a reduction leaves
out, which is some percent."""

MOST_EVALUATIONS = 3_000_000
"""Of the rates of a nonlinear device: some minutes."""

SAME_TIME = 1e-12
"""Difference of two instants, relative to the last, that is round-off."""

DIGITS = 12
"""Steps of a linear motion that agree to as many digits share a transition matrix."""


@dataclass(frozen=True)
class Motion:
    """Motion of the structure and its device.

    Attributes
    ----------
    displacement
        (k, n) of the degrees of freedom [m], relative to the ground.
    stroke
        (k,) of the device relative to the structure [m].
    acceleration
        (k,) absolute, of the device's degree of freedom [m/s^2].
    """

    displacement: Array
    stroke: Array
    acceleration: Array


class FullModel:
    """A structure with the device of a scene.

    Parameters
    ----------
    reduction
        The reduction that the scene was made from.
    scene
        The scene, whose sphere, interface and springs are the device.
    """

    def __init__(self, reduction: Reduction, scene: Scene) -> None:
        structure = reduction.structure
        self.place = reduction.device - 1
        self.count = structure.count
        self.reduction = reduction
        self.m2 = scene.sphere.mass
        self.by_mass = np.linalg.inv(structure.mass)
        self.stiffness, self.damping = structure.stiffness, structure.damping
        self.device = Device(scene)
        self.ground = -np.append(structure.influence, reduction.ground)

    def motion(self, times: Array, ground: Array) -> Motion:
        """Return the motion at evenly spaced times (k,) [s] that begin at 0.

        Parameters
        ----------
        times
            (k,) [s].
        ground
            (m, 2) times [s] and accelerations [m/s^2], linear in between, zero outside.

        Raises
        ------
        SimulationError
            If SciPy cannot integrate a nonlinear device, or the motion is not finite.
        """
        stops = _stops(times, ground)
        follow = self._propagate if self.device.is_linear else self._integrate
        states = follow(stops, ground)
        states = states[np.searchsorted(stops, times)]
        if not np.isfinite(states).all():
            msg = "full model: the motion is not finite"
            raise SimulationError(msg)
        n, j = self.count, self.place
        inner = np.array([self._inner(state) for state in states])
        q, v = states[:, :n], states[:, n + 1 : 2 * n + 1]
        resisting = q @ self.stiffness + v @ self.damping
        resisting[:, j] -= inner
        return Motion(q, states[:, n] - q[:, j], -(resisting @ self.by_mass)[:, j])

    def _start(self) -> Array:
        (x1, x2, v1, v2), shape = self.device.initial, self.reduction.shape
        own = np.zeros(self.device.states)
        return np.concatenate([shape * x1, [x2], shape * v1, [v2], own])

    def _inner(self, state: Array) -> float:
        """Return the device's force [N] on the structure."""
        n, j = self.count, self.place
        offset, slip = state[n] - state[j], state[2 * n + 1] - state[n + 1 + j]
        return self.device.force(offset, slip, state[-1])

    def rates(self, state: Array, ground: float) -> Array:
        """Return the rates of the state under an acceleration of the ground [m/s^2]."""
        n, j = self.count, self.place
        inner = self._inner(state)
        q, v = state[:n], state[n + 1 : 2 * n + 1]
        resisting = self.stiffness @ q + self.damping @ v
        resisting[j] -= inner
        accelerations = np.append(-self.by_mass @ resisting, -inner / self.m2)
        own = self.device.rate(state[n] - state[j], state[2 * n + 1] - v[j], state[-1])
        both = [state[n + 1 : 2 * n + 2], accelerations + self.ground * ground, own]
        return np.concatenate(both)

    def _propagate(self, stops: Array, ground: Array) -> Array:
        """Return the states of a linear device: exact under ground motion linear in each step."""
        size = 2 * self.count + 2
        generator = np.zeros((size + 2, size + 2))
        generator[:size, :size] = np.column_stack([self.rates(e, 0.0) for e in np.eye(size)])
        generator[self.count + 1 : size, size] = self.ground
        generator[size, size + 1] = 1.0
        begins, ends = _sampled(stops, ground)
        transitions: dict[float, Array] = {}
        states = np.empty((len(stops), size))
        states[0] = self._start()
        for k, step in enumerate(np.diff(stops)):
            rounded = float(f"{step:.{DIGITS}g}")
            if rounded not in transitions:
                transitions[rounded] = np.asarray(expm(generator * rounded)[:size], np.float64)
            slope = (ends[k] - begins[k]) / rounded
            states[k + 1] = transitions[rounded] @ np.array([*states[k], begins[k], slope])
        return states

    def _integrate(self, stops: Array, ground: Array) -> Array:
        """Return the states of a nonlinear device, by SciPy from stop to stop at most."""
        (times, values), spent = ground.T, count(1)

        def field(time: float, state: Array) -> Array:
            if next(spent) > MOST_EVALUATIONS:
                msg = (
                    f"full model: gave up at {time:g} s, after {MOST_EVALUATIONS} evaluations; "
                    "the interface is too stiff for SciPy's integrator"
                )
                raise SimulationError(msg)
            return self.rates(state, float(np.interp(time, times, values, left=0.0, right=0.0)))

        start = self._start()
        largest = max(float(np.abs(ground[:, 1]).max()), 1e-12)
        # Displacements of the size that the ground's peak would cause at the slowest frequency.
        scale = largest / float(self.reduction.structure.frequencies[0]) ** 2
        solution = cast(
            "Any",
            solve_ivp(
                field,
                (float(stops[0]), float(stops[-1])),
                start,
                "LSODA",
                t_eval=stops,
                rtol=TOLERANCE,
                atol=TOLERANCE * scale,
                max_step=float(np.diff(stops).max()),  # or it would step over a pulse
            ),
        )
        if solution.status < 0:
            msg = f"full model: {solution.message}"
            raise SimulationError(msg)
        return np.asarray(solution.y.T, np.float64)


class Device:
    """The force that a scene's interface and springs exert on the carriage, and their start.

    Attributes
    ----------
    initial
        (4,) x1, x2 [m], v1, v2 [m/s] at the start.
    is_linear
        Whether the force is linear in the state.
    states
        1 if the interface has a state of its own, otherwise 0.
    """

    def __init__(self, scene: Scene) -> None:
        start, pair, interface = scene.initial, scene.springs, scene.interface
        x1, v1 = cast("float", start.carriage_displacement), cast("float", start.carriage_velocity)
        offset, v2 = cast("float", start.sphere_offset), cast("float", start.sphere_velocity)
        self.initial = np.array([x1, x1 + offset, v1, v2])
        _check_kind("interface", interface.kind, ("none", "viscous", "dry_friction", *INTERFACES))
        _check_kind("springs", pair.kind, ("none", "linear", "small_on_large", "finite_stretch"))
        self._springs, self._cubic = _springs_of(scene)
        smooth = interface.kind in ("none", "viscous") and self._cubic == 0.0
        self.is_linear = smooth and pair.kind != "finite_stretch"
        self._spring_force = plain(springs.spring_force)
        known = INTERFACES.get(interface.kind)
        self.states = int(known is not None and known.has_state)
        self._force = _line(scene) if known is None else plain(known.force)
        self._rate = plain(known.rate) if known is not None and known.rate else None
        self._own = [] if known is None else [_value(scene, name) for name in known.parameters]

    def force(self, offset: float, slip: float, own: float) -> float:
        """Return the force [N] at an offset [m], a slip velocity [m/s] and the own state [-]."""
        pair = self._spring_force(*self._springs, offset) * (1.0 + self._cubic * offset**2)
        return pair + self._force(self._own, offset, slip, own)

    def rate(self, offset: float, slip: float, own: float) -> Array:
        """Return the rate [1/s] of the own state, (states,)."""
        if self._rate is None:
            return np.empty(0)
        return np.array([self._rate(self._own, offset, slip, own)])


def _springs_of(scene: Scene) -> tuple[tuple[float, float, float], float]:
    """Return k0 [N/m], l0 [m] and stretch of the springs, and their cubic coefficient [1/m^2]."""
    pair, start = scene.springs, scene.initial.stretch
    if pair.kind == "none":
        return (0.0, 0.0, 1.0), 0.0
    if pair.kind == "linear":
        return (pair.stiffness, 0.0, springs.LINEAR), pair.cubic_coefficient
    length = pair.rest_length if pair.kind == "finite_stretch" else 0.0
    return (pair.stiffness, length, pair.stretch if start is None else cast("float", start)), 0.0


def _check_kind(name: str, kind: str, known: tuple[str, ...]) -> None:
    if kind not in known:
        msg = f"{name}.kind: got {kind!r}; allowed in a comparison: {', '.join(known)}"
        raise StructureError(msg)


def _value(scene: Scene, name: str) -> float:
    """Return a field of the interface; the normal force is the weight unless it is given."""
    value = getattr(scene.interface, name)
    return scene.sphere.mass * GRAVITY if value is None else value


def _line(scene: Scene) -> Callable[..., float]:
    """Return the force of an interface that is a line in each regime."""
    interface, law = scene.interface, plain(dry_friction.interface_force)
    slope, vr, kinetic, chi = 0.0, 0.0, 0.0, 0.0
    if interface.kind == "viscous":
        slope = interface.damping
    elif interface.kind == "dry_friction":
        normal, vr = _value(scene, "normal_force"), interface.reference_velocity
        slope = plain(dry_friction.stick_slope)(interface.static_coefficient, normal, vr)
        kinetic = plain(dry_friction.kinetic_force)(interface.kinetic_coefficient, normal)
        chi = interface.slip_damping

    def force(_own: object, _offset: float, slip: float, _state: float) -> float:
        return law(slope, vr, kinetic, chi, slip)

    return force


def _stops(times: Array, ground: Array) -> Array:
    """Return the times, and the corners of the ground's motion between them."""
    corners = ground[(ground[:, 0] > times[0]) & (ground[:, 0] < times[-1]), 0]
    after = np.clip(np.searchsorted(times, corners), 1, len(times) - 1)
    gap = np.minimum(np.abs(corners - times[after - 1]), np.abs(corners - times[after]))
    return np.sort(np.concatenate([times, corners[gap > SAME_TIME * times[-1]]]))


def _sampled(stops: Array, ground: Array) -> tuple[Array, Array]:
    """Return the ground's acceleration at the beginning and end of each step between stops."""
    times, values = ground.T
    near = SAME_TIME * stops[-1]
    moves = (stops[:-1] >= times[0] - near) & (stops[1:] <= times[-1] + near)
    at_stops = np.interp(stops, times, values)
    return at_stops[:-1] * moves, at_stops[1:] * moves
