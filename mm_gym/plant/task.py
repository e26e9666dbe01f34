"""What the agent is paid for and what it sees, as the array that the kernels read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, get_args

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.scene.sensors import Channel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

CODES = {name: code for code, name in enumerate(get_args(Channel))}
"""Code of each observation channel, in the order of `mm_gym.interaction.Channel`."""


def task_array(scene: Scene) -> NDArray[np.float64]:
    """Return actuators, objective and channels in the slots of `mm_gym.kernels.layout`."""
    channels = scene.sensors.channels
    task = np.zeros(at.CHANNELS + at.CHANNEL_SIZE * len(channels))
    _actuators(scene, task)
    _objective(scene, task)
    task[at.CHANNEL_COUNT] = len(channels)
    for k, channel in enumerate(channels):
        slot = at.CHANNELS + at.CHANNEL_SIZE * k
        scale, zero = scale_and_zero(scene, channel)
        noise = scene.sensors.noise.get(channel, 0.0)
        task[slot : slot + at.CHANNEL_SIZE] = CODES[channel], scale, zero, noise * scale
    task[at.IS_DERIVED] = any(CODES[channel] >= at.DERIVED_CHANNELS for channel in channels)
    task[at.IS_NOISY] = any(noise > 0.0 for noise in scene.sensors.noise.values())
    return task


def _actuators(scene: Scene, task: NDArray[np.float64]) -> None:
    force, stretch, step = scene.actuation.force, scene.actuation.stretch, scene.control.time_step
    task[at.FORCE_RATE] = task[at.STRETCH_RATE] = np.inf
    task[at.FORCE_LAG_FACTOR] = task[at.STRETCH_LAG_FACTOR] = 1.0
    if force is not None:
        task[at.HAS_FORCE], task[at.FORCE_LIMIT] = 1.0, force.limit
        if force.rate_limit is not None:
            task[at.FORCE_RATE] = force.rate_limit * step
        task[at.FORCE_IS_RATE] = force.command == "rate"
        task[at.FORCE_LAG_FACTOR] = _share(force.lag, step)
    if stretch is not None:
        task[at.HAS_STRETCH] = 1.0
        task[at.STRETCH_LOW], task[at.STRETCH_HIGH] = stretch.minimum, stretch.maximum
        task[at.STRETCH_IS_RATE] = stretch.command == "rate"
        if stretch.rate_limit is not None:
            task[at.STRETCH_RATE] = stretch.rate_limit * step
        task[at.STRETCH_LAG_FACTOR] = _share(stretch.lag, step)


def _share(lag: float, step: float) -> float:
    """Return the share of the way to its command that an actuator goes in a control step."""
    return 1.0 if lag == 0.0 else -math.expm1(-step / lag)


def _objective(scene: Scene, task: NDArray[np.float64]) -> None:
    objective = scene.objective
    task[at.WEIGHT_DISPLACEMENT] = objective.displacement_weight / objective.displacement_scale**2
    task[at.WEIGHT_VELOCITY] = objective.velocity_weight / objective.velocity_scale**2
    task[at.WEIGHT_STROKE] = objective.stroke_weight / objective.stroke_scale**2
    task[at.WEIGHT_EFFORT] = objective.effort_weight
    task[at.DISPLACEMENT_LIMIT] = (
        np.inf if objective.displacement_limit is None else objective.displacement_limit
    )
    task[at.RAIL_LIMIT] = (
        np.inf if objective.rail_half_length is None else objective.rail_half_length
    )
    task[at.STEPS] = scene.control.steps


def scale_and_zero(scene: Scene, channel: str) -> tuple[float, float]:
    """Return the factor of a channel and the value shown as zero: observations are of order one."""
    objective, actuator = scene.objective, scene.actuation.stretch
    if channel == "stretch":
        if actuator is None:
            return 1.0, 0.0
        return 2.0 / (actuator.maximum - actuator.minimum), 0.5 * (
            actuator.maximum + actuator.minimum
        )
    displacement, velocity = objective.displacement_scale, objective.velocity_scale
    scales = {
        "displacement": displacement,
        "offset": objective.stroke_scale,
        "velocity": velocity,
        "acceleration": velocity**2 / displacement,
        "force": scene.carriage.stiffness * displacement,
    }
    return 1.0 / scales[channel.rpartition("_")[2]], 0.0
