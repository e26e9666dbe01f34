"""Lanes: the columns of state that the kernels work on.

One object serves the simulation, the single and the vector environment.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, TypeGuard, TypeVar

import numpy as np

from mm_gym.errors import ActionError, SceneError, SimulationError
from mm_gym.kernels import episodes
from mm_gym.kernels import layout as at
from mm_gym.kernels.excitation import begin_excitation
from mm_gym.kernels.jit import entry_point
from mm_gym.kernels.outputs import copy_outputs
from mm_gym.kernels.random import seed_streams
from mm_gym.simulation.threads import Threads

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.plant.plant import Plant

    Values = NDArray[np.float64]

Number = TypeVar("Number", bound=np.generic)

SNAPSHOT = ("values", "streams", "frames", "terminated", "truncated")
"""The arrays that make up the present of a set of lanes."""

SHOWN_LANES = 5
"""At most so many are named in a message."""

CACHE_LINE = 64
"""Bytes. Rows begin on a cache line, so that no vector of lanes straddles two."""

PAGE = 512
"""Numbers of eight bytes after which addresses collide in the first-level cache."""


class Lanes:
    """Independent copies of a plant, each in an episode of its own.

    Attributes
    ----------
    values
        (rows, count) float64, see `mm_gym.kernels.layout`.
    streams
        (2, count) uint64: key and counter of each lane's random numbers.
    frames, observed
        ((history + delay) * channels, count) float32: the history, oldest frame first, and its rows
        that are observed.
    terminated, truncated
        (count,) bool: how the last control step ended.
    shown
        Views of what a control step shows: observed, rewards, terminated, truncated, states (4,
        count) and what was applied (actuators, count).
    are_threaded
        Whether several threads share them.
    advance
        actions -> status: make one control step of all lanes. The actions are (actuators, count),
        float32 or float64, flat in C order.
    rest
        mask -> status: let lanes rest at zero.

    Notes
    -----
    `values` and `frames` are views of longer rows, see `rows_of`; the kernels work on those.
    """

    def __init__(self, plant: Plant, count: int, threads: int = 1) -> None:
        self.plant = plant
        self.count = count
        self._values = rows_of(len(plant.template), count, np.float64)
        for row in np.flatnonzero(plant.template):  # others need no memory until they are used
            self._values[row] = plant.template[row]
        frames = (plant.history + plant.delay) * len(plant.channels)
        self._frames = rows_of(frames, count, np.float32)
        self._ends = rows_of(3, count, np.bool_)
        self.values, self.frames = self._values[:, :count], self._frames[:, :count]
        self.observed = self.frames[: plant.history * len(plant.channels)]
        self.terminated, self.truncated = self._ends[: at.MARKED, :count]
        self.streams = np.zeros((2, count), np.uint64)
        first = at.FORCE if "force" in plant.actuators else at.STRETCH
        self.applied_rows = slice(first, at.STRETCH + ("stretch" in plant.actuators))
        self.shown: tuple[NDArray[Any], ...] = (
            self.observed,
            self.values[at.REWARD],
            self.terminated,
            self.truncated,
            self.values[:4],
            self.values[self.applied_rows],
        )
        self._threads = Threads(count, threads)
        self.are_threaded = self._threads.are_several
        self._unfixed = self._laid_out({})
        self._bind_steps()
        self._bind_episodes()

    def advance_of(self, precision: np.dtype[Any]) -> Callable[..., int]:
        """Return (actions, first, last) -> status: `advance` for this precision, in less time.

        Nobody looks at the actions' type: others are misread.
        """
        actions = np.zeros(self.count * len(self.plant.actuators), precision)
        advance = self.plant.method.entries.advance
        entry = entry_point(advance, *self._present, actions, 0, self.count)
        return partial(entry, *self._present)

    def _bind_steps(self) -> None:
        bind, advance = self._threads.bind, self.plant.method.entries.advance
        rows = (self._values, self._frames, self._ends)
        constants = np.concatenate([self.plant.task, self.plant.model])
        shown = (*rows, self.applied_rows.start)
        self._present = (constants, *rows, self.streams)
        self.advance = bind(advance, *self._present)
        self._copy_outputs = bind(copy_outputs, *shown)
        self._advance_and_copy_outputs = bind(advance, *self._present, then=(copy_outputs, shown))

    def _bind_episodes(self) -> None:
        bind, values, streams = self._threads.bind, self._values, self.streams
        template, draws, model, task = (
            self.plant.template,
            self.plant.draws,
            self.plant.model,
            self.plant.task,
        )
        self._start = bind(episodes.start, template, draws, model, task, values, streams)
        self._begin_excitation = bind(begin_excitation, model, values, streams)
        self._show = bind(
            episodes.show_first, model, task, values, self._frames, self._ends, streams
        )
        self.rest = bind(episodes.rest, values)

    def seed(self, seed: int | Sequence[int | None], mask: NDArray[np.bool_] | None = None) -> None:
        """Give lane i of the mask the random stream of seed + i, or of seed[i], modulo 2**64."""
        if isinstance(seed, int):
            keys = np.arange(self.count, dtype=np.uint64) + np.uint64(seed % 2**64)
            given = np.ones(self.count, np.bool_)
        else:
            keys = np.array([(value or 0) % 2**64 for value in seed], np.uint64)
            given = np.array([value is not None for value in seed], np.bool_)
        seed_streams(self.streams, keys, given if mask is None else given & mask)

    def restart(
        self,
        mask: NDArray[np.bool_] | None = None,
        fixed: Mapping[int, Values] | None = None,
        *,
        seen: bool = True,
        paused: bool = False,
    ) -> None:
        """Begin a new episode in the lanes of the mask (all by default).

        Parameters
        ----------
        fixed
            Rows to set instead of what is drawn, from `checked`.
        seen
            Whether anyone looks at the frames; if not, they are written only where the sensors'
            noise is drawn, so that what is drawn after it does not depend on who looks.
        paused
            Whether they begin anew instead of making a control step: they earn nothing in it, and
            end nothing. It is seen.
        """
        plant = self.plant
        if mask is None:
            mask = np.ones(self.count, np.bool_)
        rows, values = self._unfixed if not fixed else self._laid_out(fixed)
        self._start(mask, rows, values)
        if plant.support.sampled:
            self._begin_excitation(mask)
        if seen or plant.task[at.IS_NOISY]:
            self._show(mask, paused)

    def _laid_out(self, fixed: Mapping[int, Values]) -> tuple[NDArray[np.int64], Values]:
        """Return rows and their values (rows, count)."""
        values = np.empty((len(fixed), self.count))
        for k, value in enumerate(fixed.values()):
            values[k] = value
        return np.array(list(fixed), np.int64), values

    def drawn(self, name: str) -> Values:
        """Return the row of a field by dotted name; raise `SceneError` if it changes in a step."""
        row = self.plant.support.row_of(name)
        if row <= at.STRETCH:
            msg = f"{name}: changes in every step; allowed: fields that an episode keeps"
            raise SceneError(msg)
        return self.values[row]

    def checked(self, fixed: Mapping[str, ArrayLike]) -> dict[int, Values]:
        """Return rows and values of fields by dotted name, a number or one per lane.

        Raises
        ------
        SceneError
            If a name is unknown, or a value is not a number within the scene's support.
        """
        support = self.plant.support
        return {support.row_of(name): self._checked(name, value) for name, value in fixed.items()}

    def _checked(self, name: str, value: ArrayLike) -> Values:
        support, array = self.plant.support, array_of(value, name)
        if array.dtype.kind not in "fiu" or array.shape not in ((), (self.count,)):
            msg = f"{name}: got {value!r}; allowed: a number, or {self.count} of them"
            raise SceneError(msg)
        row = support.row_of(name)
        largest = np.finfo(np.float64).max
        low, high = (-largest, largest) if row < at.FORCE else (support.low[row], support.high[row])
        if not np.all((array >= low) & (array <= high)):
            msg = (
                f"{name}: got {value}; allowed: {low:g} to {high:g}, which this scene was "
                "compiled for"
            )
            raise SceneError(msg)
        return array.astype(np.float64)

    def copies(self) -> list[NDArray[Any]]:
        """Return copies of what a control step shows."""
        if not self.are_threaded:
            return [array.copy() for array in self.shown]
        copies = self._space()
        self._copy_outputs(*copies)
        return copies

    def advance_and_copy(self, actions: NDArray[np.floating]) -> tuple[int, list[NDArray[Any]]]:
        """Make a control step of all lanes; return its status and copies of what it shows.

        Each thread copies what it has just written: they meet once, not twice.
        """
        copies = self._space()
        return self._advance_and_copy_outputs(actions, *copies), copies

    def _space(self) -> list[NDArray[Any]]:
        """Return arrays for copies of what is shown."""
        return [np.empty(array.shape, array.dtype) for array in self.shown]

    def raise_for(self, status: int) -> None:
        """Raise the error that a status code stands for, if it is one."""
        if status > at.NOT_FINITE:
            msg = f"{self.plant.method.name}{self._lost()}: {at.MESSAGES[status]}"
            raise SimulationError(msg)
        if status == at.NOT_FINITE:
            msg = "action: got NaN or infinity; allowed: finite numbers. Nothing was changed"
            raise ActionError(msg)

    def _lost(self) -> str:
        """Name the lanes whose state or cost is not finite, if there are several to tell apart."""
        rows = self.values[[at.X1, at.X2, at.V1, at.V2, at.REWARD]]
        lost = np.flatnonzero(~np.isfinite(rows).all(axis=0))
        if self.count == 1 or not lost.size:
            return ""
        shown = ", ".join(map(str, lost[:SHOWN_LANES]))
        return f", lane {shown}" + (", ..." if lost.size > SHOWN_LANES else "")

    def snapshot(self) -> dict[str, object]:
        """Return everything that the lanes are, as copies, for `restore`."""
        arrays = {name: getattr(self, name).copy() for name in SNAPSHOT}
        return {"scene": self.plant.digest, **arrays}

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Continue from a snapshot of the same scene and as many lanes.

        Raises
        ------
        SceneError
            If it belongs to another scene, lacks an array, or an array has not this one's form.
        """
        wrong = [name for name in ("scene", *SNAPSHOT) if name not in snapshot]
        if wrong:
            msg = f"state: {', '.join(wrong)} missing; use what get_state returned"
            raise SceneError(msg)
        if snapshot["scene"] != self.plant.digest:
            msg = f"state: it belongs to scene {snapshot['scene']}; this one is {self.plant.digest}"
            raise SceneError(msg)
        for name in SNAPSHOT:
            array, own = snapshot[name], getattr(self, name)
            if not is_array(array) or (array.shape, array.dtype) != (
                own.shape,
                own.dtype,
            ):
                msg = f"state.{name}: allowed: an array of shape {own.shape} and type {own.dtype}"
                raise SceneError(msg)
        for name in SNAPSHOT:
            getattr(self, name)[...] = snapshot[name]
        self._ends[at.MARKED] = True


def array_of(value: ArrayLike, name: str) -> NDArray[Any]:
    """Return the value as an array, or raise `SceneError` if its parts differ in shape."""
    try:
        return np.asarray(value)
    except ValueError as error:
        msg = f"{name}: got {value!r}; allowed: a number, or as many as there are lanes: {error}"
        raise SceneError(msg) from None


def is_array(value: object) -> TypeGuard[NDArray[Any]]:
    """Tell whether a value is an array, of any type."""
    return isinstance(value, np.ndarray)


def rows_of(rows: int, count: int, dtype: type[Number]) -> NDArray[Number]:
    """Return zeroed rows of at least `count` columns, laid out for the cache.

    They begin on a cache line. Long rows are padded to an odd number of half pages and a bit: were
    they a multiple of a page apart, a lane's entries in all rows would compete for the same few
    places of the first-level cache.
    """
    length = count if count < PAGE else count + (PAGE // 2 + 40 - count) % PAGE
    size = rows * length * np.dtype(dtype).itemsize
    buffer = np.zeros(size + CACHE_LINE, np.uint8)
    start = -buffer.ctypes.data % CACHE_LINE
    return buffer[start : start + size].view(dtype).reshape(rows, length)
