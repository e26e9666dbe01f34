"""The episodes that methods are compared on, and the true ends of their sample intervals."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout
from mm_gym.methods.support import fastest_oscillation
from mm_gym.plant.plant import Plant
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.scene import Scene
from mm_gym.sensitivity.actuators import actuators_of
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import Place, Recording, blank, breaks, excitation, first, run
from mm_gym.simulation.simulate import no_commands

EPISODES = 10  # episodes that steps are sampled from; the first is timed
MOST_STEPS = 100  # control steps of an episode
MOST_CHECKED = 300  # sample intervals of all episodes that the oracle integrates

LONGEST_RUN = 0.02
"""Processor time [s] that `auto` may take for an episode; a longer one is cut short."""

EVALUATIONS = {"smooth": 200_000, "sampled": 10_000}
"""Evaluations of the forces after which the oracle starts no further sample interval: some 4 s.
Recorded excitation takes twenty times as long. They are counted, so that which scenes are refused,
and how many intervals are checked, do not depend on the machine."""

ORACLES = (("DOP853", 2.3e-14, 100_000), ("Radau", 1e-11, 30_000))
"""Methods of the oracle, their tolerances, and the evaluations of the forces that a sample interval
may take: 1 s or so. The second is for what the first cannot follow in time."""


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode under random commands."""

    seed: int  # of the scene's draws and of the commands
    commands: Array  # (n, 2) force [N] and stretch [-] commanded in each control step
    recording: Recording  # the sample intervals that followed from them

    @property
    def scale(self) -> Array:
        """(4,) the episode's largest position [m], twice, and largest velocity [m/s], twice."""
        known = np.abs(np.vstack([self.recording.starts, self.recording.states])).max(axis=0)
        scale = np.repeat([known[:2].max(), known[2:].max()], 2)
        return np.where(scale > 0.0, scale, 1.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """The ends of some sample intervals, by the oracle."""

    episodes: tuple[Episode, ...]  # their seeds follow one another
    places: NDArray[np.intp]  # (k, 2) index of the episode and of the sample interval in it
    states: Array  # (k, 4) states at their ends
    oracle: str  # method and tolerance of the oracle, in words
    resolution: float  # largest difference from a coarser integration, relative to the scale


def episodes_of(plant: Plant, seed: int) -> tuple[Episode, ...]:
    """Run `EPISODES` episodes under random commands; in every other one they are at the limits.

    A scene in which nothing is random has one episode only.
    """
    episodes: list[Episode] = []
    for i in range(EPISODES):
        episodes.append(record(plant, seed + i, at_limits=i % 2 == 1))
        if i == 1 and _are_alike(*episodes):
            return (episodes[0],)
    return tuple(episodes)


def _are_alike(one: Episode, other: Episode) -> bool:
    """Return whether the episodes are the same as far as both go."""
    both = (one.recording, other.recording)
    many = min(len(recording.starts) for recording in both)
    return all(
        np.array_equal(*(getattr(recording, name)[:many] for recording in both))
        for name in ("starts", "applied", "jets")
    ) and np.array_equal(one.recording.parameters, other.recording.parameters)


def record(plant: Plant, seed: int, *, at_limits: bool = False) -> Episode:
    """Run an episode under random commands, for at most `LONGEST_RUN`."""
    lanes, rng = Lanes(plant, 1), np.random.default_rng(seed)
    lanes.seed(seed)
    lanes.restart()
    count, many = min(plant.steps, MOST_STEPS), plant.support.intervals_per_step
    commands = _commands(plant, lanes, rng, count, at_limits=at_limits)
    recording = blank(plant, lanes.values[:, 0].copy(), count)
    began = time.thread_time()
    for n in range(count):
        run(lanes, commands[n : n + 1], recording, n * many)
        if n == 0:
            began = time.thread_time()  # the first call may compile
        elif time.thread_time() - began > LONGEST_RUN:
            count = n + 1
            break
    return Episode(seed, commands[:count], first(recording, count * many))


def _commands(
    plant: Plant, lanes: Lanes, rng: np.random.Generator, count: int, *, at_limits: bool
) -> Array:
    """Return uniformly random commands within the actuators' limits, or the nearer limits."""
    commands = no_commands(plant, count, lanes.values[:, 0])
    for one in actuators_of(plant.task, plant.support.device):
        drawn = rng.uniform(one.low, one.high, count)
        nearer = np.where(drawn < 0.5 * (one.low + one.high), one.low, one.high)
        commands[:, one.row - layout.FORCE] = nearer if at_limits else drawn
    return commands


def truth_of(scene: Scene, plant: Plant, episodes: Sequence[Episode]) -> Truth:
    """Integrate sample intervals spread over the episodes with the oracle."""
    problems: list[str] = []
    for method, rtol, most in ORACLES:
        try:
            # A trial step of SciPy may overflow; it then tries a shorter one.
            with np.errstate(over="ignore", invalid="ignore"):
                return _truth([_pair(scene, one, method, rtol, most) for one in episodes], episodes)
        except SimulationError as error:
            problems.append(f"{method}: {str(error).removeprefix('reference: ')}")
    msg = (
        "work_precision: SciPy cannot follow this scene, so errors are unknown "
        f"({'; '.join(problems)}). That many evaluations of the forces are allowed in a sample "
        f"interval, here {plant.support.sample_interval:g} s; the fastest oscillation takes some "
        "150 a period, so a shorter control.time_step takes fewer"
    )
    raise SimulationError(msg)


def _pair(
    scene: Scene, episode: Episode, method: str, rtol: float, most: int
) -> tuple[Oracle, Oracle]:
    """Return the oracle and a coarser one, whose difference estimates the oracle's error."""
    longest, support, scene = np.inf, episode.recording.plant.support, _drawn(scene, episode)
    if scene.interface.kind == "dry_friction":
        # SciPy sees an event only between two of its steps: some sixty in an oscillation.
        longest = min(0.1 / fastest_oscillation(support), support.sample_interval / 4.0)
    disturbance = _disturbance(episode.recording) if support.sampled else None
    fine = Oracle(scene, method, rtol, longest, disturbance, most)
    return fine, replace(fine, rtol=10.0 * rtol, max_step=2.0 * longest)


def _disturbance(recording: Recording) -> Callable[[float, str], float]:
    """Return the recorded excitation; the oracle itself knows harmonics only."""

    def disturbance(time: float, target: str) -> float:
        row = int(time / recording.plant.support.sample_interval * (1.0 + 1e-12))
        part = time - row * recording.plant.support.sample_interval
        both = excitation(recording, Place(np.array([row]), np.array([part])))
        return float(both[0, int(target == "ground")])

    return disturbance


def _truth(pairs: Sequence[tuple[Oracle, Oracle]], episodes: Sequence[Episode]) -> Truth:
    places: list[tuple[int, int]] = []
    ends: list[Array] = []
    resolution, spent, oracle = float(np.finfo(np.float64).eps), 0, pairs[0][0]
    most = EVALUATIONS["smooth" if oracle.disturbance is None else "sampled"]
    for i, n in _spread([len(one.recording.starts) for one in episodes]):
        if spent >= most:
            break
        (fine, first_spent), (coarse, second_spent) = (_end(o, episodes[i], n) for o in pairs[i])
        spent += first_spent + second_spent
        places.append((i, n))
        ends.append(fine)
        resolution = max(resolution, float((np.abs(fine - coarse) / episodes[i].scale).max()))
    text = f"SciPy's {oracle.method} at {oracle.rtol:.0e}"
    return Truth(tuple(episodes), np.array(places), np.array(ends), text, resolution)


def _spread(counts: Sequence[int]) -> list[tuple[int, int]]:
    """Return at most `MOST_CHECKED` episodes and intervals, in an order that covers them evenly."""
    golden_ratio = 0.5 * (1.0 + np.sqrt(5.0))
    each = -(-MOST_CHECKED // len(counts))
    orders: list[list[int]] = []
    for i, count in enumerate(counts):
        # The first are the same in no two episodes.
        indices = np.unique(np.linspace(0, count - 1, each).astype(int))
        order = np.argsort((np.arange(len(indices)) + i) * golden_ratio % 1.0)
        orders.append(indices[order].tolist())
    turns = range(max(map(len, orders)))
    places = [
        (i, order[turn]) for turn in turns for i, order in enumerate(orders) if turn < len(order)
    ]
    return places[:MOST_CHECKED]


def _end(oracle: Oracle, episode: Episode, n: int) -> tuple[Array, int]:
    """Return the state (4,) at the end of sample interval n, and the evaluations of the oracle."""
    recording = episode.recording
    interval = recording.plant.support.sample_interval
    force, stretch, *damping = recording.applied[n]
    count = int(np.ceil((n + 1) * interval / oracle.scene.control.time_step)) + 1
    forces, stretches = np.full(count, force), np.full(count, stretch)
    damped = oracle.scene.actuation.damped
    if damped is not None:  # the oracle has the scene's own
        oracle = replace(oracle, scene=oracle.scene.replace(**{damped: float(damping[0])}))
    state, begin, spent = recording.starts[n], n * interval, 0
    for elapsed, jump in [*breaks(recording, n), (interval, np.zeros(2))]:
        end = n * interval + elapsed
        # A copy, because the budget of evaluations is for its life.
        piece = replace(oracle, disturbance=_within(oracle.disturbance, begin, end))
        state = piece.solve([end], forces=forces, stretches=stretches, start=state, begin=begin)[0]
        spent += piece.spent
        state[2:] += jump
        begin = end
    return state, spent


def _within(
    disturbance: Callable[[float, str], float] | None, begin: float, end: float
) -> Callable[[float, str], float] | None:
    """Return a disturbance that is smooth up to both ends: records may jump there."""
    if disturbance is None:
        return None
    close = 1e-12 * (end - begin) + 1e-14 * end
    first, last = begin + close, end - close
    return lambda time, target: disturbance(min(max(time, first), last), target)


def _drawn(scene: Scene, episode: Episode) -> Scene:
    """Return the scene with drawn values in place of ranges, but for the initial state."""
    support = episode.recording.plant.support
    values: dict[str, object] = {
        name: float(episode.recording.parameters[row])
        for name, row in support.names.items()
        if support.start_low[row] != support.start_high[row]
        and not name.startswith("initial.")
        and row not in support.number_rows.values()
    }
    for name, file in episode.recording.plant.records_of(episode.recording.parameters).items():
        values |= {f"{name}.file": file, f"{name}.files": None}
    return scene.replace(randomization={}, **values)
