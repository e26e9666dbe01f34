"""Central differences over rows of lanes, for what has no derivative of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene
    from mm_gym.sensitivity.jacobian import Sensitivities

    Array = NDArray[np.float64]


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
