"""Control steps that torch differentiates, by the exact Jacobians of the motion.

`step` is one control step as a function of state, action and parameters. `Episodes` are parallel
episodes whose observations and costs carry gradients to all earlier actions. Any torch policy, with
or without a memory, can therefore be trained by the gradient of the cost of its episodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled

from mm_gym.arrays import Array
from mm_gym.env.vector import MovingMassVectorEnv
from mm_gym.errors import SceneError, refuse
from mm_gym.lanes import layout
from mm_gym.plant.outputs import Outputs
from mm_gym.sensitivity import Sensitivities

try:
    import torch
    from torch.autograd import Function
    from torch.autograd.function import once_differentiable
except ImportError as error:
    msg = "torch is not installed: install the extra `agents`"
    raise DependencyNotInstalled(msg) from error

from collections.abc import Mapping, Sequence
from os import PathLike

from numpy.typing import ArrayLike, NDArray

from mm_gym.plant.plant import Plant
from mm_gym.scene.scene import Scene

if TYPE_CHECKING:
    from torch import Tensor


def step(
    plant: Plant,
    state: Tensor,
    action: Tensor,
    *,
    at: Mapping[str, Any] | ArrayLike | None = None,
    parameters: Mapping[str, Tensor] | None = None,
) -> Tensor:
    """Return the state at the end of a control step; see `Plant.jacobian`.

    Parameters
    ----------
    state
        (n,) or (lanes, n) double, as `Plant.jacobian` takes it.
    action
        (k,) or (lanes, k) in [-1, 1].
    at
        All other initial values, as `Plant.jacobian` takes them.
    parameters
        Dotted name -> number: parameters of the step, with respect to which it is differentiated.
        `at` must then be values by name, or None. The plant must be compiled for these parameters
        (`randomization`).

    Returns
    -------
    Tensor
        (m,) or (lanes, m) double: everything that `Jacobian.names` lists. The next step may begin
        with it.

    Raises
    ------
    SceneError, ActionError, CompileError, SimulationError
        As `Plant.jacobian`.
    """
    named = parameters or {}
    if named and not (at is None or (hasattr(at, "keys") and "values" not in at)):  # pyright: ignore[reportOperatorIssue]
        msg = "at: with parameters it must be values by dotted name, or None"
        raise SceneError(msg)
    if named:
        own = {name: _number(f"parameters.{name}", value) for name, value in named.items()}
        at = {**(at or {}), **own}  # pyright: ignore[reportGeneralTypeIssues, reportUnknownVariableType]
    given = _numbers("state", state), _numbers("action", action)
    found = plant.jacobian(*given, at=at, parameters=tuple(named))
    numbers = (value.reshape(()) for value in named.values())
    return _moved(found, state, action, *numbers, names=tuple(named))


def _number(where: str, value: Tensor) -> float:
    """Return the number of a tensor that has one; refuse anything else."""
    numbers = _numbers(where, value)
    if numbers.size != 1:
        refuse(where, f"shape {numbers.shape}", "one number")
    return numbers.item()


def _numbers(where: str, value: Tensor) -> Array:
    """Return the numbers of a tensor, without slopes; refuse anything else."""
    if not isinstance(value, torch.Tensor) or value.is_complex():  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
        refuse(
            where, f"{getattr(value, 'dtype', type(value).__name__)}", "a tensor of real numbers"
        )
    return value.detach().double().numpy()


class _Motion(Function):
    """A control step whose Jacobians are known, and the way back through it."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch does not name it
        known: tuple[Any, tuple[str, ...], float, float],
        state: Tensor,
        action: Tensor,
        *_: Tensor,
    ) -> Tensor:
        found, names, *ctx.hold = known
        own = _tensor(found.state)[..., : state.shape[-1]]
        by_parameters = [_tensor(found.parameters[name]) for name in names]
        ctx.save_for_backward(own, _tensor(found.action), *by_parameters)
        ctx.shapes = state.shape, action.shape
        return _tensor(found.end)

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride] - the decorator loses its names
        ctx: Any,  # noqa: ANN401 - as above
        *slopes: Tensor,
    ) -> tuple[Tensor | None, ...]:
        (slope,), (by_state, by_action, *by_parameters) = slopes, ctx.saved_tensors
        pulled = (torch.einsum("...i,...ij->...j", slope, by) for by in (by_state, by_action))
        state, action = (
            value.reshape(-1, *shape).sum(0) if value.ndim > len(shape) else value
            for value, shape in zip(pulled, ctx.shapes, strict=True)
        )
        fade, most = ctx.hold
        if most < np.inf:
            sizes = state.abs().sum(dim=1)
            limit = most * sizes.median().clamp_min(torch.finfo(sizes.dtype).tiny)
            state = state * (limit / sizes.clamp_min(limit))[:, None]
        return None, fade * state, action, *((slope * by).sum() for by in by_parameters)


def _moved(
    found: Any,  # noqa: ANN401 - of either kind of Jacobian
    *given: Tensor,
    names: tuple[str, ...] = (),
    fade: float = 1.0,
    most: float = np.inf,
) -> Tensor:
    """Return the end of a control step that follows from state, action and parameters."""
    return _Motion.apply((found, names, fade, most), *given)  # pyright: ignore[reportUnknownMemberType, reportReturnType, reportUnknownVariableType]


class Episodes:
    """Parallel episodes of a scene that torch can differentiate.

    The numbers are those of `MovingMassVectorEnv`: observations with delay, noise and history, and
    costs. Their derivatives with respect to the motion are exact; where the scene shows or rewards
    accelerations or forces of the springs, or has your own reward, they are central differences at
    the end of a step. The derivatives of the motion with respect to earlier motion and actions are
    its exact Jacobians.

    With springs whose stretch is actuated, slopes grow without bound near a switching controller,
    in few lanes by many orders of magnitude. `fade` and `most` limit them; the gradient is then not
    exact.

    Parameters
    ----------
    scene, num_envs
        As `MovingMassVectorEnv` takes them.
    fade
        Factor of the slopes with respect to the motion in each step back; 1 leaves them unchanged.
    most
        Largest ratio of the slopes of a lane to the median of all lanes; by default unlimited.

    Attributes
    ----------
    steps
        Number of control steps of an episode.

    Raises
    ------
    SceneError
        If an episode may end early, because such ends have no slopes.
    """

    def __init__(
        self,
        scene: Scene | str | PathLike[str],
        num_envs: int = 1,
        *,
        fade: float = 1.0,
        most: float = np.inf,
    ) -> None:
        self.env = MovingMassVectorEnv(scene, num_envs, autoreset_mode="Disabled", info="none")
        objective = self.env.scene.objective
        if objective.displacement_limit or objective.rail_half_length:
            msg = "objective: gradients need episodes that do not end early; remove its limits"
            raise SceneError(msg)
        self.steps = self.env.scene.control.steps
        self.fade, self.most = fade, most
        self._effort = 0.0 if self.env.scene.own_reward else objective.effort_weight

    def reset(self, seed: int | Sequence[int] | None = None) -> Tensor:
        """Begin episodes; return the observations (num_envs, n) float32."""
        observation, _ = self.env.reset(seed=seed)
        start, plant = self.env.get_state(), self.env.plant
        lanes: tuple[Any, Any] = start["values"], start["streams"]
        self._physics = Sensitivities(plant.support, (plant.model, plant.task), lanes)
        self._outputs = Outputs(self.env.scene, plant, self._physics)
        asked = sum(a.has_memory_of_command for a in self._physics.actuators)
        self._state = torch.zeros(
            len(observation), len(self._outputs.rows) + asked, dtype=torch.float64
        )
        empty = torch.zeros(len(observation), len(plant.observed), dtype=torch.float64)
        # Slopes of frames, oldest first: of those on the way, and of those observed.
        self._measured, self._received = [empty] * (plant.most_delay + 1), [empty] * plant.history
        return _tensor(observation)

    def step(self, action: Tensor) -> tuple[Tensor, Tensor]:
        """Make a control step.

        Parameters
        ----------
        action
            (num_envs, k); it is clipped to [-1, 1], outside of which its slopes are zero.

        Returns
        -------
        observation
            (num_envs, n) float32.
        cost
            (num_envs,) double: the cost of the step, which is minus its reward.

        Raises
        ------
        ActionError
            If the action has another shape or is not finite. Nothing is changed then.
        """
        action = action.double().clamp(-1.0, 1.0)
        actions = action.detach().numpy()
        observation, rewards, *_ = self.env.step(actions)  # first: it refuses before all changes
        found = self._physics.jacobian(actions.T)
        self._state = _moved(found, self._state, action, fade=self.fade, most=self.most)
        by_channel, by_cost = (_tensor(slopes) for slopes in self._outputs.slopes())
        motion = self._state[:, : by_cost.shape[0]]
        self._measured = [*self._measured[1:], torch.einsum("crl,lr->lc", by_channel, motion)]
        self._received = [*self._received[1:], self._arriving()]
        shown = torch.cat(self._received, dim=1)
        effort = self._effort * (action**2).sum(dim=1)
        return (
            _with_slopes(_tensor(observation), shown.float()),
            _with_slopes(_tensor(-rewards), torch.einsum("rl,lr->l", by_cost, motion) + effort),
        )

    def detach(self) -> None:
        """Cut the gradient: later costs have no slopes over earlier actions (short horizons)."""
        self._state = self._state.detach()
        self._measured = [frame.detach() for frame in self._measured]
        self._received = [frame.detach() for frame in self._received]

    def _arriving(self) -> Tensor:
        """Return the slopes of the frame that each lane receives, or of the last one if none."""
        first = self.env.plant.support.sensors_row
        if not first:
            return self._measured[0]
        lanes: Any = self.env.get_state()["values"]
        delays, ages = (_tensor(lanes[first + row]) for row in (layout.DELAY, layout.AGE))
        places = len(self._measured) - 1 - delays.long()
        arriving = torch.stack(self._measured)[places, torch.arange(len(places))]
        return torch.where((ages > delays)[:, None], self._received[-1], arriving)


def _tensor(array: NDArray[Any]) -> Tensor:
    """Return a copy, whatever writes into the array later."""
    return torch.tensor(array)


def _with_slopes(value: Tensor, changes: Tensor) -> Tensor:
    """Return a value that changes as `changes` do."""
    return value + (changes - changes.detach())
