"""The disturbance to come: its conditional mean, from the past."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.disturbance import (
    ORDER,
    ForceObserver,
    force_column,
    prediction_weights,
)
from agents.controllers.excitation_filter import ExcitationFilter
from agents.controllers.frequency_estimators import LinearPrediction
from agents.controllers.lqg import MOTION
from mm_gym import compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

SHAPED = ("noise", "kanai_tajimi", "clough_penzien")
"""Kinds of excitation whose next values follow from the state of a filter."""


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


class PushForecast:
    """Predict what the disturbance adds to the motion in each control step.

    Noise that a filter shapes, on the carriage or the ground, by the filter's state; see
    `ExcitationFilter`. Other excitation as the force of a `Forecast`.
    """

    def __init__(self, scene: Scene) -> None:
        self.silent = not scene.excitation
        self.filter: ExcitationFilter | None = None
        if any(part.kind in SHAPED for part in scene.excitation):
            system = compile_scene(scene).state_space([], MOTION, sampled=True)
            self.filter = ExcitationFilter(scene, system)
        else:
            self.forces, self.column = Forecast(scene), force_column(scene)

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        if self.filter is None:
            self.forces.begin(lanes)
        else:
            self.filter.begin(lanes)

    def ahead(self, state: Values, applied: Values, steps: int) -> Values | None:
        """Return what is added to x1, x2 [m], v1, v2 [m/s], (steps, 4, lanes), or None for nothing.

        Call it at each step.
        """
        if self.silent:
            return None
        if self.filter is None:
            forces = self.forces.ahead(state, applied, steps)
            return forces[:, None] * self.column[:, None]
        self.filter.observe(state, applied)
        return np.moveaxis(self.filter.ahead(steps), 1, 2)
