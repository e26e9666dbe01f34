"""Frequency tracking: an absorber tuned to the frequency that it finds in the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.stretch_command import StretchCommand, require_stable_rest
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from agents.controllers.frequency_estimators import FrequencyEstimator
    from mm_gym import Scene


def reachable_band(scene: Scene) -> tuple[float, float]:
    """Return the frequencies [rad/s] with which the springs can make the sphere resonate."""
    actuator = StretchCommand(scene).actuator
    ends = spring_stiffness([actuator.maximum, actuator.minimum], scene.springs.stiffness)
    low, high = np.sqrt(ends / scene.sphere.mass)
    return float(low), float(high)


class FrequencyTracking:
    """Hold the stretch at which the sphere resonates with the frequency that is estimated.

    As `MatchingStretch`, from measured signals alone. Until the estimate begins the stretch stays.
    """

    def __init__(self, scene: Scene, estimator: FrequencyEstimator) -> None:
        require_stable_rest(scene, "frequency tracking")
        self.name = f"frequency tracking, {estimator.name}"
        self.estimator, self.command = estimator, StretchCommand(scene)
        self.mass, self.stiffness = scene.sphere.mass, scene.springs.stiffness

    def begin(self, lanes: int) -> None:
        """Prepare the estimator."""
        self.estimator.begin(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the matching stretch."""
        frequency = self.estimator.frequency(state, applied)
        present = applied[:, -1]
        matching = stretch_for_stiffness(self.mass * frequency**2, self.stiffness)
        return self.command(np.where(np.isnan(frequency), present, matching), present)
