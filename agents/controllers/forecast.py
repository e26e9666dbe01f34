"""The disturbing force to come: its conditional mean, by linear prediction from the past."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.disturbance import ORDER, ForceObserver, prediction_weights
from agents.controllers.frequency_estimators import LinearPrediction

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class Forecast:
    """Predict the force on the carriage, constant over each control step.

    Past forces come from a `ForceObserver`. A harmonic force continues with the frequency that
    `LinearPrediction` finds; of other excitation each force is predicted from the eight before by
    weights that are the same in all episodes.
    """

    def __init__(self, scene: Scene) -> None:
        kinds = {part.kind for part in scene.excitation}
        self.silent, self.harmonic = not kinds, kinds == {"harmonic"}
        self.step = scene.control.time_step
        self.observer = LinearPrediction(scene) if self.harmonic else ForceObserver(scene)
        if not self.silent and not self.harmonic:
            self.weights = prediction_weights(scene)

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        self.observer.begin(lanes)
        self.past: list[Values] = [np.zeros(lanes)] * ORDER

    def ahead(self, state: Values, applied: Values, steps: int) -> Values:
        """Return the forces (steps, lanes) [N] of the steps to come; call it at each step."""
        forces = np.zeros((steps, len(state)))
        if self.silent:
            return forces
        if isinstance(self.observer, LinearPrediction):
            frequency = self.observer.frequency(state, applied)
            found = np.isfinite(frequency)  # not where the force has been zero so far
            factor = 2.0 * np.cos(np.where(found, frequency, 0.0) * self.step)
            if len(self.observer.forces) < 3:  # noqa: PLR2004 - as LinearPrediction
                return forces
            _, before, last = (np.where(found, value, 0.0) for value in self.observer.forces)
            for force in forces:
                before, last = last, factor * last - before
                force[:] = last
            return forces
        force = self.observer.force(state, applied)
        if force is not None:
            self.past = [force, *self.past[:-1]]
        past = self.past
        for force in forces:
            force[:] = sum(weight * value for weight, value in zip(self.weights, past, strict=True))
            past = [force, *past[:-1]]
        return forces
