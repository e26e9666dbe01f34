"""The state some time ahead, for laws that switch springs which take time to stretch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

from agents.controllers.controller import require_actuator
from mm_gym import compile_scene
from mm_gym.analysis import spring_stiffness

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

STRETCHES = 41
"""Number of stretches at which the transition is computed; the nearest is used."""


class Lead:
    """Move a state ahead by half the time in which the springs cross their range, and by their lag.

    The present stretch is taken to stay, and no force to act. Without it, a switch comes a quarter
    of a period late where springs need half a period to cross. Springs that need more than the
    sphere's fastest period do not switch within it, and for them there is no lead but the lag.
    """

    def __init__(self, scene: Scene) -> None:
        require_actuator(scene, "stretch")
        actuator = scene.actuation.stretch
        assert actuator is not None  # noqa: S101 - as required
        self.low, self.range = actuator.minimum, actuator.maximum - actuator.minimum
        rate = np.inf if actuator.rate_limit is None else actuator.rate_limit
        crossing = self.range / rate
        stiffest = spring_stiffness(self.low, scene.springs.stiffness)
        period = 2.0 * np.pi * np.sqrt(scene.sphere.mass / stiffest)
        self.time = actuator.lag + (0.5 * crossing if crossing < period else 0.0)
        stretches = self.low + self.range * np.linspace(0.0, 1.0, STRETCHES)
        k2 = spring_stiffness(stretches, scene.springs.stiffness)
        soft, stiff = (compile_scene(scene).linear(s)[0] for s in (stretches[-1], stretches[0]))
        share = (k2 - k2[-1]) / (k2[0] - k2[-1])  # A is affine in k2
        self.transitions = expm((soft + share[:, None, None] * (stiff - soft)) * self.time)

    def __call__(self, state: Values, stretch: Values) -> Values:
        """Return the states (lanes, 4) ahead, from those now and the stretches (lanes,)."""
        share = np.clip((stretch - self.low) / self.range, 0.0, 1.0)
        nearest = np.rint(share * (STRETCHES - 1)).astype(np.intp)
        return np.einsum("nij,nj->ni", self.transitions[nearest], state)
