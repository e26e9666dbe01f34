"""The force of the sphere's springs, as controllers know it: with the middle of each range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis import spring_stiffness

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Values
    from mm_gym import Scene


def middle(scene: Scene, name: str) -> float:
    """Return the middle of a field's range, or its number, by dotted name."""
    return float(np.mean(scene.range_of(name, scene.value_of(name))))


def sphere_springs(scene: Scene) -> Callable[[Values], Values]:
    """Return the springs' force [N] on the carriage over relative displacements x2 - x1 [m].

    The sphere feels the opposite. See (5) and (6) of docs/model.md.
    """
    kind = scene.springs.kind
    if kind == "none":
        return np.zeros_like
    stiffness = middle(scene, "springs.stiffness")
    if kind == "linear":
        cubic = middle(scene, "springs.cubic_coefficient")
        return lambda offset: stiffness * (1.0 + cubic * offset**2) * offset
    stretch = middle(scene, "springs.stretch")
    if kind == "small_on_large":
        return lambda offset: spring_stiffness(stretch, stiffness) * offset
    length = middle(scene, "springs.rest_length")

    def pair(offset: Values) -> Values:
        product = stretch**2 - (offset / length) ** 2
        return 2.0 * stiffness * offset * (1.0 + 2.0 * stretch / product**2)

    return pair
