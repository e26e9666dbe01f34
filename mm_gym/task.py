"""What the agent is paid for and what it sees, as the array that the kernels read."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.scene import Channel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene import Scene

CODES = {name: code for code, name in enumerate(get_args(Channel))}
"""Code of each observation channel, in the order of `mm_gym.scene.Channel`."""


def task_array(scene: Scene) -> NDArray[np.float64]:
    """Return actuators, objective and channels in the slots of `mm_gym.kernels.layout`."""
    channels = scene.sensors.channels
    task = np.zeros(at.CHANNELS + 3 * len(channels))
    _actuators(scene, task)
    _objective(scene, task)
    task[at.CHANNEL_COUNT] = len(channels)
    for k, channel in enumerate(channels):
        slot = at.CHANNELS + 3 * k
        task[slot : slot + 3] = CODES[channel], *_scale_and_zero(scene, channel)
    return task


def _actuators(scene: Scene, task: NDArray[np.float64]) -> None:
    force, stretch, step = scene.actuation.force, scene.actuation.stretch, scene.control.time_step
    task[at.FORCE_RATE] = task[at.STRETCH_RATE] = np.inf
    if force is not None:
        task[at.HAS_FORCE], task[at.FORCE_LIMIT] = 1.0, force.limit
        if force.rate_limit is not None:
            task[at.FORCE_RATE] = force.rate_limit * step
    if stretch is not None:
        task[at.HAS_STRETCH] = 1.0
        task[at.STRETCH_LOW], task[at.STRETCH_HIGH] = stretch.minimum, stretch.maximum
        task[at.STRETCH_IS_RATE] = stretch.command == "rate"
        if stretch.rate_limit is not None:
            task[at.STRETCH_RATE] = stretch.rate_limit * step


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


def _scale_and_zero(scene: Scene, channel: str) -> tuple[float, float]:
    """Return the factor of a channel and the value shown as zero: observations are of order one."""
    objective, actuator = scene.objective, scene.actuation.stretch
    if channel == "stretch":
        if actuator is None:
            return 1.0, 0.0
        return 2.0 / (actuator.maximum - actuator.minimum), 0.5 * (
            actuator.maximum + actuator.minimum
        )
    if channel == "sphere_offset":
        return 1.0 / objective.stroke_scale, 0.0
    if channel.endswith("velocity"):
        return 1.0 / objective.velocity_scale, 0.0
    return 1.0 / objective.displacement_scale, 0.0
