"""What a step returns: the spaces, the terms of the reward, and the constraint."""

from __future__ import annotations

from typing import Literal, TypeAlias, cast, get_args

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.errors import check_name
from mm_gym.lanes import layout
from mm_gym.plant.plant import Plant
from mm_gym.plant.task import Observed
from mm_gym.step.channels import CHANNELS

ROUNDINGS = 4  # at least as many as a kernel makes while it scales a value


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
    row, support, low, high = CHANNELS[channel.name].row, plant.support, -np.inf, np.inf
    if row == layout.FORCE:
        low, high = -plant.task[layout.FORCE_LIMIT], plant.task[layout.FORCE_LIMIT]
    elif row in (layout.STRETCH, layout.DAMPING):
        low, high = support.low[row], support.high[row]
    bias = support.names.get(f"sensors.bias.{channel.name}")
    is_biased = bias is not None and (support.low[bias] < 0.0 or support.high[bias] > 0.0)
    # A constant would make a box that cannot be scaled.
    if channel.noise > 0.0 or is_biased or not low < high:
        low, high = -np.inf, np.inf
    return _shown(low, channel, -1), _shown(high, channel, 1)


def _shown(value: float, channel: Observed, side: int) -> float:
    """Return a bound as it is shown, a little farther out on its side for what is rounded."""
    if np.isinf(value):
        return value
    product, shift = value * channel.factor, channel.zero * channel.factor
    slack = ROUNDINGS * np.finfo(np.float64).eps * (abs(product) + abs(shift))
    return product - shift + side * slack


InfoLevel: TypeAlias = Literal["none", "light", "full"]
"""none: nothing; light: state and what the actuators applied; full: reward terms and constraint."""

TERMS = ("reward_displacement", "reward_velocity", "reward_effort", "reward_stroke")
"""Terms of the reward, which is their sum."""

REACTIONS = {
    "reward_carriage_acceleration": layout.WEIGHT_CARRIAGE_ACCELERATION,
    "reward_sphere_acceleration": layout.WEIGHT_SPHERE_ACCELERATION,
    "reward_coupling_force": layout.WEIGHT_COUPLING_FORCE,
}
"""Further terms, each of a scene that has its weight, and the weight's slot."""

OWN = "reward_own"  # the only term of a caller's own reward


def checked_level(level: str) -> InfoLevel:
    """Return a level of information, or raise `SceneError` with the nearest."""
    check_name("info", level, get_args(InfoLevel))
    return cast("InfoLevel", level)


class Terms:
    """The reward's terms, by `names`, and the constraint of a plant's lanes.

    A caller's own reward has one term.
    """

    def __init__(self, plant: Plant, *, own: bool = False) -> None:
        task = plant.task
        self._reactions = {name: task[slot] for name, slot in REACTIONS.items() if task[slot] > 0.0}
        self.names = (OWN,) if own else (*TERMS, *self._reactions)
        self._weights = (
            *(task[layout.WEIGHT_DISPLACEMENT], task[layout.WEIGHT_VELOCITY]),
            *(task[layout.WEIGHT_EFFORT], task[layout.WEIGHT_STROKE]),
        )
        self._furthest, self._rail = task[layout.DISPLACEMENT_LIMIT], task[layout.RAIL_LIMIT]
        self._actuators = len(plant.actuators)

    def rewards(
        self, lanes: Array, actions: NDArray[np.floating], rewards: Array
    ) -> dict[str, Array]:
        """Return the reward's terms (lanes,) of a step [-]; of the objective's none is positive.

        Lanes are (rows, lanes) at the step's end, actions (actuators * lanes,) as the kernels take
        them, rewards (lanes,) those of the step.
        """
        if self.names == (OWN,):
            return {OWN: rewards.copy()}
        displacement, velocity, effort, stroke = self._weights
        x1, x2, v1 = lanes[layout.X1], lanes[layout.X2], lanes[layout.V1]
        clipped = np.clip(actions.astype(np.float64), -1.0, 1.0).reshape(self._actuators, -1)
        values = (
            displacement * x1 * x1,
            velocity * v1 * v1,
            effort * (clipped * clipped).sum(axis=0),
            stroke * (x2 - x1) * (x2 - x1),
            *(weight * _reaction(lanes, name) ** 2 for name, weight in self._reactions.items()),
        )
        return {name: 0.0 - value for name, value in zip(self.names, values, strict=True)}

    def constraint(self, state: Array) -> dict[str, Array]:
        """Return what the limits leave (lanes,), by state (4, lanes); see `MovingMassEnv`.

        A limit that is not set counts as infinite.
        """
        x1, offset = np.abs(state[0]), np.abs(state[1] - state[0])
        used = np.maximum(x1 / self._furthest, offset / self._rail)
        exceeded = (x1 > self._furthest) | (offset > self._rail)
        return {"cost": exceeded.astype(np.float64), "constraint": used - 1.0}


def _reaction(lanes: Array, name: str) -> Array:
    """Return what a further term squares (lanes,) [m/s^2 or N]."""
    if name == "reward_carriage_acceleration":
        return lanes[layout.CARRIAGE_ACCELERATION]
    mass = lanes[layout.M2] if name == "reward_coupling_force" else 1.0
    return mass * lanes[layout.SPHERE_ACCELERATION]
