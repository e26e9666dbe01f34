"""The spaces of actions and observations of one lane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from gymnasium.spaces import Box

from mm_gym.lanes import layout as at
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant
    from mm_gym.plant.task import Observed

ROUNDINGS = 4
"""At least as many as a kernel makes while it scales a value."""


def action_space(plant: Plant) -> Box:
    """Return the space of actions: one number in [-1, 1] per actuator."""
    return Box(-1.0, 1.0, (len(plant.actuators),), np.float32)


def observation_space(plant: Plant) -> Box:
    """Return the space of observations: the scaled channels of each frame, oldest frame first.

    Only what the actuators apply is bounded. Noise is normal, velocities have no limit, and the
    step that ends an episode at a limit of displacement goes beyond it.
    """
    bounds = np.array([_bounds(plant, channel) for channel in plant.observed], np.float32)
    low, high = np.tile(bounds.T, plant.history)
    return Box(low, high, dtype=np.float32)


def _bounds(plant: Plant, channel: Observed) -> tuple[float, float]:
    """Return the least and largest value of a channel as it is shown; infinite if not known."""
    limit = plant.task[at.FORCE_LIMIT]
    reached = {
        at.FORCE: (-limit, limit),
        at.STRETCH: (plant.support.low[at.STRETCH], plant.support.high[at.STRETCH]),
        at.DAMPING: (plant.support.low[at.DAMPING], plant.support.high[at.DAMPING]),
    }
    low, high = reached.get(CHANNELS[channel.name].row, (-np.inf, np.inf))
    # A constant would make a box that cannot be scaled.
    if channel.noise > 0.0 or _is_biased(plant, channel) or not low < high:
        low, high = -np.inf, np.inf
    return _shown(low, channel, -1), _shown(high, channel, 1)


def _is_biased(plant: Plant, channel: Observed) -> bool:
    support, name = plant.support, f"sensors.bias.{channel.name}"
    if name not in support.names:
        return False
    row = support.names[name]
    return bool(support.low[row] < 0.0 or support.high[row] > 0.0)


def _shown(value: float, channel: Observed, side: int) -> float:
    """Return a bound as it is shown, a little farther out on its side for what is rounded."""
    if np.isinf(value):
        return value
    product, shift = value * channel.factor, channel.zero * channel.factor
    slack = ROUNDINGS * np.finfo(np.float64).eps * (abs(product) + abs(shift))
    return product - shift + side * slack
