"""The disturbance to come: its conditional mean, from the past or the filters that shape it."""

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from agents.control.controller import Acted, Memory, chosen, joined, looked_up, part
from agents.control.model import (
    ORDER,
    ForceObserver,
    Innovation,
    force_column,
    prediction_weights,
    state_scales,
)
from agents.control.observed_state import missed_covariance
from agents.control.scene import STATES, plant_of
from agents.controllers.frequency_tracking import LinearPrediction
from mm_gym import DesignError, LinearSystem, Scene
from mm_gym.arrays import Array

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
        if self.silent:
            return {}
        return {**joined(observer=self.observer.begin(lanes)), "past": np.zeros((lanes, ORDER))}

    def ahead(self, memory: Memory, state: Array, applied: Array, steps: int) -> Acted:
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
    `ExcitationFilter`. Nothing else is predicted then. Without such noise, as the force of a
    `Forecast`.
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
        return (self.forces if self.filter is None else self.filter).begin(lanes)

    def ahead(
        self, memory: Memory, state: Array, applied: Array, steps: int
    ) -> tuple[Array | None, Memory]:
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


UNMODELLED = 1e-3  # of what else disturbs the motion, by default
LONGEST = 1000  # steps after which the filter's gain is taken to have settled


class ExcitationFilter:
    """A Kalman filter of the shaping filters' states, from what a model of the motion missed.

    Raise `DesignError` if no random noise excites the scene.

    Parameters
    ----------
    scene
        The scene whose motion is observed, by sensors whose errors are not taken for excitation.
    system
        Its sampled plant; the first states are the motion.
    unmodelled
        Standard deviation of what else disturbs the motion in a step over the objective's scales.

    Attributes
    ----------
    rows
        Those of the shaping filters in the system.
    kept, gains
        (steps, rows, rows) and (steps, rows, 4): in each step the filters' states become `kept`
        times the last ones, plus the gain times what the model missed.
    """

    def __init__(self, scene: Scene, system: LinearSystem, unmodelled: float = UNMODELLED) -> None:
        names = [signal.name for signal in system.states]
        self.rows = rows = [k for k, name in enumerate(names) if ".filter" in name]
        if not rows:
            msg = "excitation: contains no noise, so there is nothing to predict"
            raise DesignError(msg)
        self.innovation = Innovation(scene)
        self.turn, self.shown = system.A[np.ix_(rows, rows)], system.A[:4, rows]
        own, both = system.process_noise[np.ix_(rows, rows)], system.process_noise[rows, :4]
        further = np.diag((unmodelled * state_scales(scene)) ** 2)
        missed = system.process_noise[:4, :4] + further + missed_covariance(scene)
        noise = np.block([[own, both], [both.T, missed]])  # the same drives both
        self.kept, self.gains = self._gains(noise, own, min(LONGEST, scene.control.steps))

    def _gains(self, noise: Array, own: Array, steps: int) -> tuple[Array, Array]:
        """Return `kept` and `gains`, from the stationary distribution on."""
        count, spread = len(self.turn), solve_discrete_lyapunov(self.turn, own)
        kept, gains = np.empty((steps, count, count)), np.empty((steps, count, 4))
        for step in range(steps):
            seen = self.shown @ spread @ self.shown.T + noise[count:, count:]
            cross = self.turn @ spread @ self.shown.T + noise[:count, count:]
            gains[step] = gain = np.linalg.solve(seen, cross.T).T
            kept[step] = left = self.turn - gain @ self.shown
            both = np.hstack([np.eye(count), -gain])
            spread = left @ spread @ left.T + both @ noise @ both.T  # Joseph's form
        return kept, gains

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(innovation=self.innovation.begin(lanes)),
            "step": np.zeros(lanes, np.int64),
            "state": np.zeros((lanes, len(self.turn))),
        }

    def observe(self, memory: Memory, state: Array, applied: Array) -> Memory:
        """Return the memory; its "state" (lanes, rows) is that of the filters, estimated."""
        missed, known, own = self.innovation.missed(part(memory, "innovation"), state, applied)
        step, last = np.minimum(memory["step"], len(self.gains) - 1), memory["state"]
        moved = np.einsum("lij,lj->li", looked_up(self.kept[None], step), last)
        moved = moved + np.einsum("lij,lj->li", looked_up(self.gains[None], step), missed)
        return {
            **joined(innovation=own),
            "step": memory["step"] + known,
            "state": chosen(known, moved, last),
        }

    def ahead(self, memory: Memory, steps: int) -> Array:
        """Return what is expected to be added to the motion (steps, lanes, 4) in steps to come."""
        state = memory["state"]
        added = np.empty((steps, len(state), 4))
        for step in added:
            step[:] = state @ self.shown.T
            state = state @ self.turn.T
        return added
