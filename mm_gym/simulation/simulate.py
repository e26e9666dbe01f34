"""Simulation of a scene without reinforcement learning."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.compiler.jit import OBSTACLE
from mm_gym.compiler.notice import NOT_KEPT
from mm_gym.errors import ActionError, SimulationError, finite_numbers, refuse
from mm_gym.lanes import layout
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.plant import Plant
from mm_gym.records.options import LARGEST
from mm_gym.records.text import MOST_BYTES, series
from mm_gym.scene.excitation import Recorded
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.simulation.checks import checked_seed
from mm_gym.simulation.failures import growth_of
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import Recording, blank, held_rows, locate, run, states_at
from mm_gym.simulation.trajectory import Trajectory

Policy = Callable[[float, Array], ArrayLike]

MOST_STEPS = 100_000_000
"""Control steps of one simulation at most. It takes 80 bytes for each sample interval, and more
with excitation other than harmonics."""

MOST_SAMPLES = MOST_BYTES // 16 - 8
"""Rows of a ground motion at most: 16 bytes each, after a head of 128."""


def simulate(
    scene: Scene | Plant,
    *,
    duration: float | None = None,
    times: ArrayLike | None = None,
    action: ArrayLike | Policy | None = None,
    seed: int | None = None,
    ground: ArrayLike | None = None,
) -> Trajectory:
    """Simulate one episode.

    Parameters
    ----------
    scene
        A scene, or the plant that it compiles to.
    duration
        Length of the simulation [s]; by default that of an episode. The trajectory has a row for
        the start of each control step, and one for the end of the simulation.
    times
        (n,) increasing instants [s] at which the trajectory is returned instead. They may lie
        within control steps.
    action
        The commands to the actuators, one column per actuator: force [N], positive in the direction
        of x1, stretch [-], and damping [N s/m] or voltage [V]. It may be None (no force, and the
        initial value of the others), a constant (k,), an array (steps, k) with a row per control
        step, or a function of time [s] and state (4,) that returns (k,). Limits and rate limits
        apply.
    seed
        Seed of all random draws of the scene; by default 0.
    ground
        (k, 2) increasing times [s] and accelerations of the ground [m/s^2], linear in between and
        zero before and after. This motion is added to the scene's own excitation. It is allowed
        with a scene, not with a plant.

    Returns
    -------
    Trajectory
        Time (n,) [s] and state (n, 4): x1, x2 [m], v1, v2 [m/s] in the ground frame, with action,
        excitation, energy and work.

    Raises
    ------
    CompileError
        If no plant covers the scene.
    SceneError
        If the seed is not an integer from 0 to 2**64 - 1, or the motion of the ground
        has too many rows, too large numbers, or times that do not increase from 0 or later.
    ActionError
        If the action does not fit the actuators or is not finite.
    SimulationError
        If the times are not increasing and finite, or the simulation cannot be completed.
    """
    plant = _plant_of(scene, ground)
    instants = _instants(plant, duration, times)
    steps = _steps_until(float(instants[-1]), plant.time_step)
    lanes = Lanes(plant, 1)
    lanes.seed(0 if seed is None else checked_seed(seed))
    lanes.restart(seen=False)
    start = lanes.values[:, 0].copy()
    recording = blank(plant, start, steps)
    if callable(action):
        _follow_policy(lanes, action, recording)
    else:
        run(lanes, commands_of(plant, action, steps, start), recording, 0)
    place = locate(recording, instants)
    state = states_at(recording, place)
    _check_finite(instants, state, start)
    held = recording.applied[np.minimum(place.row, recording.last)]
    return Trajectory(
        time=instants,
        state=state[:, :4],
        interface_state=state[:, 4:],
        action=held[:, _columns(plant)],
        applied=held,
        actuators=plant.actuators,
        parameters=start,
        recording=recording,
        place=place,
    )


def _plant_of(scene: Scene | Plant, ground: ArrayLike | None) -> Plant:
    if ground is None:
        return scene if isinstance(scene, Plant) else compile_scene(scene)
    if isinstance(scene, Plant):
        msg = "ground: a plant is compiled for its own excitation; pass the scene instead"
        raise SimulationError(msg)
    return shaken(scene, ground)


def _instants(plant: Plant, duration: float | None, times: ArrayLike | None) -> Array:
    """Return the instants (n,) [s] of the trajectory."""
    if times is not None:
        if duration is not None:
            msg = "times: has no effect together with duration; give one of them"
            raise SimulationError(msg)
        instants = np.atleast_1d(finite_numbers("times", times, SimulationError))
        increasing = instants.ndim == 1 and instants.size and np.all(np.diff(instants) > 0.0)
        if not (increasing and instants[0] >= 0.0):
            msg = "times: allowed: a one-dimensional array of increasing instants of at least 0 s"
            raise SimulationError(msg)
        return instants
    if duration is None:
        return np.multiply(plant.time_step, np.arange(plant.steps + 1), dtype=np.float64)
    length = finite_numbers("duration", duration, SimulationError)
    if not (length.shape == () and length > 0.0):
        refuse("duration", f"{duration}", "a number greater than 0 s", SimulationError)
    grid = plant.time_step * np.arange(_steps_until(float(length), plant.time_step))
    return np.concatenate([grid, length[None]], dtype=np.float64)


def _steps_until(end: float, time_step: float) -> int:
    """Return the number of control steps that reach an end, allowing for its rounding."""
    steps = end / time_step
    if steps > MOST_STEPS:
        msg = f"the simulation needs {steps:.3g} control steps; allowed: at most {MOST_STEPS:.0e}"
        raise SimulationError(msg)
    nearest = round(steps)
    return nearest if abs(steps - nearest) <= 1e-12 * max(nearest, 1) else int(np.ceil(steps))


def no_commands(plant: Plant, steps: int, start: Array) -> Array:
    """Return the commands (steps, 2 or 3) of `recording.run` that keep what a lane applies."""
    commands = np.tile(start[held_rows(plant)], (steps, 1))
    commands[:, 0] = 0.0
    return commands


def commands_of(plant: Plant, action: ArrayLike | None, steps: int, start: Array) -> Array:
    """Return the commands (steps, 2 or 3) of `recording.run`, constant where not actuated."""
    commands = no_commands(plant, steps, start)
    if action is None:
        return commands
    given, count = finite_numbers("action", action, ActionError), len(plant.actuators)
    if given.ndim == 1 and count == 1 and given.shape != (1,):
        given = given[:, None]
    if given.shape not in ((), (count,), (steps, count)) or (given.shape == () and count != 1):
        allowed = f"({count},) or ({steps}, {count}) for {plant.actuators}"
        refuse("action", f"shape {given.shape}", allowed, ActionError)
    commands[:, _columns(plant)] = given
    return commands


def _columns(plant: Plant) -> list[int]:
    """Return the column of each actuator in what is held."""
    return [layout.APPLIED[name] - layout.FORCE for name in plant.actuators]


def _check_finite(instants: Array, state: Array, lane: Array) -> None:
    lost = np.flatnonzero(~np.all(np.isfinite(state), axis=1))
    if lost.size:
        growth = growth_of(lane)
        msg = f"the state exceeds the largest double from t = {instants[lost[0]]:g} s on"
        raise SimulationError(f"{msg}; {growth}" if growth else msg)


def _follow_policy(lanes: Lanes, policy: Policy, recording: Recording) -> None:
    """Simulate all control steps, each with the policy's action for its start."""
    plant, many = lanes.plant, lanes.plant.support.intervals_per_step
    for first in range(0, len(recording.starts), many):
        now, state = first // many * plant.time_step, recording.states[first, :4].copy()
        wanted = finite_numbers("action", policy(now, state), ActionError)
        run(lanes, commands_of(plant, wanted, 1, lanes.values[:, 0]), recording, first)


def shaken(scene: Scene, motion: ArrayLike) -> Plant:
    """Return the plant of a scene whose ground moves also as an array says.

    The motion is (k, 2) times [s], which increase from 0 or later, and accelerations [m/s^2].
    """
    require_scene(scene)
    with record_of(motion) as record:
        return compile_scene(scene.replace(excitation=[*scene.excitation, record]))


@contextmanager
def record_of(motion: ArrayLike) -> Generator[Recorded]:
    """Write a ground motion to a file of its own for a while."""
    samples = checked_motion(motion)
    series(samples, None, lambda row: f"ground: row {row + 1}")
    if len(large := np.argwhere(np.abs(samples) > LARGEST)):
        row, column = large[0]
        got, allowed = f"{samples[row, column]:g}", f"numbers of magnitude at most {LARGEST:g}"
        refuse(f"ground: row {row + 1}", got, allowed)
    if len(samples) > MOST_SAMPLES:
        refuse("ground", f"{len(samples)} rows", f"at most {MOST_SAMPLES}")
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        # A simulation may be shorter than the ground's motion.
        warnings.filterwarnings("ignore", message=r"excitation\.\d+: the record lasts")
        file = Path(folder) / "ground.npy"  # the way of every record, all digits are kept
        np.save(file, samples)
        yield Recorded(target="ground", file=str(file), unit="m/s^2")


def checked_motion(motion: ArrayLike) -> Array:
    """Return a ground motion (k, 2) as finite numbers, or raise `SimulationError`."""
    samples = finite_numbers("ground", motion, SimulationError)
    if samples.ndim != 2 or samples.shape[1] != 2 or len(samples) < 2:  # noqa: PLR2004
        allowed = "(k, 2) times [s] and accelerations [m/s^2]"
        refuse("ground", f"shape {samples.shape}", allowed, SimulationError)
    return samples


def warm(scene: Scene) -> float:
    """Compile the kernels that environments of a scene need, and `simulate`; return the seconds.

    If the compiled code cannot be kept, that is an `OSError`.
    """
    if OBSTACLE is not None:
        message = f"nothing can be kept: {OBSTACLE}"
        raise OSError(message)
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        plant = compile_scene(scene)
        if plant.actuators:
            lanes = Lanes(plant, 1)
            lanes.advance_of(np.dtype(np.float32))
            lanes.seed(0)
            lanes.restart()
            lanes.observations()
        simulate(plant, duration=scene.control.time_step, seed=0)
    for warning in caught:
        message = str(warning.message)
        if message.startswith(NOT_KEPT):
            raise OSError(message)
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return time.perf_counter() - start
