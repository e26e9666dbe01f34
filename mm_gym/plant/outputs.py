"""Slopes of what lanes show and cost, and central differences for what has none of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.plant.plant import Plant
from mm_gym.scene.scene import Scene
from mm_gym.sensitivity.jacobian import Sensitivities
from mm_gym.step.channels import CHANNELS
from mm_gym.step.task import state_cost, state_weights


def difference_steps(scene: Scene, lanes: Sensitivities) -> Array:
    """Return by how much the state of lanes changes in a difference: x1, x2 [m], v1, v2 [m/s], ...

    It is the root of third order of a double's round-off, over the size of what is changed: so
    error and round-off of a smooth function are some 1e-10 of it.
    """
    scales = scene.objective
    sizes = [scales.displacement_scale] * 2 + [scales.velocity_scale] * 2
    sizes += [1.0] * (len(lanes.state_rows) - len(sizes))
    sizes += [0.5 * (actuator.high - actuator.low) for actuator in lanes.actuators]
    return np.cbrt(np.finfo(float).eps) * np.array(sizes)


def central_differences(
    function: Callable[[Array], Array], lanes: Array, rows: Sequence[int], steps: Array
) -> Array:
    """Return the slopes (..., rows, n) of a function (..., n) of lanes over some of their rows."""
    count = lanes.shape[1]
    changed = np.tile(lanes, 2 * len(rows))
    for k, (row, step) in enumerate(zip(rows, steps, strict=True)):
        changed[row, 2 * k * count : (2 * k + 1) * count] += step
        changed[row, (2 * k + 1) * count : (2 * k + 2) * count] -= step
    values = function(changed)
    pairs = values.reshape(*values.shape[:-1], len(rows), 2, count)
    return (pairs[..., 0, :] - pairs[..., 1, :]) / (2.0 * steps[:, None])


class Outputs:
    """What lanes show and cost at a control step's end, and its slopes over the motion.

    Channels of the motion and of what is applied are linear, those of the excitation do not depend
    on either, and the reward is quadratic: the slopes are exact. Accelerations, the springs' force
    and your own reward follow from motion, actuators and excitation. Where the scene shows or
    rewards one of them, all slopes are central differences, and it is derived anew at each.

    Parameters
    ----------
    scene, plant
        Those of the lanes.
    physics
        What follows their motion.
    """

    def __init__(self, scene: Scene, plant: Plant, physics: Sensitivities) -> None:
        self.plant, self.own_reward, self.physics = plant, scene.own_reward, physics
        self.rows = [*physics.state_rows, *(actuator.row for actuator in physics.actuators)]
        self.steps = difference_steps(scene, physics)
        self.channels = [(CHANNELS[c.name], c.factor) for c in plant.observed]
        derived = any(channel.row in layout.REACTIONS for channel, _ in self.channels)
        self.are_exact = not (derived or scene.own_reward or plant.scores_reactions)
        if self.are_exact:
            self._shown, self._weight = self._linear(), self._quadratic()

    def slopes(self) -> tuple[Array, Array]:
        """Return those of the channels and of the cost at the present step's end.

        They are (channels, rows, lanes), or (channels, rows, 1) where all lanes have the same, and
        (rows, lanes).
        """
        if self.are_exact:
            return self._shown, self._weight @ self.physics.lanes[self.rows]
        found = central_differences(self._values, self.physics.lanes, self.rows, self.steps)
        return found[:-1], found[-1]

    def _linear(self) -> Array:
        """Return the slopes (channels, rows, 1) of the channels over their scales."""
        rows = np.array(self.rows)
        signs = [(c.row == rows) * 1.0 - (c.subtracted == rows) for c, _ in self.channels]
        factors = np.array([factor for _, factor in self.channels])
        return (factors[:, None] * np.array(signs))[..., None]

    def _quadratic(self) -> Array:
        """Return the W (rows, rows) of the slopes W x of the cost."""
        displacement, velocity, stroke = plain(state_weights)(self.plant.task)
        weight = np.zeros((len(self.rows), len(self.rows)))
        weight[:2, :2] = 2.0 * stroke * np.array([[1.0, -1.0], [-1.0, 1.0]])
        weight[0, 0] += 2.0 * displacement
        weight[2, 2] = 2.0 * velocity
        return weight

    def _values(self, lanes: Array) -> Array:
        """Return what lanes (rows, n) show, over its scale, and their cost: (channels + 1, n)."""
        plant, own = self.plant, self.own_reward
        if plant.support.damped_row:
            lanes[plant.support.damped_row] = lanes[layout.DAMPING]
        if plant.task[layout.IS_DERIVED]:
            plant.entries.derive(plant.task, plant.model, lanes, 0, lanes.shape[1])
        shown = [
            factor
            * (lanes[c.row] - (0.0 if c.subtracted == layout.NO_ROW else lanes[c.subtracted]))
            for c, factor in self.channels
        ]
        if own is not None:
            return np.stack([*shown, own.costs(lanes)])
        weights = plain(state_weights)(plant.task)
        cost = plain(state_cost)(weights, lanes[layout.X1], lanes[layout.X2], lanes[layout.V1])
        if plant.scores_reactions:
            cost = cost + (plant.scored_reactions(lanes) ** 2).sum(axis=0)
        return np.stack([*shown, cost])
