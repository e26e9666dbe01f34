"""`MovingMassVectorEnv`: many lanes of one plant behind Gymnasium's vector interface."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mm_gym.env.arguments import (
    checked_actions,
    checked_autoreset_mode,
    checked_count,
    checked_mask,
    checked_options,
    checked_seeds,
    flag_of,
    flags_of,
    python_integer,
    scene_of,
)
from mm_gym.env.closed_loop import CanCloseLoop
from mm_gym.env.ends import Ends
from mm_gym.env.lane_access import LaneAccess
from mm_gym.env.pickling import Picklable
from mm_gym.env.pictures import RENDER_MODES, rendered, renderer_of
from mm_gym.env.seeding import Seeded
from mm_gym.env.spaces import action_space, observation_space
from mm_gym.env.specification import Specified
from mm_gym.env.terms import Terms, checked_level
from mm_gym.errors import SceneError
from mm_gym.lanes import layout as at
from mm_gym.plant.compile import compile_scene
from mm_gym.rendering.playback import frames_per_second
from mm_gym.simulation.lanes import Lanes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from gymnasium import Space
    from numpy.typing import ArrayLike, NDArray

    from mm_gym.env.arguments import Changes, SceneLike, Seeds
    from mm_gym.env.own_reward import RewardLike
    from mm_gym.env.terms import InfoLevel
    from mm_gym.scene.scene import Scene


class MovingMassVectorEnv(  # pyright: ignore[reportIncompatibleVariableOverride] - Gymnasium declares `spec` an attribute
    Specified,
    Seeded,
    LaneAccess,
    CanCloseLoop,
    Picklable,
    VectorEnv[np.ndarray, np.ndarray, np.ndarray],
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
        self.num_envs = checked_count(num_envs, "num_envs")
        self._level = checked_level(info)
        self.scene = _shortened(scene_of(scene, changes, reward), max_episode_steps)
        self.render_mode = render_mode
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.metadata = MovingMassVectorEnv.metadata | {"autoreset_mode": self.autoreset_mode}
        self._copy = copy
        self._threads = checked_count(threads, "threads")
        self._seeded = False
        self._own = {}
        self._prepare()
        self.metadata["render_fps"] = frames_per_second(self.plant)
        self.single_action_space = action_space(self.plant)
        self.single_observation_space: Space[Any] = observation_space(self.plant)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._shape = (self.num_envs, *self.single_action_space.shape)

    def _prepare(self) -> None:
        """Compile the scene, and make the lanes and views of their outputs."""
        self.plant = compile_scene(self.scene)
        self._lanes = lanes = Lanes(self.plant, self.num_envs, self._threads, self.scene.own_reward)
        self._ends = Ends(lanes, copy=self._copy)
        self._terms = Terms(self.plant, own=self.scene.own_reward is not None)
        self._rewards = {name: np.zeros(self.num_envs) for name in self._terms.names}
        self._views = [_read_only(array.T) for array in lanes.outputs]
        self._renderer = renderer_of(self.scene, lanes, self.render_mode)
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
    def state(self) -> NDArray[np.float64]:
        """States (num_envs, 4): x1, x2 [m], v1, v2 [m/s] in the ground frame, as a copy."""
        return self._lanes.values[:4].copy().T

    def drawn(self, name: str) -> NDArray[np.float64]:
        """Return every lane's current value of a field by its dotted name, see `MovingMassEnv`."""
        return self._lanes.drawn(name).copy()

    def reset(
        self,
        *,
        seed: Seeds | None = None,
        options: Mapping[str, ArrayLike] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
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
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
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
        if self._level == "full" and status <= at.ENDED:
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
        if status > at.ENDED:
            if status != at.NOT_FINITE:  # refused actions change nothing
                self._over = np.arange(self.num_envs)
            lanes.raise_for(status)
        if self._over.size:
            self._restart(paused=True)
        if status == at.ENDED:
            self._over = lanes.ended()
            if self._over.size and self.autoreset_mode is AutoresetMode.SAME_STEP:
                final = self._final()
                self._restart()
                return final
        return None

    def _finished(self) -> NDArray[np.bool_]:
        """Return the mask of the lanes whose episodes are over."""
        mask = np.zeros(self.num_envs, np.bool_)
        mask[self._over] = True
        return mask

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
        return {
            "final_obs": observations,
            "_final_obs": mask,
            "final_info": info | masks,
            "_final_info": mask,
        }

    def _outputs(self, copies: Sequence[NDArray[Any]] | None = None) -> Sequence[NDArray[Any]]:
        """Return observations, terminated, truncated, states and what was applied."""
        observed, terminated, truncated, state, applied = self._views
        if self._copy and (copies is not None or self._level != "none"):
            observed, terminated, truncated, state, applied = copies or self._lanes.copies()
            return observed, terminated, truncated, state.T, applied.T
        if self._copy:
            observed = self._lanes.observations()
        return observed, terminated.copy(), truncated.copy(), state, applied

    def _info(self, state: NDArray[np.float64], applied: NDArray[np.float64]) -> dict[str, Any]:
        everywhere = self._everywhere
        if self._level == "light":  # the common case
            return {
                "state": state,
                "_state": everywhere,
                "applied": applied,
                "_applied": everywhere,
            }
        entries = self._entries(state, applied)
        return entries | {f"_{name}": everywhere for name in entries}

    def _entries(
        self, state: NDArray[np.float64], applied: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Return the entries of the information, of all lanes."""
        if self._level == "none":
            return {}
        entries = {"state": state, "applied": applied}
        if self._level == "light":
            return entries
        return entries | self._rewards_and_limits()

    def _rewards_and_limits(self) -> dict[str, NDArray[np.float64]]:
        copies = {name: row.copy() for name, row in self._rewards.items()}
        return copies | self._terms.constraint(self._lanes.values[:4])

    def get_state(self) -> dict[str, object]:
        """Return the exact state of all lanes, including their random streams, for `set_state`.

        The last axis of every array is that of the lanes. You may repeat, permute or leave out
        lanes to make the state of another number of lanes.
        """
        flags = {"finished": self._finished(), "seeded": self._seeded}
        return self._lanes.snapshot() | flags

    def set_state(self, state: Mapping[str, object]) -> None:
        """Continue from what `get_state` returned; raise `SceneError` if it does not fit."""
        finished = flags_of(state, "finished", self.num_envs)
        seeded = flag_of(state, "seeded")
        self._lanes.restore(state, finished)
        self._over = np.flatnonzero(finished)
        self._seeded = seeded
        if self._renderer is not None:
            self._renderer.note(watched=False)

    def render(self) -> tuple[Any, ...] | None:
        """Return for every lane what `MovingMassEnv.render` returns; "human" shows up to nine."""
        frames = rendered(self._renderer, self.render_mode)
        return None if frames is None else tuple(frames)

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401, ARG002 - Gymnasium's signature
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()


def _shortened(scene: Scene, max_episode_steps: int | None) -> Scene:
    """Return a scene whose episodes end where Gymnasium asks; -1 is its word for no limit."""
    if max_episode_steps is None or max_episode_steps == -1:
        return scene
    steps = checked_count(max_episode_steps, "max_episode_steps")
    if steps > scene.control.steps:
        msg = (
            f"max_episode_steps: got {steps}; allowed: 1 to {scene.control.steps}, the scene's "
            f"control.steps; for longer episodes pass changes={{'control.steps': {steps}}}"
        )
        raise SceneError(msg)
    return scene.replace(**{"control.steps": steps})


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view through which nothing can be written."""
    view = array.view()
    view.flags.writeable = False
    return view
