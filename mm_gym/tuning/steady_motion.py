"""The steady motion under a harmonic, simulated."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.lanes.layout import NO_ROW
from mm_gym.simulation.simulate import simulate
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

    Array = NDArray[np.float64]

SAMPLES, FINER = (24, 96, 384), 8
"""Control steps in a period, more if they must be, and points between two at which the largest
value is looked for."""

PERIODS = 200
"""Periods after which a motion is taken to be steady."""

STATES = ("carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity")


def motion_channels() -> tuple[str, ...]:
    """Return the channels that are states or differences of two."""
    motion = (NO_ROW, *range(len(STATES)))
    return tuple(
        name
        for name, channel in CHANNELS.items()
        if channel.row < len(STATES) and channel.subtracted in motion
    )


def of_channel(states: NDArray[np.generic], channel: str) -> NDArray[np.generic]:
    """Return a channel (...) of states (4, ...)."""
    row, subtracted = CHANNELS[channel].row, CHANNELS[channel].subtracted
    return states[row] if subtracted == NO_ROW else states[row] - states[subtracted]


def driven(scene: Scene, excitation: str, amplitude: float) -> Scene:
    """Return the scene with one value for each field and without control, under a harmonic."""
    harmonic = {
        "kind": "harmonic", "target": excitation, "amplitude": amplitude, "frequency": 1.0,
    }  # fmt: skip
    others = ("randomization", "initial", "sensors", "actuation", "objective")
    nothing: dict[str, object] = {name: {} for name in others}
    return scene.replace(excitation=[harmonic], **nothing)


def steady_amplitude(scene: Scene, channel: str, frequency: float, start: Array) -> float:
    """Return the largest value of a channel's steady motion about its mean, simulated.

    Parameters
    ----------
    scene
        What `driven` returns.
    channel
        One of `motion_channels`.
    frequency
        Of the harmonic [rad/s].
    start
        (4,): x1, x2, v1, v2 from which the motion begins, close to the steady one.
    """
    x1, x2, v1, v2 = (float(value) for value in start)
    initial = dict(zip(STATES, (x1, x2 - x1, v1, v2), strict=True))
    scene = scene.replace(initial=initial, **{"excitation.0.frequency": frequency})
    values = of_channel(_last_period(scene, 2.0 * np.pi / frequency).T, channel)
    waves = np.fft.rfft(values)
    waves[0] = 0.0
    return float(FINER * np.abs(np.fft.irfft(waves, FINER * len(values))).max())


def _last_period(scene: Scene, period: float) -> Array:
    """Return the states (n, 4) in the last of `PERIODS` periods [s]."""
    for count in SAMPLES[:-1]:
        with suppress(SimulationError):  # stick and slip alternate too often in a control step
            return _states(scene, period, count)
    return _states(scene, period, SAMPLES[-1])


def _states(scene: Scene, period: float, count: int) -> Array:
    control = {"time_step": period / count, "steps": count * PERIODS}
    return simulate(scene.replace(control=control)).state[-count:]
