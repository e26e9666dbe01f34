"""The disturbance to come: its conditional mean, from the past."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import chosen, joined, part, plant_of
from agents.controllers.disturbance import (
    ORDER,
    ForceObserver,
    force_column,
    prediction_weights,
)
from agents.controllers.excitation_filter import ExcitationFilter
from agents.controllers.frequency_estimators import LinearPrediction
from agents.controllers.lqr import STATES

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Memory, Values
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

    def begin(self, lanes: int) -> Memory:
        """Return the memory of new episodes."""
        if self.silent:
            return {}
        return {**joined(observer=self.observer.begin(lanes)), "past": np.zeros((lanes, ORDER))}

    def ahead(self, memory: Memory, state: Values, applied: Values, steps: int) -> Acted:
        """Return the forces (steps, lanes) [N] of the steps to come; call it at each step."""
        forces = np.zeros((steps, len(state)))
        if self.silent:
            return forces, memory
        own, past = part(memory, "observer"), memory["past"]
        if isinstance(self.observer, LinearPrediction):
            frequency, own = self.observer.frequency(own, state, applied)
            found = np.isfinite(frequency)  # not at the start, nor where the force has been zero
            factor = 2.0 * np.cos(np.where(found, frequency, 0.0) * self.step)
            before, last = (np.where(found, force, 0.0) for force in own["forces"].T[1:])
            for force in forces:
                before, last = last, factor * last - before
                force[:] = last
            return forces, {**joined(observer=own), "past": past}
        force, known, own = self.observer.force(own, state, applied)
        past = chosen(known, np.column_stack([force, past[:, :-1]]), past)
        memory, newest = {**joined(observer=own), "past": past}, list(past.T)
        for force in forces:
            pairs = zip(self.weights, newest, strict=True)
            force[:] = sum(weight * value for weight, value in pairs)
            newest = [force, *newest[:-1]]
        return forces, memory


class PushForecast:
    """Predict what the disturbance adds to the motion in each control step.

    Noise that a filter shapes, on the carriage or the ground, by the filter's state; see
    `ExcitationFilter`. Other excitation as the force of a `Forecast`.
    """

    def __init__(self, scene: Scene) -> None:
        self.silent = not scene.excitation
        self.filter: ExcitationFilter | None = None
        if any(part.kind in SHAPED for part in scene.excitation):
            system = plant_of(scene).state_space([], STATES, sampled=True)
            self.filter = ExcitationFilter(scene, system)
        else:
            self.forces, self.column = Forecast(scene), force_column(scene)

    def begin(self, lanes: int) -> Memory:
        """Return the memory of new episodes."""
        return (self.forces if self.filter is None else self.filter).begin(lanes)

    def ahead(
        self, memory: Memory, state: Values, applied: Values, steps: int
    ) -> tuple[Values | None, Memory]:
        """Return what is added to x1, x2 [m], v1, v2 [m/s], (steps, 4, lanes), or None for nothing.

        Call it at each step.
        """
        if self.silent:
            return None, memory
        if self.filter is None:
            forces, memory = self.forces.ahead(memory, state, applied, steps)
            return forces[:, None] * self.column[:, None], memory
        memory = self.filter.observe(memory, state, applied)
        return np.moveaxis(self.filter.ahead(memory, steps), 1, 2), memory
