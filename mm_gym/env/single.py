"""`MovingMassEnv`: one lane behind Gymnasium's interface, without equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy import ndarray
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array, Single
from mm_gym.env.arguments import (
    FLOAT32,
    Changes,
    SceneLike,
    checked_actions,
    checked_options,
    flag_of,
    python_integer,
    scene_of,
)
from mm_gym.env.base import SINGLE_MODES, Environment
from mm_gym.env.outputs import InfoLevel, action_space, checked_level, observation_space
from mm_gym.env.own_reward import RewardLike
from mm_gym.lanes import layout
from mm_gym.rendering.subject import frames_per_second


class MovingMassEnv(  # pyright: ignore[reportIncompatibleVariableOverride] - Gymnasium declares `spec` an attribute
    Environment, gymnasium.Env[np.ndarray, np.ndarray]
):
    """Keep a vibrating carriage still: push it, or stretch the springs of the sphere it carries.

    Description
    -----------
    A carriage on a spring and a damper carries a sphere that rolls on it, coupled by an interface
    and, optionally, by pre-stretched springs (docs/model.md). Each control step holds the action
    constant and propagates the motion within the error bound that `Plant.explain` states.

    Action Space
    ------------
    `Box(-1, 1, (k,), float32)`, one number per actuator of the scene, in this order. Finite values
    outside are clipped; NaN and infinity raise `ActionError` and change nothing.

    =======  =========================  ================================================
    column   actuator                   an action of 1 means
    =======  =========================  ================================================
    force    `actuation.force` [N]      +limit, on the carriage; with ``between = "masses"``
                                        -limit on the sphere, too
    stretch  `actuation.stretch` [-]    `maximum`
    damping  `actuation.damping`        `maximum`, of the interface or the carriage
             [N s/m]
    voltage  `actuation.voltage` [V]    `maximum`, of a magnetorheological damper
    =======  =========================  ================================================

    With ``command = "rate"``, an action of 1 means +rate_limit. Rate limits and lags determine the
    value that the actuator reaches within the step.

    Observation Space
    -----------------
    `Box(low, high, (history * channels,), float32)`: the channels of `sensors.channels` at the last
    `sensors.history` control steps, oldest first, delayed by `sensors.delay` steps and with
    `sensors.noise` and `sensors.bias`. With probability `sensors.dropout` no frame arrives in a
    step, and the last one is shown again. At the start of an episode the first frame is used in
    place of earlier ones.

    The actuators bound the applied force, stretch, damping and voltage, unless these channels have
    noise or a bias; all other channels are unbounded. A limit of the displacement is not a bound,
    because the step that ends an episode exceeds it. Numbers too large for single precision are
    shown as its largest number, 3.4e38.

    ===============================================  =========================================
    channel                                          scaled by
    ===============================================  =========================================
    carriage_displacement, sphere_displacement [m]   1 / objective.displacement_scale
    sphere_offset [m]                                1 / objective.stroke_scale
    carriage_velocity, sphere_velocity [m/s]         1 / objective.velocity_scale
    slip_velocity [m/s]                              1 / objective.velocity_scale
    carriage_acceleration (absolute) [m/s^2]         displacement_scale / velocity_scale^2
    sphere_acceleration (absolute) [m/s^2]           the same
    ground_acceleration [m/s^2]                      the same
    spring_force, disturbance_force [N]              1 / (carriage.stiffness displacement_scale)
    stretch [-]                                      actuation.stretch's minimum and maximum
                                                     become -1 and 1
    damping [N s/m], voltage [V]                     the same of their actuators
    applied_force [N]                                1 / actuation.force.limit
    ===============================================  =========================================

    Rewards
    -------
    The reward follows from the state at the end of the step, with `a` the clipped action:
    ``-(w_x (x1/x_ref)^2 + w_v (v1/v_ref)^2 + w_u sum(a^2) + w_s ((x2 - x1)/s_ref)^2)``. If they
    have weights, the squares of the absolute accelerations of both masses and of the force between
    the masses are added to the sum. With ``reward=`` the reward is minus your own cost, a function
    of channels.

    Starting State
    --------------
    The state is drawn uniformly from `initial` and `randomization`; noise starts in its stationary
    distribution. You can set any drawn field, or any value of the initial state, by its dotted
    name: `reset(options={"initial.sphere_offset": 0.01})`.

    The seed of `reset` is an integer, also of a NumPy type. Without a seed, the first reset draws
    one from `np_random`, and so does the first reset after `np_random` was set; later resets
    continue the stream of random numbers.

    Episode End
    -----------
    Terminated when |x1| exceeds `objective.displacement_limit` or |x2 - x1| exceeds
    `objective.rail_half_length`; truncated after `control.steps`.

    Information
    -----------
    With ``info="light"``, the default: `state`, (4,) float64, x1, x2 [m], v1, v2 [m/s], ground
    frame; `applied`, (k,) float64, the force [N], stretch [-], damping [N s/m] or voltage [V] that
    the actuators reached.

    With ``info="full"`` also the terms of the reward, whose sum is the reward:
    `reward_displacement`, `reward_velocity`, `reward_effort`, `reward_stroke`, 0 at a reset;
    `cost`, 1 if a limit of `objective` is exceeded and otherwise 0, as in safe reinforcement
    learning; and `constraint`, the larger of |x1| / displacement_limit and |x2 - x1| /
    rail_half_length, minus 1. The constraint is negative within the limits, and -1 without limits.
    Accelerations and the force between the masses add terms if they have weights. Your own reward
    is one term, `reward_own`. With ``info="none"`` the information is empty, for programs that copy
    each entry.

    Continuation
    ------------
    `get_state` and `set_state` save and restore an episode exactly; values that the scene cannot
    reach are refused. Copies and pickles of the environment continue from its current state,
    independently of the original.

    Arguments
    ---------
    scene
        A `Scene`, the id of a registered task, or the path of a TOML file.
    changes
        Fields of the scene to change, by dotted name: ``{"control.steps": 200}``. Values are
        written as in a scene file; a range is a list.
    reward
        Your own cost instead of that of the objective: a function whose arguments are named after
        channels, or "FILE.py:NAME" of one; see docs/scenes.md.
    info
        "none", "light" or "full": how much information steps return, see above.

    Through Gymnasium
    -----------------
    `gymnasium.make` takes the same arguments. Its ``max_episode_steps`` only shortens episodes: the
    scene ends them after `control.steps` in any case. A longer episode is
    ``changes={"control.steps": 500}``. `spec` is plain data and can be written as JSON; its
    `max_episode_steps` is that of the scene, or of the `TimeLimit` that Gymnasium adds.

    Version History
    ---------------
    v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": SINGLE_MODES}  # noqa: RUF012 - Gymnasium's own declaration
    _prepared = frozenset({"plant", "_lanes", "_terms", "_parts", "_is_plain", "_renderer"})

    def __init__(
        self,
        scene: SceneLike,
        *,
        changes: Changes | None = None,
        reward: RewardLike | None = None,
        info: InfoLevel = "light",
        render_mode: str | None = None,
    ) -> None:
        self._level = checked_level(info)
        self.scene = scene_of(scene, changes, reward)
        self.render_mode = render_mode
        self._running = False
        self._prepare()
        self.metadata = self.metadata | {"render_fps": frames_per_second(self.plant)}
        self.action_space = action_space(self.plant)
        self.observation_space = observation_space(self.plant)

    def _prepare(self) -> None:
        """Compile the scene, and make the lane and the parts of a step."""
        self._compile(1)
        lanes, column = self._lanes, self._lanes.values[:, 0]
        # kept together, and bound: to look one up takes a good part of a control step
        self._parts = (
            *((len(self.plant.actuators),), lanes.advance_of(FLOAT32)),
            *(lanes.rewards, lanes.rewards.item),
            *(lanes.observed[:, 0].copy, column[:4].copy, column[lanes.applied_rows].copy),
        )
        self._is_plain = self._renderer is None and self._level == "light"

    @property
    def state(self) -> Array:
        """The state x1, x2 [m], v1, v2 [m/s] in the ground frame, as a copy."""
        return self._lanes.values[:4, 0].copy()

    def drawn(self, name: str) -> float:
        """Return this episode's value of a field by dotted name, such as "excitation.0.frequency".

        Raises
        ------
        SceneError
            If the field is unknown, no episode has begun, or the initial state is unknown, because
            the episode was restored by `set_state`.
        """
        return float(self._lanes.drawn(name)[0])

    def reset(
        self,
        *,
        seed: int | np.integer | None = None,
        options: Mapping[str, ArrayLike] | None = None,
    ) -> tuple[Single, dict[str, Any]]:
        """Begin an episode; see the class for `options`.

        Raises
        ------
        SceneError
            If a name or value is not allowed.
        """
        fixed = self._lanes.checked(checked_options(options))
        seed = python_integer(seed)
        super().reset(seed=seed)
        if seed is not None or self._draws_seed:
            self._lanes.seed(self._drawn_seed() if seed is None else seed)
            self._draws_seed = False
        self._lanes.restart(fixed=fixed)
        self._running = True
        if self._renderer is not None:
            self._renderer.note()
        *_, observed, _, _ = self._parts
        return observed(), self._info(None)

    def step(
        self, action: NDArray[np.floating]
    ) -> tuple[Single, float, bool, bool, dict[str, Any]]:
        """Make one control step.

        Raises
        ------
        ActionError
            If the action is not finite or has the wrong shape. Nothing is changed.
        ResetNeeded
            If the episode has ended or none has begun.
        SimulationError
            If the motion cannot be followed to the end of the step. The episode ends.
        """
        if not self._running:
            msg = "the episode is over: call reset() before step()"
            raise ResetNeeded(msg)
        shape, advance, rewards, reward, observed, state, applied = self._parts
        if (
            type(action) is ndarray
            and action.dtype is FLOAT32
            and action.shape == shape
            and action.flags.carray
        ):  # the common case
            status = advance(action, rewards, 0, 1)
        else:
            status = self._lanes.advance(checked_actions(action, shape))
        terminated = truncated = False
        if status:
            lanes = self._lanes
            self._running = status == layout.NOT_FINITE  # which is refused and changes nothing
            lanes.raise_for(status)
            terminated, truncated = bool(lanes.terminated[0]), bool(lanes.truncated[0])
        if self._is_plain:  # the common case
            info = {"state": state(), "applied": applied()}
            return observed(), reward(), terminated, truncated, info
        if self._renderer is not None:
            self._renderer.note()
        return observed(), reward(), terminated, truncated, self._info(np.asarray(action))

    def _info(self, action: NDArray[np.floating] | None) -> dict[str, Any]:
        """Return the information of a step, or of a reset, which has no action."""
        if self._level == "none":
            return {}
        *_, state, applied = self._parts
        info: dict[str, Any] = {"state": state(), "applied": applied()}
        if self._level == "light":
            return info
        lane = self._lanes.values
        terms = dict.fromkeys(self._terms.names, 0.0)
        if action is not None:
            found = self._terms.rewards(lane, action, self._lanes.rewards)
            terms = {name: row.item() for name, row in found.items()}
        limits = {name: row.item() for name, row in self._terms.constraint(lane).items()}
        return info | terms | limits

    def get_state(self) -> dict[str, object]:
        """Return the exact state of the episode, including its random stream, for `set_state`."""
        flags = {"running": self._running, "seeded": not self._draws_seed}
        return self._lanes.snapshot() | flags

    def set_state(self, state: Mapping[str, object]) -> None:
        """Continue from what `get_state` returned; raise `SceneError` if it does not fit."""
        running, seeded = flag_of(state, "running"), flag_of(state, "seeded")
        self._lanes.restore(state, np.array([not running]))
        self._running, self._draws_seed = running, not seeded
        if self._renderer is not None:
            self._renderer.note(watched=False)

    def render(self) -> NDArray[np.uint8] | list[NDArray[np.uint8]] | None:  # pyright: ignore[reportIncompatibleMethodOverride] - Gymnasium does not declare a frame's type
        """Return a picture, or the list of pictures since the last call; show it in mode "human".

        Raises
        ------
        DependencyNotInstalled
            Without pygame-ce.
        ResetNeeded
            Before the first reset; a list of pictures is then empty.
        SceneError
            If there is no such mode.
        """
        frames = self._frames()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()

    def get_keys_to_action(self) -> dict[tuple[int, ...], Single]:
        """Return keys -> action for `gymnasium.utils.play`, whose `noop` must be an array, too.

        Left and right command -1 and 1 of the first actuator, down and up those of a second one.
        """
        from mm_gym.rendering.renderer import keys_to_action  # noqa: PLC0415 - needs pygame

        return keys_to_action(self.plant.actuators)
