"""Error and time of every method on the same episode."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym import methods
from mm_gym.errors import CompileError, SimulationError
from mm_gym.methods.support import PHYSICAL
from mm_gym.plant.compile import compile_scene
from mm_gym.precision.episode import record, truth_of
from mm_gym.precision.result import Setting, WorkPrecision
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import blank, pieces, run

if TYPE_CHECKING:
    from collections.abc import Callable

    from mm_gym.plant.plant import Plant
    from mm_gym.precision.episode import Episode, Truth
    from mm_gym.scene.scene import Scene

COSTLIEST = 0.1
"""Time for the episode [s] above which no finer setting of a method is tried."""

ROUNDS = 5
"""Turns in which each setting is timed; the median counts."""

TURN = 0.002
"""Duration of a turn [s]; short runs are repeated in it."""


def work_precision(scene: Scene, *, seed: int = 0) -> WorkPrecision:
    """Measure error and cost of each method on a scene.

    An episode under random actions is propagated with every method that applies, over the range of
    its settings. The error is that of a sample interval which begins in the true state, relative to
    the largest position or velocity of the episode; without sampled excitation a sample interval is
    a control step, whose error ``solver.tolerance`` bounds. It is measured against SciPy, which has
    no code in common with the methods. The cost of a control step is the median of several turns,
    without compilation and without what an environment adds.

    Parameters
    ----------
    scene
        The scene; its ``solver`` is ignored.
    seed
        Seed of the scene's draws and of the actions.

    Returns
    -------
    WorkPrecision
        Error [-] and cost [s] of every setting, and the methods that do not apply.

    Raises
    ------
    CompileError
        If no plant covers the scene.
    SimulationError
        If the episode cannot be completed, or SciPy cannot follow it.

    Examples
    --------
    >>> from mm_gym import Scene, work_precision
    >>> result = work_precision(Scene(initial={"carriage_displacement": 0.01}))
    >>> result.cheapest(1e-9).method
    'exact'
    """
    scene = scene.replace(solver={})
    plant = compile_scene(scene)
    episode = record(plant, seed)
    truth = truth_of(scene, plant, episode)
    found: list[tuple[Setting, Callable[[], float]]] = []
    refused: dict[str, str] = {}
    for method in methods.names():
        try:
            found += _family(scene, method, episode, truth)
        except CompileError as error:
            refused[method] = str(error)
    return WorkPrecision(
        settings=_timed(found, len(episode.commands)),
        refused=refused,
        auto=plant.method.name,
        oracle=truth.oracle,
        resolution=truth.resolution,
        checked=len(truth.rows),
        steps=len(episode.commands),
    )


def _family(
    scene: Scene, method: str, episode: Episode, truth: Truth
) -> list[tuple[Setting, Callable[[], float]]]:
    """Return a method's settings from coarse to fine, each with a function that times a run.

    The first one that takes longer than `COSTLIEST` is the last. A run that diverges ends early,
    so it has no cost.
    """
    option, values = _settings(method)
    found: list[tuple[Setting, Callable[[], float]]] = []
    for value in values:
        solver = {"method": method} | ({option: _whole(value)} if option else {})
        plant = compile_scene(scene.replace(solver=solver))
        stopwatch = _stopwatch(plant, episode)
        seconds = stopwatch()
        error = _error(plant, episode, truth) if np.isfinite(seconds) else np.inf
        found.append((Setting(method, option, float(value), error, np.nan), stopwatch))
        if np.isfinite(seconds) and stopwatch() > COSTLIEST:  # the first run may have compiled
            break
    return found


def _settings(name: str) -> tuple[str, tuple[float, ...]]:
    """Return the option of a method and its values; without an option "" and one NaN."""
    option = next(method.option for method in methods.METHODS if method.name == name)
    return ("", (np.nan,)) if option is None else option


def _error(plant: Plant, episode: Episode, truth: Truth) -> float:
    """Return the largest error of the sample intervals that the oracle integrated."""
    # A plant may have a viscous interface in place of friction that never slips: keep its own.
    parameters = episode.recording.parameters.copy()
    parameters[list(PHYSICAL)] = _lane(plant, episode).values[list(PHYSICAL), 0]
    own = replace(episode.recording, plant=plant, parameters=parameters)
    worst = 0.0
    for n, want in zip(truth.rows, truth.states, strict=True):
        try:
            *_, (_, _, lane) = pieces(own, int(n), plant.support.sample_interval)
        except SimulationError:
            return np.inf
        if not np.isfinite(lane[:4, 0]).all():
            return np.inf
        worst = max(worst, float((np.abs(lane[:4, 0] - want) / episode.scale).max()))
    return worst


def _whole(value: float) -> float:
    """Return a whole number as an integer, and any other number unchanged."""
    return int(value) if value == int(value) else value


def _lane(plant: Plant, episode: Episode) -> Lanes:
    lanes = Lanes(plant, 1)
    lanes.seed(episode.seed)
    lanes.restart()
    return lanes


def _stopwatch(plant: Plant, episode: Episode) -> Callable[[], float]:
    """Return a function that times a run of the episode [s]; a run that diverges takes infinity."""
    lanes = _lane(plant, episode)
    start = lanes.snapshot()
    recording = blank(plant, lanes.values[:, 0].copy(), len(episode.commands))

    def stopwatch() -> float:
        lanes.restore(start)
        began = time.perf_counter()
        try:
            run(lanes, episode.commands, recording)
        except SimulationError:
            return np.inf
        return time.perf_counter() - began

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
        Setting(one.method, one.option, one.value, one.error, float(cost))
        for (one, _), cost in zip(found, costs, strict=True)
    )
