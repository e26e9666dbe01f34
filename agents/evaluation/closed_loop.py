"""The steady response of a closed loop over frequency, at several amplitudes."""

from dataclasses import dataclass

import numpy as np

from agents.control.controller import Controller
from agents.control.scene import ENDLESS, drawn_but
from agents.rollout import Rollout
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

POINTS = 192
"""Frequencies, from `SPAN` of the carriage's own, evenly over their logarithm: in steps of 0.8 %,
so that the peaks of a damped absorber are drawn round."""

SPAN = (0.4, 2.0)

DEFLECTIONS = (0.1, 0.3, 1.0)
"""Amplitudes of the force: static deflections of the carriage over its displacement_scale."""

PERIODS = (60, 20)
"""Periods of the carriage's own frequency that are waited for, and that are measured then."""

NAME = "excitation.0"


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The steady response of one controller."""

    label: str  # of the controller
    frequencies: Array  # (n,) of the force [rad/s]
    forces: Array  # (m,) its amplitudes [N]
    # (m, n) amplitude of x1 at the frequency of the force over the static deflection F / k1 [-].
    gain: Array
    # (m, n) root mean square of the rest of x1 over that of all [-]: 0 if x1 is harmonic.
    distortion: Array


def closed_loop(scene: Scene, controller: Controller, label: str) -> ClosedLoop:
    """Measure the steady response of a controller, each frequency and amplitude in a lane.

    A harmonic force takes the place of the scene's excitation; the sensors' noise and delay stay.
    """
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
    env = MovingMassVectorEnv(shaken, len(forces) * POINTS, autoreset_mode="Disabled")
    rollout = Rollout(env, controller, seed=0, options=lanes)
    displacement = np.stack([made.info["state"][:, 0].copy() for made in rollout])[waited:]
    time = step * np.arange(waited + 1, waited + measured + 1)
    gain, distortion = _harmonic_part(time, displacement, lanes[f"{NAME}.frequency"])
    shape = len(forces), POINTS
    static = np.repeat(forces / stiffness, POINTS)
    return ClosedLoop(
        label, frequencies, forces, (gain / static).reshape(shape), distortion.reshape(shape)
    )


def _shaken(scene: Scene, lanes: dict[str, Array], steps: int) -> Scene:
    """Return the scene at rest under a harmonic force whose numbers are drawn."""
    drawn = drawn_but(scene, "excitation.")
    harmonic = {"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}
    stretch = {} if scene.springs.kind == "none" else {"stretch": scene.initial.stretch}
    return scene.replace(
        excitation=[harmonic],
        initial=stretch,
        randomization=drawn | {name: (float(v.min()), float(v.max())) for name, v in lanes.items()},
        **ENDLESS,
        **{"control.steps": steps},
    )


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
