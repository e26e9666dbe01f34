"""`MovingMassVectorEnv`: many lanes of one plant behind Gymnasium's vector interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np
from gymnasium import Space
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array, Single
from mm_gym.env.arguments import (
    Changes,
    SceneLike,
    Seeds,
    checked_actions,
    checked_autoreset_mode,
    checked_mask,
    checked_options,
    checked_seeds,
    flag_of,
    flags_of,
    python_integer,
    scene_of,
)
from mm_gym.env.base import RENDER_MODES, Environment
from mm_gym.env.outputs import InfoLevel, action_space, checked_level, observation_space
from mm_gym.env.own_reward import RewardLike
from mm_gym.errors import refuse, whole_number
from mm_gym.lanes import layout
from mm_gym.rendering.subject import frames_per_second
from mm_gym.scene.scene import Scene
from mm_gym.simulation.checks import is_array
from mm_gym.simulation.closed_loop import ClosedLoop, Episodes
from mm_gym.simulation.lanes import Lanes

SINGLE = {"action_space": "single_action_space", "observation_space": "single_observation_space"}
"""Attributes of a single environment that a vector has by another name."""


class MovingMassVectorEnv(  # pyright: ignore[reportIncompatibleVariableOverride] - Gymnasium declares `spec` an attribute
    Environment, VectorEnv[np.ndarray, np.ndarray, np.ndarray]
):
    """Many independent episodes of one scene.

    Lane i equals `MovingMassEnv` seeded ``seed + i``, bitwise.

    Parameters
    ----------
    scene, changes, reward, info
        As for `MovingMassEnv`. Entries of the information have a row for each lane
        (sub-environment).
    num_envs
        Number of lanes.
    max_episode_steps
        Shortens episodes to this number of control steps, as `TimeLimit` does for one environment.
        None or -1 keeps the length that the scene has. For longer episodes use
        ``changes={"control.steps": 500}``.
    autoreset_mode
        Any of Gymnasium's three: a finished lane is reset in the next step (the default), in the
        same step (then ``info["final_obs"]`` and ``info["final_info"]`` hold the end), or only by
        ``reset(options={"reset_mask": mask})``.
    copy
        If false, observations and the arrays of ``info``, the final ones too, are read-only views
        of memory that the next step overwrites. Rewards, terminated and truncated are always
        copies.
    threads
        Number of numba's threads among which the lanes of a step are divided; results do not depend
        on it. Threads are useful from some thousand lanes on, if as many processors are free and
        numba finds OpenMP or TBB (``numba.threading_layer()``); numba's own work queue takes ten
        times as long to start. A process that is forked after the threads have run uses only one
        thread.

    Notes
    -----
    Copies of observations are row-major, because most programs store them in this way. In the
    memory of the environment, in views of it, and in the arrays of ``info``, the lanes are the
    innermost axis.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": RENDER_MODES,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    _prepared = frozenset(
        {"plant", "_lanes", "_ends", "_terms", "_rewards", "_views", "_renderer"}
        | {"_over", "_everywhere"}
    )

    def __init__(
        self,
        scene: SceneLike,
        num_envs: int = 1,
        *,
        changes: Changes | None = None,
        reward: RewardLike | None = None,
        info: InfoLevel = "light",
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = whole_number("num_envs", num_envs)
        self._level = checked_level(info)
        self.scene = _shortened(scene_of(scene, changes, reward), max_episode_steps)
        self.render_mode = render_mode
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.metadata = MovingMassVectorEnv.metadata | {"autoreset_mode": self.autoreset_mode}
        self._copy = copy
        self._threads = whole_number("threads", threads)
        self._seeded = False
        self._own: dict[str, tuple[object, ...]] = {}  # set by `set_attr`
        self._prepare()
        self.metadata["render_fps"] = frames_per_second(self.plant)
        self.single_action_space = action_space(self.plant)
        self.single_observation_space: Space[Any] = observation_space(self.plant)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._shape = (self.num_envs, *self.single_action_space.shape)

    def _prepare(self) -> None:
        """Compile the scene, and make the lanes and views of their outputs."""
        self._compile(self.num_envs, self._threads)
        self._ends = Ends(self._lanes, copy=self._copy)
        self._rewards = {name: np.zeros(self.num_envs) for name in self._terms.names}
        self._views = [_read_only(array.T) for array in self._lanes.outputs]
        self._over = np.arange(self.num_envs)
        self._everywhere = np.ones(self.num_envs, np.bool_)
        self._everywhere.flags.writeable = False

    @cached_property
    def observation_space(self) -> Space[Any]:  # pyright: ignore[reportIncompatibleVariableOverride] - Gymnasium declares an attribute
        """The space of all lanes' observations.

        It is made at the first use, because its bounds take twice the memory of the observations.
        """
        return batch_space(self.single_observation_space, self.num_envs)

    @property
    def state(self) -> Array:
        """States (num_envs, 4): x1, x2 [m], v1, v2 [m/s] in the ground frame, as a copy."""
        return self._lanes.values[:4].copy().T

    def drawn(self, name: str) -> Array:
        """Return every lane's current value of a field by its dotted name, see `MovingMassEnv`."""
        return self._lanes.drawn(name).copy()

    def reset(
        self, *, seed: Seeds | None = None, options: Mapping[str, ArrayLike] | None = None
    ) -> tuple[Single, dict[str, Any]]:
        """Begin an episode in every lane, or in those of ``options["reset_mask"]``.

        With an integer seed, lane i gets seed + i. A sequence or array has one seed for each lane,
        or None for a lane that continues its stream. See `MovingMassEnv` for `np_random`.

        Other options set drawn fields by dotted name, as in `MovingMassEnv`: one number, or one for
        each lane.

        Raises
        ------
        SceneError
            If a seed, name or value is not allowed.
        """
        fields = checked_options(options)
        mask = checked_mask(fields.pop("reset_mask", None), self.num_envs)
        fixed = self._lanes.checked(fields)
        self._seed(seed, mask)
        which = np.flatnonzero(mask)
        self._lanes.restart(which, fixed)
        self._forget_rewards(which)
        self._over = self._over[~mask[self._over]]
        if self._renderer is not None:
            self._renderer.note()
        observations, *_, state, applied = self._outputs()
        return observations, self._info(state, applied)

    def _seed(self, seed: Seeds | None, mask: NDArray[np.bool_]) -> None:
        """Seed the lanes of the mask; without a seed, they continue their streams."""
        if isinstance(seed, np.ndarray) and seed.ndim == 0:
            seed = seed.item()
        if seed is None or isinstance(seed, int | np.integer):
            given = python_integer(seed)
            super().reset(seed=given)
        else:
            given = checked_seeds(seed, self.num_envs)
        if not self._seeded:
            self._lanes.seed(self._drawn_seed())
        elif self._draws_seed and not isinstance(given, int):
            self._lanes.seed(self._drawn_seed(), mask)
        self._seeded, self._draws_seed = True, False
        if given is not None:
            self._lanes.seed(given, mask)

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[Single, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Make one control step in every lane.

        Raises
        ------
        ActionError
            If an action is not finite or the array has the wrong shape. Nothing is changed.
        ResetNeeded
            If no episode has begun or, without autoreset, a lane's episode is over.
        SimulationError
            If the motion of a lane cannot be followed to the end of the step. All episodes end.
        """
        any_over = self._over.size > 0
        if any_over and (self.autoreset_mode is not AutoresetMode.NEXT_STEP or not self._seeded):
            msg = f"{self._over.size} of {self.num_envs} lanes need reset() before step()"
            raise ResetNeeded(msg)
        # (actuators, lanes), flat: the environment's own memory order
        actions, copies = checked_actions(actions, self._shape).ravel("F"), None
        self._lanes.rewards = rewards = np.empty(self.num_envs)
        if any_over:  # their motion must not make the step fail
            self._lanes.raise_for(self._lanes.rest(actions, self._over))
        if self._copy and self._lanes.are_threaded and not any_over:
            status, copies = self._lanes.advance_and_copy(actions)
        else:
            status = self._lanes.advance(actions)
        if self._level == "full" and status <= layout.ENDED:
            self._rewards = self._terms.rewards(self._lanes.values, actions, rewards)
        final = None
        if status or any_over:
            final = self._end_and_restart_episodes(status)
            if final:
                copies = None  # they are of the end, not of the restart
        if self._renderer is not None:
            self._renderer.note()
        observations, terminated, truncated, state, applied = self._outputs(copies)
        info = self._info(state, applied)
        if final:
            info |= final
        return observations, rewards, terminated, truncated, info

    def _end_and_restart_episodes(self, status: int) -> dict[str, Any] | None:
        """Restart the lanes that had finished before this step; mark those that finish in it.

        Return the end of the latter if they are restarted in the same step.
        """
        lanes = self._lanes
        if status > layout.ENDED:
            if status != layout.NOT_FINITE:  # refused actions change nothing
                self._over = np.arange(self.num_envs)
            lanes.raise_for(status)
        if self._over.size:
            self._restart(paused=True)
        if status == layout.ENDED:
            self._over = lanes.ended()
            if self._over.size and self.autoreset_mode is AutoresetMode.SAME_STEP:
                final = self._final()
                self._restart()
                return final
        return None

    def _restart(self, *, paused: bool = False) -> None:
        """Begin an episode in the finished lanes, see `Lanes.restart`."""
        self._lanes.restart(self._over, paused=paused)
        self._forget_rewards(self._over)
        self._over = self._over[:0]

    def _forget_rewards(self, which: NDArray[np.int64]) -> None:
        """Set the terms of the reward to zero in lanes that begin an episode."""
        if self._level == "full":
            for row in self._rewards.values():
                row[which] = 0.0

    def _final(self) -> dict[str, Any]:
        """Return the last observation and information of the finished lanes, see `Ends`."""
        mask = self._lanes.terminated | self._lanes.truncated
        observations, state, applied = self._ends.of(self._over)
        info = {} if self._level == "none" else {"state": state, "applied": applied}
        if self._level == "full":
            others = self._rewards_and_limits()
            info |= {name: np.where(mask, rows.T, 0.0).T for name, rows in others.items()}
        masks = {f"_{name}": mask for name in info}
        final = {"final_obs": observations, "final_info": info | masks}
        return final | {f"_{name}": mask for name in final}

    def _outputs(self, copies: Sequence[NDArray[Any]] | None = None) -> Sequence[NDArray[Any]]:
        """Return observations, terminated, truncated, states and what was applied."""
        observed, terminated, truncated, state, applied = self._views
        if self._copy and (copies is not None or self._level != "none"):
            observed, terminated, truncated, state, applied = copies or self._lanes.copies()
            return observed, terminated, truncated, state.T, applied.T
        if self._copy:
            observed = self._lanes.observations()
        return observed, terminated.copy(), truncated.copy(), state, applied

    def _info(self, state: Array, applied: Array) -> dict[str, Any]:
        every = self._everywhere
        if self._level == "light":  # the common case
            return {"state": state, "_state": every, "applied": applied, "_applied": every}
        if self._level == "none":
            return {}
        entries = {"state": state, "applied": applied} | self._rewards_and_limits()
        return entries | {f"_{name}": every for name in entries}

    def _rewards_and_limits(self) -> dict[str, Array]:
        copies = {name: row.copy() for name, row in self._rewards.items()}
        return copies | self._terms.constraint(self._lanes.values[:4])

    def get_state(self) -> dict[str, object]:
        """Return the exact state of all lanes, including their random streams, for `set_state`.

        The last axis of every array is that of the lanes. You may repeat, permute or leave out
        lanes to make the state of another number of lanes.
        """
        finished = np.isin(np.arange(self.num_envs), self._over)
        return self._lanes.snapshot() | {"finished": finished, "seeded": self._seeded}

    def set_state(self, state: Mapping[str, object]) -> None:
        """Continue from what `get_state` returned; raise `SceneError` if it does not fit."""
        finished = flags_of(state, "finished", self.num_envs)
        seeded = flag_of(state, "seeded")
        self._lanes.restore(state, finished)
        self._over = np.flatnonzero(finished)
        self._seeded, self._draws_seed = seeded, not seeded
        self._forget_rewards(np.arange(self.num_envs))
        if self._renderer is not None:
            self._renderer.note(watched=False)

    def render(self) -> tuple[Any, ...] | None:
        """Return for every lane what `MovingMassEnv.render` returns; "human" shows up to nine."""
        frames = self._frames()
        return None if frames is None else tuple(frames)

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401, ARG002 - Gymnasium's signature
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()

    def closed_loop(
        self, controller: Callable[..., None], *arguments: object
    ) -> Callable[[], Episodes]:
        """Return a function that takes every lane through its episode to the end.

        Between the control steps no Python runs, and the GIL is free. The function may be called
        after each `reset`; the next call needs another one.

        Parameters
        ----------
        controller
            A function ``controller(observed, actions, *arguments)`` that `numba.njit` has compiled.
            It returns nothing, and is called before each control step of all lanes.

            - ``observed``, read: (n, columns) float32. A lane's observation is a column; there may
              be more columns than lanes.
            - ``actions``, to be written: (k, lanes) float32, as `step` takes them, transposed.
        *arguments
            Arrays, numbers and tuples of them, of the caller's own. What arrays hold is read anew
            in each control step, so they may be changed between two episodes, and be the
            controller's memory.

        Raises
        ------
        TypeError
            If the controller is not compiled, or returns something.
        ResetNeeded, ActionError, SimulationError
            From the function, as from `step`; the last one also if the controller raises an error.
        """
        loop = ClosedLoop(self._lanes, controller, arguments)

        def run() -> Episodes:
            if self._over.size:
                msg = f"{self._over.size} of {self.num_envs} lanes need reset() before an episode"
                raise ResetNeeded(msg)
            self._over = np.arange(self.num_envs)
            episodes = loop.run()
            if self._renderer is not None:
                self._renderer.note(watched=False)
            return episodes

        return run

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:  # noqa: ANN401 - Gymnasium's signature
        """Call a method of each lane, or get an attribute, as Gymnasium's `SyncVectorEnv`.

        All lanes are one environment, so what they share cannot be set for some of them.

        Parameters
        ----------
        name
            ``"render"``, ``"drawn"``, ``"get_state"`` (for `MovingMassEnv.set_state`), ``"close"``,
            or the name of an attribute.
        *args, **kwargs
            Those of the method.

        Raises
        ------
        AttributeError
            If `MovingMassEnv` has nothing of this name, or a method that one lane cannot run by
            itself, such as ``"step"``.
        """
        if name in self._own:
            return self._own[name]
        value = getattr(self, SINGLE.get(name, name))
        if name == "get_state":
            return tuple(self._state_of(lane) for lane in range(self.num_envs))
        if name in {"render", "drawn", "close"}:
            value = cast("Callable[..., object]", value)(*args, **kwargs)
        elif callable(value) or name.startswith("_"):
            msg = f"{name}: a single lane cannot run it; call it on the vector environment"
            raise AttributeError(msg)
        if name in {"render", "drawn", "state"} and value is not None:
            return tuple(cast("NDArray[Any]", value))
        return (value,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each lane, see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: object) -> None:
        """Set an attribute of the caller's own in each lane.

        Parameters
        ----------
        name
            A name that the environment does not use.
        values
            A list or tuple with a value for each lane, or one value for all.

        Raises
        ------
        ValueError
            If the number of values is another one than that of lanes, or the environment uses the
            name: its attributes follow from the scene, and setting them would have no effect.
        """
        if not isinstance(values, list | tuple):
            values = (values,) * self.num_envs
        given = tuple(cast("tuple[object, ...]", values))
        if len(given) != self.num_envs:
            refuse(name, f"{len(given)} values", f"one, or {self.num_envs} of them", ValueError)
        if hasattr(self, name):
            owner = "the environment's own, which follows from its scene"
            msg = f"{name}: {owner}; allowed: a new name"
            raise ValueError(msg)
        self._own[name] = given

    def _state_of(self, lane: int) -> Mapping[str, object]:
        """Return the state of a lane as `MovingMassEnv.set_state` takes it."""
        state = self.get_state()
        finished = cast("NDArray[np.bool_]", state.pop("finished"))
        columns = {
            name: value[..., lane : lane + 1].copy() if is_array(value) else value
            for name, value in state.items()
        }
        return columns | {"running": not bool(finished[lane])}


def _shortened(scene: Scene, max_episode_steps: int | None) -> Scene:
    """Return a scene whose episodes end where Gymnasium asks; -1 is its word for no limit."""
    if max_episode_steps is None or max_episode_steps == -1:
        return scene
    steps = whole_number("max_episode_steps", max_episode_steps)
    if steps > scene.control.steps:
        longer = f"for longer episodes pass changes={{'control.steps': {steps}}}"
        allowed = f"1 to {scene.control.steps}, the scene's control.steps; {longer}"
        refuse("max_episode_steps", f"{steps}", allowed)
    return scene.replace(**{"control.steps": steps})


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view through which nothing can be written."""
    view = array.view()
    view.flags.writeable = False
    return view


class Ends:
    """Last outputs of lanes, for `final_obs` and `final_info`, laid out as by `SyncVectorEnv`.

    Without copies they are memory that the next call overwrites: to make an array for each
    observation takes longer than the control step.
    """

    def __init__(self, lanes: Lanes, *, copy: bool) -> None:
        self._lanes, self._copy = lanes, copy
        self._memory: tuple[Any, ...] = ()
        self._former = np.empty(0, np.int64)

    def of(self, over: NDArray[np.int64]) -> tuple[NDArray[np.object_], Array, Array]:
        """Return the outputs of the lanes listed, before they begin anew.

        They are observations (lanes,), None in other lanes, and states (lanes, 4) and what was
        applied (lanes, actuators), zero in other lanes.
        """
        memory, former = self._memory, self._former
        if not memory:
            memory = self._allocated(len(over) if self._copy else self._lanes.count)
        written, rows, observations, state, applied = memory
        self._lanes.copy_ends(over, former, *written)
        observations[former] = None
        observations[over] = rows[: len(over)]
        if not self._copy:
            self._memory, self._former = memory, over
        return observations, state, applied

    def _allocated(self, count: int) -> tuple[Any, ...]:
        """Return memory for some lanes' observations: the kernel's, and then what `of` returns."""
        _, _, _, state, applied = self._lanes.outputs
        observed = np.empty((count, len(self._lanes.observed)), np.float32)
        values = np.zeros((self._lanes.count, len(state) + len(applied)))
        views = observed.view(), values[:, : len(state)], values[:, len(state) :]
        for view in views:
            view.flags.writeable = self._copy
        rows = np.fromiter(views[0], dtype=object, count=count)
        return (observed, values), rows, np.empty(self._lanes.count, dtype=object), *views[1:]
