"""The whole structure with the device on it, integrated without the methods of mm_gym.

The state is q (n), x2, their velocities in the same order, and the interface's own states last, if
it has one. Displacements are relative to the ground.
"""

# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# SciPy's linear algebra is typed in part only

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError, StructureError
from mm_gym.lanes import layout
from mm_gym.law import springs
from mm_gym.law.dry_friction import interface_force
from mm_gym.law.interface import MOST_STATES
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.support_of import lane_of, support_of
from mm_gym.simulation.simulate import commands_of
from mm_gym.step.task import steer

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.simulate import Policy
    from mm_gym.structure.structure import Reduction

TOLERANCE = 1e-8
"""Relative tolerance of the integration of a nonlinear device: far below what a reduction leaves
out, which is some percent."""

MOST_EVALUATIONS = 3_000_000  # of the rates of a nonlinear device: some minutes
SAME_TIME = 1e-12  # difference of two instants, relative to them, that is round-off
DIGITS = 12  # steps of a linear motion that agree to as many digits share a transition matrix

SPRINGS = [layout.K0, layout.L0, layout.STRETCH]
HELD = [layout.FORCE, layout.DAMPING]
LINE = [layout.C, layout.VR, layout.KINETIC_FORCE, layout.CHI]
"""Rows of a lane: what `spring_force` takes, what actuators hold, what `interface_force` takes."""


@dataclass(frozen=True)
class Motion:
    """Motion of the structure and its device."""

    displacement: Array  # (k, n) of the degrees of freedom [m], relative to the ground
    stroke: Array  # (k,) of the device relative to the structure [m]
    acceleration: Array  # (k,) absolute, of the device's degree of freedom [m/s^2]


class FullModel:
    """A structure with the device of a scene: its sphere, interface, springs and actuators.

    Commands are as for `mm_gym.simulate`; a function of time and state gets x1 and v1 of the
    device's degree of freedom. `StructureError` refuses them for a device that is not linear.
    """

    def __init__(
        self, reduction: Reduction, scene: Scene, action: ArrayLike | Policy | None = None
    ) -> None:
        structure = reduction.structure
        self.place = reduction.device - 1
        self.count = structure.count
        self.reduction = reduction
        self.m2 = scene.sphere.mass
        self.by_mass = np.linalg.inv(structure.mass)
        self.stiffness, self.damping = structure.stiffness, structure.damping
        self.device = Device(scene)
        self.ground = -np.append(structure.influence, reduction.ground)
        self.push = np.append(self.by_mass[:, self.place], 0.0)
        if scene.actuation.is_between:
            self.push[-1] = -1.0 / self.m2
        self.control = None if action is None else Control(scene, action, self.device.lane)
        if self.control is not None and not self.device.is_linear:
            msg = "action: the device is not linear; allowed: None"
            raise StructureError(msg)

    def motion(self, times: Array, ground: Array) -> Motion:
        """Return the motion at increasing times (k,) [s] that begin at 0.

        The ground (m, 2) has times [s] and accelerations [m/s^2], linear in between, zero outside.
        """
        corners = ground[:, 0]
        if self.control is not None:
            corners = np.concatenate([corners, self.control.starts(float(times[-1]))])
        stops = _stops(times, corners)
        held = np.zeros((len(stops), 2))
        if self.device.is_linear:
            states = self._propagate(stops, ground, held)
        else:
            states = self._integrate(stops, ground)
        chosen = np.searchsorted(stops, times)
        states, held = states[chosen], held[chosen]
        if not np.isfinite(states).all():
            msg = "full model: the motion is not finite"
            raise SimulationError(msg)
        n, j = self.count, self.place
        inner = np.array([self._inner(*both) for both in zip(states, held[:, 1], strict=True)])
        q, v = states[:, :n], states[:, n + 1 : 2 * n + 1]
        resisting = q @ self.stiffness + v @ self.damping
        resisting[:, j] -= inner + held[:, 0]
        return Motion(q, states[:, n] - q[:, j], -(resisting @ self.by_mass)[:, j])

    def _start(self) -> Array:
        (x1, x2, v1, v2), shape = self.device.lane[:4], self.reduction.shape
        own = np.zeros(self.device.states)
        return np.concatenate([shape * x1, [x2], shape * v1, [v2], own])

    def _inner(self, state: Array, more: float = 0.0) -> float:
        """Return the force [N] of springs and interface, with more damping [N s/m] than its own."""
        n, j = self.count, self.place
        offset, slip = state[n] - state[j], state[2 * n + 1] - state[n + 1 + j]
        return self.device.force(offset, slip, state[2 * n + 2 :]) + more * slip

    def rates(self, state: Array, ground: float, more: float = 0.0) -> Array:
        """Return the rates of the state under an acceleration of the ground [m/s^2].

        The interface has more damping [N s/m] than its own, if that is actuated.
        """
        n, j = self.count, self.place
        inner = self._inner(state, more)
        q, v = state[:n], state[n + 1 : 2 * n + 1]
        resisting = self.stiffness @ q + self.damping @ v
        resisting[j] -= inner
        accelerations = np.append(-self.by_mass @ resisting, -inner / self.m2)
        slip = state[2 * n + 1] - v[j]
        own = self.device.rates(state[n] - state[j], slip, state[2 * n + 2 :])
        both = [state[n + 1 : 2 * n + 2], accelerations + self.ground * ground, own]
        return np.concatenate(both)

    def _propagate(self, stops: Array, ground: Array, held: Array) -> Array:
        """Return a linear device's states; `held` (k, 2) gets the force [N] and added damping."""
        begins, ends = _sampled(stops, ground)
        transitions: dict[tuple[float, float], Array] = {}
        states = np.empty((len(stops), 2 * self.count + 2))
        states[0] = self._start()
        seen = [self.place, self.count, self.count + 1 + self.place, 2 * self.count + 1]
        for k, step in enumerate(np.diff(stops)):
            if self.control is not None:
                held[k:] = self.control.at(float(stops[k]), states[k, seen])
            force, more = held[k]
            rounded = float(f"{step:.{DIGITS}g}")
            if (rounded, more) not in transitions:
                transitions[rounded, more] = self._transition(rounded, more)
            slope = (ends[k] - begins[k]) / rounded
            inputs = np.array([*states[k], begins[k], slope, force])
            states[k + 1] = transitions[rounded, more] @ inputs
        return states

    def _transition(self, step: float, more: float) -> Array:
        """Return the matrix from state, ground's acceleration, its slope and force to the state."""
        size = 2 * self.count + 2
        generator = np.zeros((size + 3, size + 3))
        generator[:size, :size] = np.column_stack([self.rates(e, 0.0, more) for e in np.eye(size)])
        generator[self.count + 1 : size, size] = self.ground
        generator[size, size + 1] = 1.0
        generator[self.count + 1 : size, size + 2] = self.push
        return np.asarray(expm(generator * step)[:size], np.float64)

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


class Control:
    """What force and damping actuators hold in each control step.

    Parameters
    ----------
    scene, action
        As of `FullModel`. The action has passed `mm_gym.simulate`, which checks its shape.
    lane
        (rows,) at the start.

    Raises
    ------
    StructureError
        If the stretch or the carriage's damping is actuated.
    """

    def __init__(self, scene: Scene, action: ArrayLike | Policy, lane: Array) -> None:
        others = [name for name in scene.actuation.names if name not in ("force", "damping")]
        if others or scene.actuation.damped == "carriage.damping":
            name = (*others, "damping")[0]
            msg = f"actuation.{name}: allowed with an action: a force, the interface's damping"
            raise StructureError(msg)
        self.plant, self.lane, self.own = compile_scene(scene), lane[:, None].copy(), lane[HELD]
        self.step, self.action, self.next = scene.control.time_step, action, 0

    def starts(self, end: float) -> Array:
        """Return the starts [s] of the control steps until an end [s]."""
        return np.asarray(self.step * np.arange(1, int(end / self.step) + 1), np.float64)

    def at(self, time: float, state: Array) -> Array:
        """Return the force [N] and the damping beyond the interface's own [N s/m] from a time on.

        Parameters
        ----------
        time
            [s], not before that of the last call.
        state
            (4,) x1, x2 [m], v1, v2 [m/s] of the device and its degree of freedom.
        """
        if time >= self.next * self.step * (1.0 - SAME_TIME):
            wanted = commands_of(self.plant, self._command(state), 1, self.lane[:, 0])
            plain(steer)(self.plant.task, self.lane, wanted[0])
            self.next += 1
        return self.lane[HELD, 0] - self.own

    def _command(self, state: Array) -> ArrayLike:
        if callable(self.action):
            return self.action(self.next * self.step, state)
        given = np.asarray(self.action, np.float64)
        k = len(self.plant.actuators)
        return given if given.shape in ((), (k,)) else given.reshape(-1, k)[self.next]


class Device:
    """The force that a scene's interface and springs exert on the carriage.

    It has a `lane` (rows,) with the state at the start, and so many `states` of its own.
    """

    def __init__(self, scene: Scene) -> None:
        support = support_of(scene)
        self.lane, one = lane_of(support), support.interface
        self.states, self.is_general = len(one.states), support.is_general
        nonlinear = self.is_general or support.slips or self.lane[layout.L0] > 0.0
        self.is_linear = not nonlinear
        own = list(support.interface_rows) if self.is_general else list(LINE)
        self._springs, self._own = self.lane[SPRINGS].tolist(), self.lane[own].tolist()
        self._spring_force, self._force, self._rates = map(
            plain,
            (springs.spring_force, one.force if self.is_general else interface_force, one.rates),
        )

    def force(self, offset: float, slip: float, own: Array) -> float:
        """Return the force [N] at an offset [m], a slip velocity [m/s] and own states (states,)."""
        pair = self._spring_force(*self._springs, offset)
        if self.is_general:
            return pair + self._force(self._own, offset, slip, _pair(own))
        return pair + self._force(*self._own, slip)

    def rates(self, offset: float, slip: float, own: Array) -> Array:
        """Return the rates of the own states, (states,)."""
        return np.array(self._rates(self._own, offset, slip, _pair(own))[: self.states])


def _pair(own: Array) -> tuple[float, ...]:
    """Return own states as an interface takes them."""
    return (*own, *[0.0] * MOST_STATES)[:MOST_STATES]


def _stops(times: Array, corners: Array) -> Array:
    """Return the times, and corners of the ground's motion and of commands between them."""
    corners = np.sort(corners[(corners > times[0]) & (corners < times[-1])])
    corners = corners[np.diff(corners, prepend=-np.inf) > SAME_TIME * corners]
    after = np.clip(np.searchsorted(times, corners), 1, len(times) - 1)
    gap = np.minimum(np.abs(corners - times[after - 1]), np.abs(corners - times[after]))
    return np.sort(np.concatenate([times, corners[gap > SAME_TIME * corners]]))


def _sampled(stops: Array, ground: Array) -> tuple[Array, Array]:
    """Return the ground's acceleration at the beginning and end of each step between stops."""
    times, values = ground.T
    near = SAME_TIME * stops[-1]
    moves = (stops[:-1] >= times[0] - near) & (stops[1:] <= times[-1] + near)
    at_stops = np.interp(stops, times, values)
    return at_stops[:-1] * moves, at_stops[1:] * moves
