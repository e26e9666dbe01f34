"""Lanes: the columns of state that the kernels work on.

One class serves the simulation, the single and the vector environment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array, Single
from mm_gym.compiler.jit import LINKED, entry_point, plain
from mm_gym.compiler.notice import expect
from mm_gym.errors import ActionError, SceneError, SimulationError, refuse
from mm_gym.excitation.kinds import begin_excitation
from mm_gym.lanes import layout
from mm_gym.lanes.memory import rows_of
from mm_gym.lanes.random import COUNT, EPISODE, KEY, seed_streams, uniform
from mm_gym.lanes.threads import nothing
from mm_gym.law.dry_friction import write_regimes
from mm_gym.plant.plant import Plant
from mm_gym.scene.scene import Reward
from mm_gym.simulation.checks import check_snapshot, check_values, checked_fields, checked_seed
from mm_gym.simulation.failures import text_of
from mm_gym.simulation.threads import Threads
from mm_gym.step import episodes
from mm_gym.step.outputs import copy_ends, copy_observed, copy_outputs

SEVERAL = 64  # lanes that are restarted together take less time gathered, if there are so many

STATE_ARRAYS = ("values", "streams", "frames", "terminated", "truncated")
"""The arrays that make up the state of a set of lanes."""


class Lanes:
    """Independent copies of a plant, each in an episode of its own.

    Parameters
    ----------
    plant
        What moves.
    count, threads
        Number of lanes, and of threads that step them.
    own_reward
        What replaces the rewards of each control step, if it is not the scene's objective.

    Attributes
    ----------
    values
        (rows, count) float64, see `mm_gym.lanes.layout`.
    streams
        (2, count) uint64: key and counter of each lane's random numbers.
    frames, observed
        (`Plant.frames` * channels, count) float32: the history, oldest frame first, and its rows
        that are observed.
    terminated, truncated
        (count,) bool: how the last control step ended.
    rewards
        (count,) float64: those of the last control step. The next one writes into this array, in
        place of which the caller may put his own before it.
    outputs
        Views of a control step's other outputs: observed, terminated, truncated, states (4, count)
        and what was applied (actuators, count).
    are_threaded
        Whether several threads step them.
    rest
        (actions, lanes) -> status: let the lanes listed rest at zero, if all actions are finite.
    copy_ends
        (which, former, observed, values) -> status: copy the last outputs of the lanes listed, see
        the kernel.

    Notes
    -----
    `values` and `frames` are views of longer rows, see `rows_of`; the kernels work on those.
    """

    def __init__(
        self, plant: Plant, count: int, threads: int = 1, own_reward: Reward | None = None
    ) -> None:
        self.plant = plant
        self.count = count
        self.own_reward = own_reward
        self._allocate()
        self._advance = plant.entries.advance_of(
            plant.task, plant.model, self._frames, excited=plant.support.sampled
        )
        moved = self.values[:4], self.values[self.applied_rows]
        self.outputs: tuple[NDArray[Any], ...] = (
            *(self.observed, self.terminated, self.truncated),
            *moved,
        )
        self._threads = Threads(count, threads)
        self.are_threaded = self._threads.are_several
        self._nothing_fixed = self._rows_and_values({})
        # Rows of the initial state that were given: NaN where drawn, infinite where not known.
        self._given: dict[int, Array] = {}
        self._as_drawn = np.full(count, np.nan)
        # Looked up once: with few lanes to restart, that takes longer than they do.
        self._products, self._is_excited = plant.support.products, plant.support.sampled
        self._reserves = bool(plant.task[layout.RESERVED])
        is_derived = bool(plant.task[layout.IS_DERIVED])
        self._can_gather = not (self._products or self._is_excited or is_derived)
        self._bind_steps()
        self._bind_episodes()
        expect(self._advance, episodes.start, episodes.show_first)
        if plant.support.sampled:
            expect(begin_excitation)

    def _allocate(self) -> None:
        plant, count = self.plant, self.count
        # Behind the rows of each, room for those of lanes that restart together.
        rows, frames = len(plant.template), plant.frames * len(plant.channels)
        self._all_values = rows_of(2 * rows, count, np.float64)
        self._all_frames = rows_of(frames + len(plant.channels), count, np.float32)
        self._all_streams = np.zeros((4, count), np.uint64)
        self._values, self._frames = self._all_values[:rows], self._all_frames[:frames]
        self.streams = self._all_streams[:2]
        for row in np.flatnonzero(plant.template):  # others need no memory until they are used
            self._values[row] = plant.template[row]
        self._ends = rows_of(3, count + -count % 8, np.bool_)
        self.values, self.frames = self._values[:, :count], self._frames[:, :count]
        self.observed = self.frames[: plant.history * len(plant.channels)]
        self.terminated, self.truncated = self._ends[: layout.MARKED, :count]
        self.rewards = np.zeros(count)
        self.applied_rows = applied_rows(plant.actuators)

    def _bind_steps(self) -> None:
        bind, advance = self._threads.bind, self._advance
        rows = (self._values, self._frames, self._ends)
        self._constants = np.concatenate([self.plant.task, self.plant.model])
        simply = advance is self.plant.entries.advance_simply
        kernels = np.zeros(3, np.int64) if simply and LINKED else self.kernels
        held = np.array([self.applied_rows.start, self.applied_rows.step])  # threads take arrays
        outputs = (*rows, held)
        self._step_arguments = (self._constants, kernels, *rows, self.streams)
        self._advance_all = bind(advance, *self._step_arguments)
        self._copy_outputs = bind(copy_outputs, *outputs)
        self._copy_observed = bind(copy_observed, self._frames)
        self.copy_ends = bind(copy_ends, self._values, self._frames, held)
        self._advance_and_copy = bind(advance, *self._step_arguments, then=(copy_outputs, outputs))

    def _bind_episodes(self) -> None:
        bind, values, streams = self._threads.bind, self._values, self.streams
        start = self.plant.template, self.plant.draws, self._constants
        self._start = bind(episodes.start, *start, values, streams)
        self._begin_excitation = bind(begin_excitation, self.plant.model, values, streams)
        self._show = bind(
            episodes.show_first, *self._step_arguments[:2], values, self._frames, streams
        )
        self.rest = bind(episodes.rest, values)
        ends = self._ends
        self._listing = ends, ends.view(np.uint64), np.zeros(ends.shape[1], np.int64)

    @cached_property
    def kernels(self) -> Any:  # noqa: ANN401 - as of `Entries`
        """What a control step calls, as of `Entries.kernels`: to look it up takes longer."""
        plant = self.plant
        return plant.entries.kernels(
            plant.task, plant.model, self._values, excited=self._is_excited
        )

    @cached_property
    def _list_ended(self) -> Callable[..., int]:
        """Compiled when it is first used: a single environment does without."""
        return entry_point(episodes.list_ended, *self._listing)

    @cached_property
    def _restart_gathered(self) -> Callable[..., int]:
        """Bound and compiled when it is first used, as `_list_ended`."""
        plant, count = self.plant, self.count
        start = plant.template, plant.draws
        lists = episodes.lists_of_start(*start, plant.model, plant.task, count)
        rows = self._all_values, self._all_streams, self._all_frames
        return self._threads.bind(episodes.restart_gathered, *start, self._constants, *rows, lists)

    @cached_property
    def _pause(self) -> Callable[..., None]:
        """Compiled when it is first used, as `_list_ended`."""
        return entry_point(episodes.pause, self._ends, self.rewards, self._listing[2])

    def advance_of(self, precision: np.dtype[Any]) -> Callable[..., int]:
        """Return (actions, rewards, first, last) -> status: `advance` for one dtype of actions.

        It takes less time than `advance`, because it does not check the dtype.
        """
        actions = np.zeros(self.count * len(self.plant.actuators), precision)
        advance, arguments = self.step_with(actions)
        step = partial(entry_point(advance, *arguments), *self._step_arguments)
        if self.own_reward is None:
            return step

        def step_and_reward(
            actions: NDArray[np.floating], rewards: Array, first: int, last: int
        ) -> int:
            return self._rewarded(step(actions, rewards, first, last), rewards)

        return step_and_reward

    def reward_with(self) -> tuple[Callable[..., int], tuple[Any, ...]]:
        """Return the kernel that replaces the rewards of a control step, and its arguments."""
        if self.own_reward is None:
            return nothing, (0, self.count)
        return self.own_reward.kernel, (self._values, self.rewards, 0, self.count)

    def _rewarded(self, status: int, rewards: Array) -> int:
        """Replace the rewards of a step of some status, if there is an own one."""
        if self.own_reward is None or status > layout.ENDED:
            return status
        return max(status, self.own_reward.kernel(self._values, rewards, 0, self.count))

    def step_with(
        self, actions: NDArray[np.floating]
    ) -> tuple[Callable[..., int], tuple[Any, ...]]:
        """Return the kernel of a control step, and its arguments for all lanes.

        They are these actions, as `advance` takes them, and the present array of rewards.
        """
        return self._advance, (*self._step_arguments, actions, self.rewards, 0, self.count)

    def advance(self, actions: NDArray[np.floating]) -> int:
        """Make one control step of all lanes; return its status.

        The actions are (actuators, count), float32 or float64, flat in C order.
        """
        return self._rewarded(self._advance_all(actions, self.rewards), self.rewards)

    def ended(self) -> NDArray[np.int64]:
        """Return the lanes whose episodes the last control step ended, in ascending order."""
        ends, eights, which = self._listing
        return which[: self._list_ended(ends, eights, which)].copy()

    def advance_and_copy(self, actions: NDArray[np.floating]) -> tuple[int, list[NDArray[Any]]]:
        """Make a control step of all lanes; return its status and what `copies` returns.

        Each thread copies the outputs that it has just written, so the threads are started once,
        not twice.
        """
        empty = self._empty_outputs()
        status = self._advance_and_copy(actions, self.rewards, *empty)
        return self._rewarded(status, self.rewards), _one_by_one(*empty)

    def copies(self) -> list[NDArray[Any]]:
        """Return copies of the outputs, what is observed as `observations` does."""
        if not self.are_threaded:
            return [self.observations(), *(array.copy() for array in self.outputs[1:])]
        empty = self._empty_outputs()
        self._copy_outputs(*empty)
        return _one_by_one(*empty)

    def observations(self) -> Single:
        """Return a copy of what is observed, (count, k): programs store each lane's together."""
        observed = np.empty(self.observed.shape[::-1], np.float32)
        self._copy_observed(observed)
        return observed

    def _empty_outputs(self) -> tuple[NDArray[Any], ...]:
        """Return arrays for what is observed, the ends, the states and what was applied."""
        *_, states, applied = self.outputs
        return (
            np.empty(self.observed.shape[::-1], np.float32),
            np.empty((layout.MARKED, self.count), np.bool_),
            np.empty(states.shape),
            np.empty(applied.shape),
        )

    def seed(self, seed: int | Sequence[int | None], mask: NDArray[np.bool_] | None = None) -> None:
        """Give lane i of the mask the random stream of seed + i, modulo 2**64, or of seed[i]."""
        if isinstance(seed, int):
            keys = np.arange(self.count, dtype=np.uint64) + np.uint64(checked_seed(seed))
            given = np.ones(self.count, np.bool_)
        else:
            keys = np.array([checked_seed(value or 0) for value in seed], np.uint64)
            given = np.array([value is not None for value in seed], np.bool_)
        seed_streams(self.streams, keys, given if mask is None else given & mask)

    def restart(
        self,
        which: NDArray[np.int64] | None = None,
        fixed: Mapping[int, Array] | None = None,
        *,
        seen: bool = True,
        paused: bool = False,
    ) -> None:
        """Begin a new episode in the lanes listed, in ascending order (all by default).

        Parameters
        ----------
        fixed
            Rows to set instead of what is drawn, from `checked`.
        seen
            Whether the first frames are needed. If not, they are written only where random numbers
            are reserved for them, so that later draws do not depend on this option.
        paused
            Whether the lanes restart instead of making a control step: its reward is zero, and it
            ends no episode.
        """
        if which is None:
            which = np.arange(self.count)
        self._note_given(which, fixed or {})
        if paused:
            self._pause(self._ends, self.rewards, which)
        are_apart = len(which) >= SEVERAL and which[-1] - which[0] >= len(which)
        if self._can_gather and seen and not fixed and are_apart:
            self._restart_gathered(which)
            return
        self._start(which, *(self._rows_and_values(fixed) if fixed else self._nothing_fixed))
        if self._products:
            self._multiply(which)
        if self._is_excited:
            self._begin_excitation(which)
        if seen or self._reserves:
            self._show(which)

    def _multiply(self, which: NDArray[np.int64]) -> None:
        """Write the fields that follow from a ratio, and the regimes of friction with them."""
        for row, ratio, other in self._products:
            self.values[row, which] = self.values[ratio, which] * self.values[other, which]
        write_regimes(self._values, 0, self.count)

    def _rows_and_values(self, fixed: Mapping[int, Array]) -> tuple[NDArray[np.int64], Array]:
        """Return rows and their values (rows, count), as the kernel reads them."""
        values = np.empty((len(fixed), self.count))
        for k, value in enumerate(fixed.values()):
            values[k] = value
        return np.array(list(fixed), np.int64), values

    def checked(self, fixed: Mapping[str, ArrayLike]) -> dict[int, Array]:
        """Return what `restart` takes as `fixed`, see `checked_fields`."""
        return checked_fields(fixed, self.plant.support, self.count)

    def drawn(self, name: str) -> Array:
        """Return the values (count,) of a field by dotted name, in the present episodes.

        Those of the initial state are drawn once more, so that no step has to keep them.

        Raises
        ------
        SceneError
            If the field is unknown, no episode has begun, or the start of a set state is asked for.
        """
        row, support = self.plant.support.row_of(name), self.plant.support
        episodes = self.streams[COUNT] >> np.uint64(EPISODE)
        if not episodes.all():
            msg = f"{name}: no episode has begun; call reset first"
            raise SceneError(msg)
        if row in support.idle:
            return np.full(self.count, support.idle[row])
        stays = row == layout.STRETCH and "stretch" not in self.plant.actuators
        if row > layout.DAMPING or stays:
            return self.values[row]
        given = self._given.get(row, self._as_drawn)
        if np.isinf(given).any():
            msg = f"{name}: a state was set, and does not tell how its episode began"
            raise SceneError(msg)
        places = np.flatnonzero(self.plant.draws[:, 0] == row)
        low, high = float(support.start_low[row]), float(support.start_high[row])
        began = np.full(self.count, low)
        if places.size:
            streams = np.array([self.streams[KEY], episodes << np.uint64(EPISODE)])
            streams[COUNT] += np.uint64(places[0])
            numbers = plain(uniform)(streams, slice(None))
            began = np.clip(low + (high - low) * numbers, low, high)
        return np.where(np.isnan(given), began, given)

    def _note_given(self, which: NDArray[np.int64], fixed: Mapping[int, Array]) -> None:
        """Note what is given in place of what an episode would draw of its initial state."""
        for row in (row for row in fixed if row <= layout.DAMPING):
            self._given.setdefault(row, self._as_drawn.copy())
        for row, values in self._given.items():
            values[which] = np.broadcast_to(fixed.get(row, np.nan), self.count)[which]

    def snapshot(self) -> dict[str, object]:
        """Return the state of all lanes, as copies, for `restore`.

        Each column is complete: repeated or in another order, columns make a snapshot too. A lane's
        clock, of which the kernels keep one a block, counts from its episode's start.
        """
        arrays = {name: array.copy() for name, array in self._state().items()}
        values = arrays["values"]
        values[layout.NOW] = self._blocks(values[layout.NOW]) - values[layout.BEGAN]
        values[[layout.BEGAN, layout.DUE]] = 0.0
        return {"scene": self.plant.digest, **arrays}

    def restore(self, snapshot: Mapping[str, Any], idle: NDArray[np.bool_] | None = None) -> None:
        """Restore a snapshot of the same scene and number of lanes.

        Parameters
        ----------
        snapshot
            What `snapshot` returned.
        idle
            (count,) bool: the lanes whose episodes are over; by default none.

        Raises
        ------
        SceneError
            If it belongs to another scene, an array is missing or has another shape or dtype, or
            lanes cannot have one of its values.
        """
        check_snapshot(snapshot, self.plant.digest, self._state())
        if idle is None:
            idle = np.zeros(self.count, np.bool_)
        check_values(snapshot["values"], snapshot["frames"], self.plant.support, idle)
        for name, array in self._state().items():
            array[...] = snapshot[name]
        age = self.values[layout.NOW] - self.values[layout.BEGAN]
        now = np.maximum.reduceat(age, np.arange(0, self.count, layout.BLOCK))
        self.values[layout.NOW, :: layout.BLOCK] = now
        self.values[layout.BEGAN] = self._blocks(self.values[layout.NOW]) - age
        self.values[layout.DUE] = 0.0  # the next step finds it
        self._ends[layout.MARKED] = True
        self._given = {row: np.full(self.count, np.inf) for row in range(layout.DAMPING + 1)}

    def _blocks(self, clock: Array) -> Array:
        """Return each lane's clock, from the first lanes of the blocks."""
        return np.repeat(clock[:: layout.BLOCK], layout.BLOCK)[: self.count]

    def _state(self) -> dict[str, NDArray[Any]]:
        return {name: getattr(self, name) for name in STATE_ARRAYS}

    def raise_for(self, status: int, unfinished: int = 0) -> None:
        """Raise the error that a status code stands for, if it is one.

        The number of unfinished control steps is that of those which the clock does not show yet.
        """
        if status == layout.UNREWARDED and self.own_reward is not None:
            lane = self.own_reward.first_fault(self.values)
            where = f"lane {lane}: " if self.count > 1 else ""
            msg = where + self.own_reward.fault(self.values[:, lane])
            raise SimulationError(msg)
        if status > layout.NOT_FINITE:
            age = self._blocks(self.values[layout.NOW]) - self.values[layout.BEGAN]
            age += unfinished
            raise SimulationError(text_of(self.plant, self.values, self.rewards, status, age))
        if status == layout.NOT_FINITE:
            refuse("action", "NaN or infinity", "finite numbers. Nothing was changed", ActionError)


def applied_rows(actuators: Sequence[str]) -> slice:
    """Return the rows of what actuators apply, in the order of the action."""
    rows = [layout.APPLIED[name] for name in actuators]
    first = rows[0] if rows else layout.STRETCH
    return slice(first, first if not rows else rows[-1] + 1, rows[1] - first if rows[1:] else 1)


def _one_by_one(
    observed: NDArray[Any], ended: NDArray[Any], *others: NDArray[Any]
) -> list[NDArray[Any]]:
    """Return these outputs as `Lanes.outputs` has them: the ends are two."""
    return [observed, *ended, *others]
