"""The steady response of the closed loop over frequency, at several amplitudes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from agents.comparison.entries import Entry
    from agents.controllers.controller import Controller
    from mm_gym import Scene

    Array = NDArray[np.float64]

POINTS = 48
"""Frequencies, from `SPAN` of the carriage's own, evenly over their logarithm."""

SPAN = (0.4, 2.0)

DEFLECTIONS = (0.1, 0.3, 1.0)
"""Amplitudes of the force: static deflections of the carriage over its displacement_scale."""

PERIODS = (60, 20)
"""Periods of the carriage's own frequency that are waited for, and that are measured then."""

NAME = "excitation.0"


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The steady response of one controller.

    Attributes
    ----------
    label
        Of the controller.
    frequencies
        (n,) of the force [rad/s].
    forces
        (m,) its amplitudes [N].
    gain
        (m, n) amplitude of x1 at the frequency of the force over the static deflection F / k1 [-].
    distortion
        (m, n) root mean square of the rest of x1 over that of all [-]: 0 if x1 is harmonic.
    """

    label: str
    frequencies: Array
    forces: Array
    gain: Array
    distortion: Array


def closed_loops(scene: Scene, rows: Sequence[Entry]) -> list[ClosedLoop]:
    """Return the steady responses of every controller of a task under a harmonic force.

    The force takes the place of the scene's excitation; noise and delay of the sensors stay. Of a
    training with several seeds it is the first run.
    """
    return [closed_loop(scene, row.controllers[0], row.label) for row in rows]


def closed_loop(scene: Scene, controller: Controller, label: str) -> ClosedLoop:
    """Measure the steady response of one controller, each frequency and amplitude in a lane."""
    stiffness = scene.carriage.stiffness
    own = float(np.sqrt(stiffness / scene.carriage.mass))
    frequencies = own * np.geomspace(*SPAN, POINTS)
    forces = stiffness * scene.objective.displacement_scale * np.array(DEFLECTIONS)
    lanes = {
        f"{NAME}.frequency": np.tile(frequencies, len(forces)),
        f"{NAME}.amplitude": np.repeat(forces, POINTS),
    }
    step = scene.control.time_step
    waited, measured = (round(count * 2.0 * np.pi / own / step) for count in PERIODS)
    shaken = _shaken(scene, lanes, waited + measured)
    displacement = _displacement(shaken, controller, lanes)[waited:]
    time = step * np.arange(waited + 1, waited + measured + 1)
    gain, distortion = _harmonic_part(time, displacement, lanes[f"{NAME}.frequency"])
    shape = len(forces), POINTS
    static = np.repeat(forces / stiffness, POINTS)
    return ClosedLoop(
        label, frequencies, forces, (gain / static).reshape(shape), distortion.reshape(shape)
    )


def _shaken(scene: Scene, lanes: dict[str, Array], steps: int) -> Scene:
    """Return the scene at rest under a harmonic force whose numbers are drawn."""
    drawn = {
        name: ends
        for name, ends in scene.randomization.items()
        if not str(name).startswith("excitation.")
    }
    harmonic = {"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}
    stretch = {} if scene.springs.kind == "none" else {"stretch": scene.initial.stretch}
    return scene.replace(
        excitation=[harmonic],
        initial=stretch,
        randomization=drawn | {name: (float(v.min()), float(v.max())) for name, v in lanes.items()},
        **{
            "control.steps": steps,
            "objective.displacement_limit": None,
            "objective.rail_half_length": None,
        },
    )


def _displacement(scene: Scene, controller: Controller, lanes: dict[str, Array]) -> Array:
    """Return x1 [m] after each control step (steps, lanes)."""
    count = len(next(iter(lanes.values())))
    env = MovingMassVectorEnv(scene, count, autoreset_mode="Disabled")
    observation, info = env.reset(seed=0, options=lanes)
    controller.reset(env)
    found = np.empty((scene.control.steps, count))
    for step in range(scene.control.steps):
        known = {} if controller.reads == "observation" else info
        observation, *_, info = env.step(controller.act(observation, known))
        found[step] = info["state"][:, 0]
    return found


def _harmonic_part(time: Array, values: Array, frequencies: Array) -> tuple[Array, Array]:
    """Return the amplitude (lanes,) at each frequency, and how much of the values is not of it.

    Least squares of a constant and a harmonic: the time need not be whole periods.
    """
    amplitude, rest = np.empty(len(frequencies)), np.empty(len(frequencies))
    for lane, w in enumerate(frequencies):
        basis = np.column_stack([np.ones_like(time), np.cos(w * time), np.sin(w * time)])
        found, *_ = np.linalg.lstsq(basis, values[:, lane], rcond=None)
        amplitude[lane] = np.hypot(found[1], found[2])
        moving = values[:, lane] - found[0]
        left = values[:, lane] - basis @ found
        rest[lane] = np.sqrt(np.mean(left**2) / max(np.mean(moving**2), np.finfo(float).tiny))
    return amplitude, rest
