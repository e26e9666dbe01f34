"""The spaces of actions and observations of one lane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from gymnasium.spaces import Box

from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant


def action_space(plant: Plant) -> Box:
    """Return the space of actions: one number in [-1, 1] per actuator."""
    return Box(-1.0, 1.0, (len(plant.actuators),), np.float32)


def observation_space(plant: Plant) -> Box:
    """Return the space of observations: the scaled channels of each frame, oldest frame first."""
    size = plant.history * len(plant.channels)
    return Box(-at.OBSERVATION_BOUND, at.OBSERVATION_BOUND, (size,), np.float32)
