"""The Jacobians of a control step: of the motion and of the actuators, over lanes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.addresses import address_of
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout
from mm_gym.lanes.memory import rows_of
from mm_gym.lanes.simd import LANES
from mm_gym.methods.linear.method import Linear
from mm_gym.methods.support import LINEAR, MASSLESS, Support
from mm_gym.sensitivity import layout as slots
from mm_gym.sensitivity import tangent_kernel
from mm_gym.sensitivity.actuators import Actuator, actuators_of, slopes
from mm_gym.sensitivity.model import TOLERANCE, control_step, model_of, parameter_maps
from mm_gym.sensitivity.step_kernel import by_cubic_series, by_linear_series, by_series, step_by

Numbers = NDArray[np.uint64]

UNFINISHED = (layout.TOO_MANY_EVENTS, layout.TOO_MANY_SERIES, layout.TOO_MANY_STEPS)

STATES = ("x1", "x2", "v1", "v2")

step_with = cache(tangent_kernel.step_with)
by_transition = step_by(Linear.entries.cross), Linear.entries.propagate


class Jacobian(NamedTuple):
    """The derivatives of where a control step ends; over lanes each array has the lanes in front.

    Attributes
    ----------
    names
        The n states: x1, x2 [m], v1, v2 [m/s], those that the interface has of its own, then for
        each actuator the force [N], stretch [-], damping [N s/m] or voltage [V] that it applies,
        then of those with a lag that are commanded by rate what was asked for.
    end
        (n,) state at the step's end.
    state
        (n, n) derivatives of the end with respect to the state at the start.
    action
        (n, k) with respect to the action [-].
    applied
        (4, k), or more with states of the interface's own, of these with respect to what the
        actuators apply in the step [N, -].
    parameters
        Dotted name -> (n,), with respect to a field of the scene.
    """

    names: tuple[str, ...]
    end: Array
    state: Array
    action: Array
    applied: Array
    parameters: dict[str, Array]


class Sensitivities:
    """Lanes whose control steps are made with derivatives.

    Parameters
    ----------
    support, constants
        Of the plant; the constants are the arrays of model and task.
    lanes
        (rows, count) float64, and (2, count) uint64, their random numbers: copied. Each lane's
        clock counts from its episode's start.
    parameters
        Dotted name -> row of the parameters whose derivatives are wanted too.
    by_tangents
        Whether tangents do all of it, also where a hand-written kernel is quicker: to compare them.
    tolerance
        Of Runge-Kutta steps, which follow an interface that is known by its value only.

    Attributes
    ----------
    state_rows
        Rows of a lane that hold the n states of the motion: x1, x2, v1, v2, then the interface's.
    """

    def __init__(
        self,
        support: Support,
        constants: tuple[Array, Array],
        lanes: tuple[Array, Numbers],
        parameters: dict[str, int] | None = None,
        *,
        by_tangents: bool = False,
        tolerance: float = TOLERANCE,
    ) -> None:
        (model, task), (values, streams) = constants, lanes
        self.task, self.count, self.rows = task, values.shape[1], len(values)
        self.actuators = actuators_of(task, support.device)
        self.parameters = parameters or {}
        causes = [support.damped_row if a.row == layout.DAMPING else a.row for a in self.actuators]
        causes = self._causes = causes + list(self.parameters.values())
        self._is_constant = not by_tangents and _is_constant(support, self.parameters.values())
        width = 0
        self.state_rows = support.state_rows
        states = self._states = len(self.state_rows)
        self._own_states = support.interface.states
        if self._is_constant:
            self._models, kernels, tail = [model], by_transition, 1
        else:
            kernels, width = _kernels(support, causes, by_tangents=by_tangents)
            at_once = self._at_once = max(width - states, 1)
            self._models = [
                model_of(support, causes[first : first + at_once], self.rows, width, tolerance)
                for first in range(0, max(len(causes), 1), at_once)
            ]
            tail = slots.TANGENTS + states * width
        self._rows = rows_of(self.rows + tail, self.count, np.float64)
        self._advance, self._propagate = kernels
        self.lanes = self._rows[: self.rows, : self.count]
        self.lanes[:] = values
        self.lanes[layout.NOW] = 0.0
        self.lanes[layout.BEGAN] = values[layout.BEGAN] - values[layout.NOW]
        self.streams = streams.copy()
        if self._is_constant:
            self._columns = self._prepared(support, model)
        else:
            columns = self._rows[self.rows + slots.TANGENTS :].reshape(states, width, -1)
            self._columns = columns[:, : states + len(causes), : self.count]

    @cached_property
    def _address(self) -> int:
        return address_of(self._propagate, self._models[0], self._rows, 0, 1)

    def __getstate__(self) -> dict[str, object]:
        """Leave out the address, which is of this process."""
        return {name: value for name, value in vars(self).items() if name != "_address"}

    def _prepared(self, support: Support, model: Array) -> Array:
        """Return what is known beforehand of the derivatives of a linear plant."""
        found = np.zeros((4, slots.STATES + len(self._causes), self.count))
        state, force = control_step(model)
        found[:, : slots.STATES] = state[:, :, None]
        if layout.FORCE in self._causes:
            found[:, slots.STATES] = force
        rows, self._status = list(self.parameters.values()), layout.OK
        if rows:
            self._status, self._maps = parameter_maps(support, rows, self.lanes[:, 0])
        return found

    @property
    def state(self) -> Array:
        """(n + actuators, count) the n states of the motion, and what is applied [N, -], copied."""
        return self.lanes[[*self.state_rows, *(a.row for a in self.actuators)]]

    def step(self, actions: Array) -> tuple[int, Array]:
        """Make a control step by actions (actuators, count) [-].

        A status is returned, and the derivatives (n, n + causes, count) of the n states: with
        respect to them, to what the actuators apply, and to the parameters. The next step may write
        into the same array. A lane that cannot be followed stays where it was, which nothing but
        the status shows.

        Raises
        ------
        SimulationError
            If a lane takes too many series, steps, or changes of regime.
        """
        status, motion = self._stepped(np.ascontiguousarray(actions, np.float64).ravel())
        if status in UNFINISHED:
            raise _failure(status)
        return status, motion

    def _stepped(self, flat: Array) -> tuple[int, Array]:
        if self._is_constant:
            return self._step_by_maps(flat)
        if len(self._models) == 1:
            return self._move(self._models[0], flat), self._columns
        states = self._states
        status, found = layout.OK, np.empty((states, states + len(self._causes), self.count))
        start, streams, first = self._rows.copy(), self.streams.copy(), states
        for model in self._models:
            self._rows[:], self.streams[:] = start, streams
            status = max(status, self._move(model, flat))
            last = min(first + self._at_once, found.shape[1])
            found[:, first:last] = self._columns[:, states:][:, : last - first]
            first = last
        found[:, :states] = self._columns[:, :states]
        return status, found

    def _step_by_maps(self, actions: Array) -> tuple[int, Array]:
        """Make a control step of a linear plant without excitation."""
        if not self.parameters:
            return self._move(self._models[0], actions), self._columns
        start = np.empty((5, self.count))
        start[:4] = self.lanes[:4]
        status = max(self._status, self._move(self._models[0], actions))
        start[4] = self.lanes[layout.FORCE]
        np.matmul(self._maps, start, out=self._columns[:, -len(self.parameters) :])
        return status, self._columns

    def _move(self, model: Array, actions: Array) -> int:
        status = layout.OK
        for first in range(0, self.count, layout.BLOCK):
            last = min(first + layout.BLOCK, self.count)
            rows = self._rows, self.streams, actions
            status = max(status, self._advance(self.task, model, self._address, *rows, first, last))
        return status

    def jacobian(self, actions: Array) -> Jacobian:
        """Make a control step; return its derivatives, the lanes in front.

        Raises
        ------
        SimulationError
            If the step of a lane cannot be completed.
        """
        before = self.lanes[: self.rows].copy()
        status, motion = self.step(actions)
        if status > layout.ENDED:
            raise _failure(status)
        chain = [
            slopes(a, before, action) for a, action in zip(self.actuators, actions, strict=True)
        ]
        count, n = len(self.actuators), self._states
        remembered = [k for k, a in enumerate(self.actuators) if a.has_memory_of_command]
        size = n + count + len(remembered)
        state, action = np.zeros((size, size, self.count)), np.zeros((size, count, self.count))
        state[:n, :n] = motion[:, :n]
        applied = motion[:, n : n + count].copy()
        for k, slope in enumerate(chain):
            through = applied[:, k]
            state[:n, n + k], state[n + k, n + k] = through * slope[0], slope.applied_by_applied
            action[:n, k], action[n + k, k] = through * slope[2], slope.applied_by_action
        for j, k in enumerate(remembered, n + count):
            state[:n, j], state[n + k, j] = applied[:, k] * chain[k][1], chain[k].applied_by_asked
            state[j, j], action[j, k] = chain[k].asked_by_asked, chain[k].asked_by_action
        rows = [*self.state_rows, *(a.row for a in self.actuators)]
        rows += [self.actuators[k].asked_row for k in remembered]
        parameters = {
            name: np.vstack([motion[:, n + count + k], np.zeros((size - n, self.count))]).T
            for k, name in enumerate(self.parameters)
        }
        return Jacobian(
            _names(self.actuators, self._own_states),
            self.lanes[rows].T,
            *(np.moveaxis(state, -1, 0), np.moveaxis(action, -1, 0), np.moveaxis(applied, -1, 0)),
            parameters,
        )


def _failure(status: int) -> SimulationError:
    return SimulationError(f"jacobian: {layout.MESSAGES[status]}")


def _is_constant(support: Support, parameters: Iterable[int]) -> bool:
    """Tell whether the derivatives are known before the steps, or linear in the state."""
    if support.kind not in (LINEAR, MASSLESS):
        return False
    excited = support.sampled or support.ground
    return not parameters or not (excited or layout.BETA in parameters)


def _kernels(
    support: Support, causes: Sequence[int], *, by_tangents: bool
) -> tuple[tuple[Callable[..., int], Callable[..., int]], int]:
    """Return the quickest kernels that follow deviations by causes, and their columns at a time."""
    columns = len(support.state_rows) + len(causes)
    if support.is_general:
        return step_with(support.law), min(columns, LANES)
    is_smooth = not (support.slips or support.high[layout.L0] > 0.0)
    if is_smooth and not (by_tangents or support.is_cubic or layout.BETA in causes):
        return by_linear_series, columns
    excited = support.ground or support.terms
    softens = support.low[layout.BETA] < 0.0
    if is_smooth and support.is_cubic and not (by_tangents or excited or softens):
        return by_cubic_series, columns
    return by_series, min(columns, LANES)


def _names(actuators: Sequence[Actuator], own_states: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the states, see `Jacobian`."""
    asked = (f"{a.name}_asked" for a in actuators if a.has_memory_of_command)
    return (*STATES, *own_states, *(a.name for a in actuators), *asked)
