"""The state some time ahead, for laws that switch springs or dampers which take time to change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

from agents.controllers.actuators import Command, nominal
from agents.controllers.controller import plant_of
from mm_gym.analysis import spring_stiffness

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

GRID = 41
"""Number of stretches or dampings at which the transition is computed; the nearest is used."""


class Lead:
    """Move a state ahead by half the time in which an actuator crosses its range, and by its lag.

    The present stretch or damping is taken to stay, and no force to act. Without it, a switch comes
    a quarter of a period late where springs need half a period to cross. Springs that need more
    than the fastest period of the sphere do not switch within it; a damper switches four times a
    period of the plant, and does not if it needs more than a quarter. For such there is no lead but
    the lag.

    Parameters
    ----------
    scene
        The scene that is controlled.
    name
        What is switched: "stretch" or "damping".
    factor
        Of that time [-].
    """

    def __init__(self, scene: Scene, name: str = "stretch", factor: float = 1.0) -> None:
        command = Command(scene, name)
        self.low, self.range = command.low, command.high - command.low
        crossing = self.range / command.travel * scene.control.time_step
        at = self.low + self.range * np.linspace(0.0, 1.0, GRID)
        if name == "stretch":
            stiffest = spring_stiffness(self.low, scene.springs.stiffness)
            longest = 2.0 * np.pi * np.sqrt(scene.sphere.mass / stiffest)
            first, last = (plant_of(scene).linear(s)[0] for s in (at[0], at[-1]))
            k2 = spring_stiffness(at, scene.springs.stiffness)
            share = (k2 - k2[-1]) / (k2[0] - k2[-1])  # A is affine in k2
        else:
            first, last = (_damped(scene, value) for value in (at[0], at[-1]))
            fastest = np.abs(np.linalg.eigvals(first).imag).max()
            longest = 0.5 * np.pi / fastest if fastest > 0.0 else np.inf
            share = np.linspace(1.0, 0.0, GRID)  # A is affine in the damping
        self.time = factor * (
            nominal(scene, f"actuation.{name}.lag")
            + (0.5 * crossing if crossing < longest else 0.0)
        )
        self.transitions = expm((last + share[:, None, None] * (first - last)) * self.time)

    def __call__(self, state: Values, present: Values) -> Values:
        """Return the states (lanes, 4) ahead, from those now and the stretches or dampings now."""
        if self.time == 0.0:
            return state
        share = np.clip((present - self.low) / self.range, 0.0, 1.0)
        nearest = np.rint(share * (GRID - 1)).astype(np.intp)
        return np.einsum("nij,nj->ni", self.transitions[nearest], state)


def _damped(scene: Scene, value: float) -> Values:
    """Return A (4, 4) about rest with a value of the damping that is actuated."""
    system = plant_of(scene).state_space([], [], at={str(scene.actuation.damped): value})
    return system.A[:4, :4]
