"""The Jacobians of a control step: of the motion and of the actuators, over lanes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.methods.linear.method import Linear
from mm_gym.methods.support import LINEAR, MASSLESS, PARAMETRIC_LINEAR
from mm_gym.sensitivity import layout as own
from mm_gym.sensitivity.actuators import actuators_of, slopes
from mm_gym.sensitivity.model import BESIDE, control_step, series_models
from mm_gym.sensitivity.step_kernel import by_cubic_series, by_linear_series, by_series, step_by

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support
    from mm_gym.sensitivity.actuators import Actuator

    Array = NDArray[np.float64]
    Numbers = NDArray[np.uint64]

STATES = ("x1", "x2", "v1", "v2")

by_transition = step_by(Linear.entries.cross)


class Jacobian(NamedTuple):
    """The derivatives of where a control step ends; over lanes each array has the lanes in front.

    Attributes
    ----------
    names
        The n states: x1, x2 [m], v1, v2 [m/s], then for each actuator the force [N] or stretch [-]
        that it applies, then of those with a lag that are commanded by rate what was asked for.
    end
        (n,) state at the step's end.
    state
        (n, n) derivatives of the end with respect to the state at the start.
    action
        (n, k) with respect to the action [-].
    applied
        (4, k) of x1, x2, v1, v2 with respect to what the actuators apply in the step [N, -].
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
    """

    def __init__(
        self,
        support: Support,
        constants: tuple[Array, Array],
        lanes: tuple[Array, Numbers],
        parameters: dict[str, int] | None = None,
    ) -> None:
        (model, task), (values, streams) = constants, lanes
        self.task, self.count, self.rows = task, values.shape[1], len(values)
        self.actuators = actuators_of(task)
        self.parameters = parameters or {}
        self._causes = [a.row for a in self.actuators] + list(self.parameters.values())
        self._constant = None
        if support.kind in (LINEAR, MASSLESS) and not self.parameters:
            self._constant = control_step(model)
            self._models, self._advance = [model], by_transition
        else:
            self._models = series_models(support, self._causes, self.rows)
            self._advance = _kernel(support, self._causes)
        self.lanes = np.vstack([values, np.zeros((own.ROWS, self.count))])
        age = values[at.NOW] - values[at.BEGAN]
        self.lanes[at.NOW], self.lanes[at.BEGAN] = 0.0, -age
        self.streams = streams.copy()

    @property
    def state(self) -> Array:
        """(4 + actuators, count) x1, x2 [m], v1, v2 [m/s] and what is applied [N, -], copied."""
        return self.lanes[[*range(4), *(a.row for a in self.actuators)]]

    def step(self, actions: Array) -> tuple[int, Array]:
        """Make a control step.

        Parameters
        ----------
        actions
            (actuators, count) [-].

        Returns
        -------
        tuple
            Status, and the derivatives (4, 4 + causes, count) of x1, x2, v1, v2: with respect to
            the state, to what the actuators apply, and to the parameters.
        """
        flat = np.ascontiguousarray(actions, np.float64).ravel()
        status, found = at.OK, np.empty((4, 4 + len(self._causes), self.count))
        start, streams = self.lanes, self.streams
        for k, model in enumerate(self._models):
            if k < len(self._models) - 1:  # the last one moves the lanes
                self.lanes, self.streams = start.copy(), streams.copy()
            else:
                self.lanes, self.streams = start, streams
            status = max(status, self._move(model, flat))
            if self._constant is None:
                self._collect(found, BESIDE * k)
        if self._constant is not None:
            found[:, :4], found[:, 4:] = self._constant[0][:, :, None], 0.0
            if at.FORCE in self._causes:
                found[:, 4:5] = self._constant[1][:, :, None]
        return status, found

    def _move(self, model: Array, actions: Array) -> int:
        status = at.OK
        for first in range(0, self.count, at.BLOCK):
            last = min(first + at.BLOCK, self.count)
            rows = self.task, model, self.lanes, self.streams, actions
            status = max(status, self._advance(*rows, first, last))
        return status

    def _collect(self, found: Array, first: int) -> None:
        """Copy the columns of a model whose causes begin with a given one; back to x2 and v2."""
        columns = self.lanes[self.rows + own.TANGENTS :].reshape(4, own.COLUMNS, self.count)
        begin = own.STATES if first else 0  # the state's are those of the first model
        target = found[:, begin + first : first + own.COLUMNS]
        source = columns[:, begin : begin + target.shape[1]]
        target[::2] = source[::2]
        np.add(source[::2], source[1::2], out=target[1::2])

    def jacobian(self, actions: Array) -> tuple[int, Jacobian]:
        """Make a control step; return its status and derivatives, the lanes in front."""
        before = self.lanes[: self.rows].copy()
        status, motion = self.step(actions)
        chain = [
            slopes(a, before[a.row], before[a.asked_row], action)
            for a, action in zip(self.actuators, actions, strict=True)
        ]
        count = len(self.actuators)
        remembered = [k for k, a in enumerate(self.actuators) if a.has_memory_of_command]
        size = 4 + count + len(remembered)
        state, action = np.zeros((size, size, self.count)), np.zeros((size, count, self.count))
        state[:4, :4] = motion[:, :4]
        applied = motion[:, 4 : 4 + count]
        for k, slope in enumerate(chain):
            through = applied[:, k]
            state[:4, 4 + k], state[4 + k, 4 + k] = through * slope[0], slope.applied_by_applied
            action[:4, k], action[4 + k, k] = through * slope[2], slope.applied_by_action
        for j, k in enumerate(remembered, 4 + count):
            state[:4, j], state[4 + k, j] = applied[:, k] * chain[k][1], chain[k].applied_by_asked
            state[j, j], action[j, k] = chain[k].asked_by_asked, chain[k].asked_by_action
        rows = [*range(4), *(a.row for a in self.actuators)]
        rows += [self.actuators[k].asked_row for k in remembered]
        parameters = {
            name: np.vstack([motion[:, 4 + count + k], np.zeros((size - 4, self.count))]).T
            for k, name in enumerate(self.parameters)
        }
        return status, Jacobian(
            _names(self.actuators),
            self.lanes[rows].T,
            *(np.moveaxis(state, -1, 0), np.moveaxis(action, -1, 0), np.moveaxis(applied, -1, 0)),
            parameters,
        )


def _kernel(support: Support, causes: Sequence[int]) -> Callable[..., int]:
    """Return the quickest kernel that follows deviations by these causes besides the state's."""
    if support.kind == PARAMETRIC_LINEAR and set(causes) <= {at.FORCE, at.STRETCH}:
        return by_linear_series
    plain = not (support.slips or support.ground or support.terms or support.high[at.L0] > 0.0)
    if support.is_cubic and plain and support.low[at.BETA] >= 0.0 and set(causes) <= {at.FORCE}:
        return by_cubic_series
    return by_series


def _names(actuators: Sequence[Actuator]) -> tuple[str, ...]:
    """Return the names of the states, see `Jacobian`."""
    asked = (f"{a.name}_asked" for a in actuators if a.has_memory_of_command)
    return (*STATES, *(a.name for a in actuators), *asked)
