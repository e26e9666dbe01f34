"""The responses of episodes in the lanes of a vector environment, and of reference motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.env.arguments import checked_options
from mm_gym.env.vector import MovingMassVectorEnv
from mm_gym.errors import SimulationError, refuse
from mm_gym.lanes import layout
from mm_gym.law import springs
from mm_gym.metrics.response import End, Response, Totals
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.tuning import tune


class LaneResponse:
    """Response and effort of an episode in each lane of a vector environment.

    Make one after a reset, and call `add` after each step.

    Parameters
    ----------
    env
        An environment whose episodes have just begun. With autoreset in the next step, use the mask
        of `add` to leave out all episodes after the first.

    Notes
    -----
    The motion is evaluated at the start and end of each control step. For a vibration at w and
    control steps of h, up to (w h)^4 / 384 of the amplitudes are missed, and (w h)^2 / 8 of those
    of the acceleration. `mm_gym.metrics.response` has a finer resolution. Measure references in the
    same way, as `uncontrolled_response` does.

    The velocity just before and after an impulse is not among these instants. A peak of the
    velocity, and of the power, at an impulse is missed: that of the velocity by up to 8 % on
    PreStretchShock, and by 32 % after an impulse on the carriage of CarriageForce at rest.
    Integrals over the step of an impulse are off, too: root mean squares by about 1 % there, and
    the control energy by up to 12 % if another impulse follows in the next step.

    Raises
    ------
    SimulationError
        If a carriage has no mass, or episodes begin in the step in which others end: the last state
        of an episode is then not seen. Also if a response is asked for before a step was added.
    """

    def __init__(self, env: MovingMassVectorEnv) -> None:
        if not isinstance(env, MovingMassVectorEnv):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
            allowed = "a MovingMassVectorEnv, without wrappers"
            refuse("env", type(env).__name__, allowed, SimulationError)
        mode = env.autoreset_mode
        if mode is AutoresetMode.SAME_STEP:
            refuse("autoreset_mode", mode.value, "NextStep or Disabled", SimulationError)
        self._env = env
        self._values = _values_of(env)
        self._totals = Totals(self._values, is_between=env.plant.support.is_between)
        self._task = env.plant.task.copy()  # of an environment that shows accelerations
        self._task[[layout.IS_DERIVED, layout.HAS_REACTIONS]] = 1.0

    def add(self, counts: NDArray[np.bool_] | None = None) -> None:
        """Add the control step that was just made, in the lanes of a mask (lanes,), or in all."""
        env, before = self._env, self._values
        after = _values_of(env)
        counts = np.ones(env.num_envs, np.bool_) if counts is None else np.asarray(counts)
        if counts.shape != (env.num_envs,) or counts.dtype != np.bool_:
            allowed = f"booleans of shape ({env.num_envs},)"
            refuse("counts", f"{counts.dtype} of shape {counts.shape}", allowed, SimulationError)
        old = _spring_energy(before)
        held = [layout.FORCE, layout.STRETCH, layout.DAMPING, *env.plant.support.held_rows]
        before[held] = after[held]
        jumps = np.where(counts, _spring_energy(before) - old, 0.0)
        model = env.plant.model
        for values in (before, after):
            env.plant.entries.derive(self._task, model, values, 0, env.num_envs)
        duration = np.where(counts, env.scene.control.time_step, 0.0)
        self._totals.add(_end(before), _end(after), after[layout.FORCE][:, None], duration[:, None])
        self._totals.add_jumps(jumps[:, None])
        self._values = after

    def response(self) -> Response:
        """Return the responses so far."""
        return self._totals.response()


def _values_of(env: MovingMassVectorEnv) -> Array:
    return cast("Array", env.get_state()["values"])


def _spring_energy(values: Array) -> Array:
    """Return the energy [J] of the sphere's springs in each lane."""
    energy, offset = plain(springs.spring_energy), values[layout.X2] - values[layout.X1]
    k0, l0, stretch = values[[layout.K0, layout.L0, layout.STRETCH]]
    if not l0.any():  # all of a scene are of one kind
        return energy(k0, 0.0, stretch, offset)
    return np.array([energy(*lane) for lane in zip(k0, l0, stretch, offset, strict=True)])


def _end(values: Array) -> End:
    return End(
        values[:4, :, None],
        values[layout.CARRIAGE_ACCELERATION : layout.SPHERE_ACCELERATION + 1, :, None],
        values[layout.GROUND_ACCELERATION][:, None],
        values[layout.D][:, None],
    )


def passive_scene(scene: Scene) -> tuple[Scene, float | None]:
    """Return a scene with the damping of the best passive damper, and its stretch if it has one.

    The damper is that of `mm_gym.tuning.tune` for the carriage's displacement: by "h_infinity" if
    all excitation is harmonic, otherwise by "h2". A seed draws the same episode as in the scene
    itself.

    Raises
    ------
    DesignError
        If the damper cannot be tuned: the interface is dry friction, or a tuned parameter is drawn.
    """
    require_scene(scene)
    kinds = {part.kind for part in scene.excitation}
    tuned = tune(scene, criterion="h_infinity" if kinds == {"harmonic"} else "h2")
    if tuned.stretch is None or not isinstance(scene.initial.stretch, tuple):
        return tuned.tuned, tuned.stretch
    return scene.replace(interface=dict(tuned.tuned.interface)), tuned.stretch


def passive_response(
    scene: Scene, seeds: Sequence[int], options: Mapping[str, ArrayLike] | None = None
) -> Response:
    """Return the responses of episodes with the best passive damper, see `passive_scene`.

    Arguments are those of `uncontrolled_response`, but no option sets the initial stretch, which is
    the damper's. Errors include those of `passive_scene`.
    """
    fixed = checked_options(options)
    if "initial.stretch" in fixed:
        allowed = "none, as the stretch is the damper's"
        refuse("options: initial.stretch", f"{fixed['initial.stretch']!r:.60}", allowed)
    passive, stretch = passive_scene(scene)
    if stretch is not None and isinstance(scene.initial.stretch, tuple):
        fixed["initial.stretch"] = stretch
    return uncontrolled_response(passive, seeds, fixed)


def uncontrolled_response(
    scene: Scene, seeds: Sequence[int], options: Mapping[str, ArrayLike] | None = None
) -> Response:
    """Return the responses of whole episodes, one a lane, with no force and the initial stretch.

    Parameters
    ----------
    seeds
        One seed for each lane.
    options
        Drawn fields to set, as for the reset of `MovingMassVectorEnv`.
    """
    try:
        own = list(seeds)
    except TypeError:
        refuse("seeds", f"{seeds!r}", "a sequence of integers, one for each lane")
    env = MovingMassVectorEnv(scene, len(own), autoreset_mode="Disabled", info="none")
    env.reset(seed=own, options=options)
    record, action = LaneResponse(env), _holding(env)
    alive = np.ones(env.num_envs, np.bool_)
    while alive.any():
        _, _, terminated, truncated, _ = env.step(action)
        record.add(alive)
        ended = terminated | truncated
        alive &= ~ended
        if ended.any() and alive.any():
            env.reset(options={"reset_mask": ended})
    return record.response()


def _holding(env: MovingMassVectorEnv) -> Array:
    """Return the actions (lanes, k) of no force and of the present stretch, damping or voltage."""
    actions = np.zeros((env.num_envs, len(env.plant.actuators)))
    values = np.asarray(env.get_state()["values"])
    for k, name in enumerate(env.plant.actuators):
        actuator = getattr(env.scene.actuation, name)
        if name != "force" and actuator.command == "position":
            middle = 0.5 * (actuator.maximum + actuator.minimum)
            half = 0.5 * (actuator.maximum - actuator.minimum)
            actions[:, k] = (values[layout.APPLIED[name]] - middle) / half
    return actions
