"""Error and time of every method on the same episode."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mm_gym import methods
from mm_gym.arrays import Array
from mm_gym.errors import CompileError, SimulationError, whole_number
from mm_gym.lanes import layout
from mm_gym.methods.support import PHYSICAL
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.plant import Plant
from mm_gym.precision.episode import Episode, Truth, episodes_of, truth_of
from mm_gym.precision.result import Setting, WorkPrecision, margin
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import Recording, blank, lane_at, run

COSTLIEST = 0.1  # time for the episode [s] above which no finer setting of a method is tried
ROUNDS = 5  # turns in which each setting is timed; the median counts
TURN = 0.002  # duration of a turn [s]; short runs are repeated in it
STEPS_OF_LANES = 20  # control steps of a run of several lanes
COSTLIEST_OF_LANES = 1.0  # as `COSTLIEST`, for a run of several lanes [s]
NO_OPTION = "", (np.nan,)  # of a method without one


def work_precision(scene: Scene, *, seed: int = 0, lanes: int = 1) -> WorkPrecision:
    """Measure error [-] and cost [s] of each method and setting on a scene.

    Ten episodes under random actions, in every other one at the actuators' limits, give up to 300
    sample intervals, spread over them. Each is propagated from the true state with every method
    that applies, over the range of its settings. The error is relative to the largest position or
    velocity of the episode; without sampled excitation a sample interval is a control step, whose
    error ``solver.tolerance`` bounds. It is measured against SciPy, which has no code in common
    with the methods. Other steps have other errors: a margin comes on top, from the spread of the
    largest ones. The cost of a control step is the median of several turns, without compilation: of
    one lane without what an environment adds, or, of several lanes side by side, for each of them,
    with reward, termination and observation.

    Parameters
    ----------
    scene
        The scene; its ``solver`` is ignored.
    seed
        Seed of the first episode's draws and actions; the others have the seeds that follow.
    lanes
        Lanes that are stepped side by side where costs are measured, on one thread.

    Raises
    ------
    CompileError
        If no plant covers the scene.
    SceneError
        If the number of lanes is not a whole number of at least 1.
    SimulationError
        If the episode cannot be completed, or SciPy cannot follow it.

    Examples
    --------
    >>> from mm_gym import Scene, work_precision
    >>> result = work_precision(Scene(initial={"carriage_displacement": 0.01}))
    >>> result.cheapest(1e-9).method
    'exact'
    """
    lanes = whole_number("lanes", lanes)
    require_scene(scene)
    scene = scene.replace(solver={})
    plant = compile_scene(scene)
    episodes = episodes_of(plant, seed)
    truth = truth_of(scene, plant, episodes)
    found: list[tuple[Setting, Callable[[], float]]] = []
    refused: dict[str, str] = {}
    for method in methods.names():
        try:
            found += _family(scene, method, truth, lanes)
        except CompileError as error:
            refused[method] = str(error)
    steps = len(episodes[0].commands) if lanes == 1 else STEPS_OF_LANES
    return WorkPrecision(
        settings=_timed(found, steps * lanes),
        refused=refused,
        auto=plant.method.name,
        oracle=truth.oracle,
        resolution=truth.resolution,
        checked=len(truth.places),
        steps=steps,
        episodes=len(episodes),
        lanes=lanes,
    )


def _family(
    scene: Scene, method: str, truth: Truth, lanes: int
) -> list[tuple[Setting, Callable[[], float]]]:
    """Return a method's settings from coarse to fine, each with a function that times a run."""
    option, values = next(m.option for m in methods.METHODS if m.name == method) or NO_OPTION
    costliest = COSTLIEST if lanes == 1 else COSTLIEST_OF_LANES
    found: list[tuple[Setting, Callable[[], float]]] = []
    for value in values:
        whole = int(value) if value.is_integer() else value
        solver = {"method": method} | ({option: whole} if option else {})
        try:
            plant = compile_scene(scene.replace(solver=solver))
        except CompileError:
            if found:
                break
            raise
        stopwatch = _stopwatch(plant, truth.episodes[0], lanes)
        seconds = stopwatch()
        errors = errors_of(plant, truth) if np.isfinite(seconds) else np.array([np.inf])
        worst, factor = float(errors.max()), margin(errors)
        found.append((Setting(method, option, float(value), worst, np.nan, factor), stopwatch))
        if np.isfinite(seconds) and stopwatch() > costliest:  # the first run may have compiled
            break
    return found


def errors_of(plant: Plant, truth: Truth) -> Array:
    """Return the errors (k,) of the sample intervals that the oracle integrated.

    All are infinite if the propagation of one fails.
    """
    drawn = Lanes(plant, len(truth.episodes))
    drawn.seed(truth.episodes[0].seed)
    drawn.restart()
    recordings = [
        _own(plant, one.recording, drawn.values[:, i]) for i, one in enumerate(truth.episodes)
    ]
    try:
        states = np.array([_end(recordings[int(i)], int(n)) for i, n in truth.places])
    except SimulationError:
        return np.full(len(truth.places), np.inf)
    scales = np.array([one.scale for one in truth.episodes])[truth.places[:, 0]]
    errors = (np.abs(states - truth.states) / scales).max(axis=1)
    return np.where(np.isfinite(errors), errors, np.inf)


def _own(plant: Plant, recording: Recording, drawn: Array) -> Recording:
    """Return the recording as another plant's, which keeps its own kind of interface."""
    parameters = recording.parameters.copy()
    parameters[list(PHYSICAL)] = drawn[list(PHYSICAL)]
    return replace(recording, plant=plant, parameters=parameters)


def _end(recording: Recording, n: int) -> Array:
    """Return the state (4,) at the end of a sample interval, by the recording's plant."""
    plant, lane = recording.plant, lane_at(recording, n)
    interval = n % plant.support.intervals_per_step
    kernels = plant.entries.kernels(plant.task, plant.model, lane, excited=True)
    status = plant.entries.cross(plant.model, lane, interval, kernels[0], 0, 1)
    if status > layout.ENDED:
        raise SimulationError(layout.MESSAGES[status])
    return lane[:4, 0]


def _stopwatch(plant: Plant, episode: Episode, count: int) -> Callable[[], float]:
    """Return a function that times a run [s]; one that diverges takes infinity."""
    lanes = Lanes(plant, count)
    lanes.seed(episode.seed)
    lanes.restart()
    start = lanes.snapshot()
    recording = blank(plant, lanes.values[:, 0].copy(), len(episode.commands))
    shape = STEPS_OF_LANES, len(plant.actuators) * count
    actions = np.random.default_rng(episode.seed).uniform(-1.0, 1.0, shape).astype(np.float32)

    def stopwatch() -> float:
        lanes.restore(start)
        began, statuses = time.perf_counter(), [layout.OK]
        try:
            if count == 1:
                run(lanes, episode.commands, recording)
            else:
                statuses = [lanes.advance(row) for row in actions]
        except SimulationError:
            return np.inf
        return time.perf_counter() - began if max(statuses) <= layout.ENDED else np.inf

    return stopwatch


def _timed(found: list[tuple[Setting, Callable[[], float]]], steps: int) -> tuple[Setting, ...]:
    """Return the settings with costs, measured in turns so that disturbances affect all alike."""
    measured = np.empty((ROUNDS, len(found)))
    for turn in range(ROUNDS):
        for k, (_, stopwatch) in enumerate(found):
            once = stopwatch()
            repeats = min(1000, int(TURN / once))
            measured[turn, k] = np.median([once, *(stopwatch() for _ in range(1, repeats))])
    costs = np.median(measured, axis=0) / steps
    return tuple(
        replace(one, seconds=float(cost)) for (one, _), cost in zip(found, costs, strict=True)
    )
