"""The control steps that methods are compared on: where each begins, and where it truly ends."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.kernels import layout as at
from mm_gym.lanes import Lanes
from mm_gym.methods.base import fastest_oscillation
from mm_gym.reference import Oracle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.plant import Plant
    from mm_gym.scene import Scene

    Values = NDArray[np.float64]

MOST_STEPS = 100
"""Control steps of the episode."""

MOST_CHECKED = 10
"""Control steps of it that the oracle integrates too."""

LONGEST_RUN = 0.02
"""Seconds that `auto` may take for the episode; it is shortened to that."""

PATIENCE = 4.0
"""Seconds after which the oracle is asked for no further control step."""

ORACLES = (("DOP853", 2.3e-14), ("Radau", 1e-11))
"""Methods of the oracle with their tolerances; the implicit one where the first takes too long."""

EVALUATIONS = 30_000
"""What a control step may take of the oracle: some 0.3 s, or a second with Radau."""


@dataclass(frozen=True, eq=False)
class Episode:
    """Some control steps under random commands.

    Attributes
    ----------
    seed
        Of what the scene draws, and of the commands.
    columns
        (rows, n) the lane at the start of each control step.
    commands, applied
        (n, 2) force [N] and stretch [-], asked for and applied.
    states
        (n, 4) the state at the end of each.
    """

    seed: int
    columns: Values
    commands: Values
    applied: Values
    states: Values

    @property
    def scale(self) -> Values:
        """(4,) the largest position [m] and velocity [m/s] of the episode, where the errors are."""
        known = np.abs(np.vstack([self.columns[:4].T, self.states])).max(axis=0)
        scale = np.repeat([known[:2].max(), known[2:].max()], 2)
        return np.where(scale > 0.0, scale, 1.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """Ends of control steps as the oracle sees them.

    Attributes
    ----------
    indices
        (k,) which control steps.
    states
        (k, 4) their ends.
    oracle
        In words.
    resolution
        Largest difference from a second, coarser integration, relative to the scale.
    """

    indices: NDArray[np.intp]
    states: Values
    oracle: str
    resolution: float


def record(plant: Plant, seed: int) -> Episode:
    """Run an episode under random commands, as many steps of it as take `LONGEST_RUN`."""
    lanes, rng = Lanes(plant, 1), np.random.default_rng(seed)
    lanes.seed(seed)
    lanes.restart()
    count = min(plant.steps, MOST_STEPS)
    commands = _commands(plant, lanes, rng, count)
    columns = np.empty((len(lanes.values), count))
    states, applied = np.empty((count, 4)), np.empty((count, 2))
    began = time.perf_counter()
    for n in range(count):
        columns[:, n] = lanes.values[:, 0]
        one = slice(n, n + 1)
        lanes.raise_for(run(plant, lanes, commands[one], states[one], applied[one]))
        if n == 0:
            began = time.perf_counter()  # the first call may compile
        elif time.perf_counter() - began > LONGEST_RUN:
            count = n + 1
            break
    kept = slice(count)
    return Episode(seed, columns[:, kept], commands[kept], applied[kept], states[kept])


def run(plant: Plant, lanes: Lanes, commands: Values, states: Values, applied: Values) -> int:
    """Advance the lane by one control step for each row of commands; return the status."""
    return plant.method.entries.run(
        plant.model, plant.task, lanes.values, commands, states, applied
    )


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
    """Ask the oracle for the ends of control steps spread over the episode.

    Raises
    ------
    SimulationError
        If none of SciPy's methods gets through a control step in `EVALUATIONS`.
    """
    drawn, problem = _drawn(scene, plant, episode), ""
    for method, rtol in ORACLES:
        try:
            # A trial step of SciPy may overflow; it then tries a shorter one.
            with np.errstate(over="ignore", invalid="ignore"):
                return _truth(_Pair.of(drawn, plant, method, rtol), episode)
        except SimulationError as error:
            problem = str(error)
    msg = f"work_precision: SciPy cannot follow this scene to measure errors against: {problem}"
    raise SimulationError(msg)


@dataclass(frozen=True)
class _Pair:
    """The oracle, and a coarser one whose difference shows how good it is."""

    fine: Oracle
    coarse: Oracle

    @classmethod
    def of(cls, scene: Scene, plant: Plant, method: str, rtol: float) -> _Pair:
        longest = np.inf
        if scene.interface.kind == "dry_friction":
            # An event shows only between steps: some sixty to an oscillation.
            longest = min(0.1 / fastest_oscillation(plant.support), scene.control.time_step / 4.0)
        return cls(
            Oracle(scene, method, rtol, longest, EVALUATIONS),
            Oracle(scene, method, 10.0 * rtol, 2.0 * longest, EVALUATIONS),
        )


def _truth(pair: _Pair, episode: Episode) -> Truth:
    ends: dict[int, Values] = {}
    resolution, until = float(np.finfo(np.float64).eps), time.perf_counter() + PATIENCE
    for n in _spread(len(episode.states)):
        if ends and time.perf_counter() > until:
            break
        fine, coarse = (_end(oracle, episode, n) for oracle in (pair.fine, pair.coarse))
        ends[n] = fine
        resolution = max(resolution, float((np.abs(fine - coarse) / episode.scale).max()))
    text = f"SciPy's {pair.fine.method} at {pair.fine.rtol:.0e}"
    return Truth(np.array(list(ends)), np.array(list(ends.values())), text, resolution)


def _spread(count: int) -> list[int]:
    """Return control steps evenly over the episode, in an order that soon reaches all parts."""
    indices = np.unique(np.linspace(0, count - 1, MOST_CHECKED).astype(int))
    golden_ratio = 0.5 * (1.0 + np.sqrt(5.0))
    return indices[np.argsort(np.arange(len(indices)) * golden_ratio % 1.0)].tolist()


def _end(oracle: Oracle, episode: Episode, n: int) -> Values:
    step = oracle.scene.control.time_step
    return oracle.solve(
        [(n + 1) * step],
        forces=episode.applied[:, 0],
        stretches=episode.applied[:, 1],
        start=episode.columns[:4, n],
        begin=n * step,
    )[0]


def _drawn(scene: Scene, plant: Plant, episode: Episode) -> Scene:
    """Return the scene with what was drawn in place of ranges; the start is stated apart."""
    support = plant.support
    values: dict[str, object] = {
        name: float(episode.columns[row, 0])
        for name, row in support.names.items()
        if support.start_low[row] != support.start_high[row] and not name.startswith("initial.")
    }
    return scene.replace(randomization={}, **values)
