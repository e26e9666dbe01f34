"""The episode that methods are compared on, and the true ends of its sample intervals."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.kernels import layout as at
from mm_gym.methods.support import fastest_oscillation
from mm_gym.precision.oracle import Oracle
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import Place, blank, excitation, first, run

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.plant.plant import Plant
    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.recording import Recording

    Values = NDArray[np.float64]

MOST_STEPS = 100
"""Control steps of the episode."""

MOST_CHECKED = 10
"""Sample intervals of it that the oracle integrates."""

LONGEST_RUN = 0.02
"""Time [s] that `auto` may take for the episode; a longer one is cut short."""

PATIENCE = 4.0
"""Time [s] after which the oracle starts no further sample interval."""

ORACLES = (("DOP853", 2.3e-14), ("Radau", 1e-11))
"""Methods of the oracle with their tolerances; the second if the first takes too long."""

EVALUATIONS = 30_000
"""Evaluations of the forces that a sample interval may take: some 0.3 s, or 1 s with Radau."""


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode under random commands.

    Attributes
    ----------
    seed
        Seed of the scene's draws and of the commands.
    commands
        (n, 2) force [N] and stretch [-] commanded in each control step.
    recording
        The sample intervals that followed from them.
    """

    seed: int
    commands: Values
    recording: Recording

    @property
    def scale(self) -> Values:
        """(4,) the episode's largest position [m], twice, and largest velocity [m/s], twice."""
        known = np.abs(np.vstack([self.recording.starts, self.recording.states])).max(axis=0)
        scale = np.repeat([known[:2].max(), known[2:].max()], 2)
        return np.where(scale > 0.0, scale, 1.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """The ends of some sample intervals, by the oracle.

    Attributes
    ----------
    rows
        (k,) indices of the sample intervals.
    states
        (k, 4) states at their ends.
    oracle
        Method and tolerance of the oracle, in words.
    resolution
        Largest difference from a second, coarser integration, relative to the scale.
    """

    rows: NDArray[np.intp]
    states: Values
    oracle: str
    resolution: float


def record(plant: Plant, seed: int) -> Episode:
    """Run an episode under random commands, for at most `LONGEST_RUN`."""
    lanes, rng = Lanes(plant, 1), np.random.default_rng(seed)
    lanes.seed(seed)
    lanes.restart()
    count, many = min(plant.steps, MOST_STEPS), plant.support.intervals_per_step
    commands = _commands(plant, lanes, rng, count)
    recording = blank(plant, lanes.values[:, 0].copy(), count)
    began = time.perf_counter()
    for n in range(count):
        run(lanes, commands[n : n + 1], recording, n * many)
        if n == 0:
            began = time.perf_counter()  # the first call may compile
        elif time.perf_counter() - began > LONGEST_RUN:
            count = n + 1
            break
    return Episode(seed, commands[:count], first(recording, count * many))


def _commands(plant: Plant, lanes: Lanes, rng: np.random.Generator, count: int) -> Values:
    """Return uniformly random commands within the actuators' limits."""
    commands = np.empty((count, 2))
    commands[:] = 0.0, lanes.values[at.STRETCH, 0]
    if "force" in plant.actuators:
        limit = plant.task[at.FORCE_LIMIT]
        commands[:, 0] = rng.uniform(-limit, limit, count)
    if "stretch" in plant.actuators:
        low, high = plant.task[at.STRETCH_LOW], plant.task[at.STRETCH_HIGH]
        commands[:, 1] = rng.uniform(low, high, count)
    return commands


def truth_of(scene: Scene, plant: Plant, episode: Episode) -> Truth:
    """Integrate sample intervals spread over the episode with the oracle.

    Raises
    ------
    SimulationError
        If none of the oracle's methods completes a sample interval within `EVALUATIONS`.
    """
    drawn, problem = _drawn(scene, plant, episode), ""
    for method, rtol in ORACLES:
        try:
            # A trial step of SciPy may overflow; it then tries a shorter one.
            with np.errstate(over="ignore", invalid="ignore"):
                return _truth(_Pair.of(drawn, episode.recording, method, rtol), episode)
        except SimulationError as error:
            problem = str(error)
    msg = f"work_precision: SciPy cannot follow this scene, so errors are unknown: {problem}"
    raise SimulationError(msg)


@dataclass(frozen=True)
class _Pair:
    """The oracle and a coarser one, whose difference estimates the oracle's error."""

    fine: Oracle
    coarse: Oracle

    @classmethod
    def of(cls, scene: Scene, recording: Recording, method: str, rtol: float) -> _Pair:
        longest, support = np.inf, recording.plant.support
        if scene.interface.kind == "dry_friction":
            # SciPy sees an event only between two of its steps: some sixty in an oscillation.
            longest = min(0.1 / fastest_oscillation(support), support.sample_interval / 4.0)
        disturbance = _disturbance(recording) if support.sampled else None
        fine = Oracle(scene, method, rtol, longest, disturbance, EVALUATIONS)
        return cls(fine, replace(fine, rtol=10.0 * rtol, max_step=2.0 * longest))


def _disturbance(recording: Recording) -> Callable[[float, str], float]:
    """Return the recorded excitation; the oracle itself knows harmonics only."""

    def disturbance(time: float, target: str) -> float:
        row = int(time / recording.plant.support.sample_interval * (1.0 + 1e-12))
        part = time - row * recording.plant.support.sample_interval
        both = excitation(recording, Place(np.array([row]), np.array([part])))
        return float(both[0, int(target == "ground")])

    return disturbance


def _truth(pair: _Pair, episode: Episode) -> Truth:
    ends: dict[int, Values] = {}
    resolution, until = float(np.finfo(np.float64).eps), time.perf_counter() + PATIENCE
    for n in _spread(len(episode.recording.starts)):
        if ends and time.perf_counter() > until:
            break
        fine, coarse = (_end(oracle, episode, n) for oracle in (pair.fine, pair.coarse))
        ends[n] = fine
        resolution = max(resolution, float((np.abs(fine - coarse) / episode.scale).max()))
    text = f"SciPy's {pair.fine.method} at {pair.fine.rtol:.0e}"
    return Truth(np.array(list(ends)), np.array(list(ends.values())), text, resolution)


def _spread(count: int) -> list[int]:
    """Return indices spread evenly over the episode, in an order that soon covers all of it."""
    indices = np.unique(np.linspace(0, count - 1, MOST_CHECKED).astype(int))
    golden_ratio = 0.5 * (1.0 + np.sqrt(5.0))
    return indices[np.argsort(np.arange(len(indices)) * golden_ratio % 1.0)].tolist()


def _end(oracle: Oracle, episode: Episode, n: int) -> Values:
    """Return the state (4,) at the end of sample interval n, by the oracle."""
    recording = episode.recording
    interval, (force, stretch) = recording.plant.support.sample_interval, recording.applied[n]
    count = int(np.ceil((n + 1) * interval / oracle.scene.control.time_step)) + 1
    return replace(oracle).solve(  # a copy, because the budget of evaluations is for its life
        [(n + 1) * interval],
        forces=np.full(count, force),
        stretches=np.full(count, stretch),
        start=recording.starts[n],
        begin=n * interval,
    )[0]


def _drawn(scene: Scene, plant: Plant, episode: Episode) -> Scene:
    """Return the scene with drawn values in place of ranges, but for the initial state."""
    support = plant.support
    values: dict[str, object] = {
        name: float(episode.recording.parameters[row])
        for name, row in support.names.items()
        if support.start_low[row] != support.start_high[row] and not name.startswith("initial.")
    }
    return scene.replace(randomization={}, **values)
