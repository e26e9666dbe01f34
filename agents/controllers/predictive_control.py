"""Predictive control: plans tried on the scene's own model, of which the best is begun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.actuators import Actuators
from agents.controllers.controller import columns
from agents.controllers.forecast import Forecast
from agents.controllers.model import Model

if TYPE_CHECKING:
    from agents.controllers.controller import Law, Values
    from mm_gym import Scene

CORRELATION = 0.6
"""Correlation of successive actions' noise; white noise would hardly move the carriage."""

SEED = 4_000_000


@dataclass(frozen=True)
class Search:
    """How plans are searched.

    Attributes
    ----------
    horizon
        Control steps planned ahead.
    plans, elite, rounds
        Plans tried at once, those that the next are drawn around, and repetitions.
    spread, least_spread
        Standard deviation of the first plans' actions, and the least later on [-].
    """

    horizon: int = 30
    plans: int = 48
    elite: int = 5
    rounds: int = 2
    spread: float = 0.6
    least_spread: float = 0.05


class PredictiveControl:
    """Try plans over a receding horizon by the cross-entropy method, and begin the best.

    The first plans are those of a law, the rest of the last step's plan, and the constant ones. The
    model knows the state that is given; the disturbance to come is its conditional mean, see
    `Forecast`. Mayne, Rawlings, Rao and Scokaert, *Constrained model predictive control*,
    Automatica 36 (2000); de Boer et al., *A tutorial on the cross-entropy method*, Ann. Oper. Res.
    134 (2005).

    Parameters
    ----------
    scene
        The scene that is controlled.
    law
        A law without memory, whose own plan is among the first.
    search
        How plans are searched.
    """

    def __init__(self, scene: Scene, law: Law, search: Search | None = None) -> None:
        self.name = f"predictive control, {(search or Search()).horizon} steps ahead"
        self.scene, self.law, self.search = scene, law, search or Search()
        self.columns = len(columns(scene))
        self.actuators, self.forecast = Actuators(scene), Forecast(scene)

    def begin(self, lanes: int) -> None:
        """Begin without a plan."""
        search = self.search
        self.lanes = lanes
        self.forecast.begin(lanes)
        self.law.begin(lanes)
        self.one, self.many = Model(self.scene, lanes), Model(self.scene, lanes * search.plans)
        self.plan: Values = np.zeros((search.horizon, lanes, self.columns))
        self.asked: Values | None = None
        self.noise = np.random.default_rng(SEED)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the first action of the best plan."""
        asked = applied if self.asked is None else self.asked
        forces = self.forecast.ahead(state, applied, self.search.horizon)
        first = [self._plan_of_law(state, applied, asked, forces), self.plan]
        first += [np.full(self.plan.shape, value) for value in (-1.0, 0.0, 1.0)]
        best = self._searched(np.stack(first, axis=2), state, (applied, asked), forces)
        self.plan = np.concatenate([best[1:], best[-1:]])
        _, self.asked = self.actuators.reached(best[0], applied, asked)
        return best[0]

    def _plan_of_law(self, state: Values, applied: Values, asked: Values, forces: Values) -> Values:
        plan = np.empty(self.plan.shape)
        self.one.begin(state)
        for step, force in enumerate(forces):
            plan[step] = np.clip(self.law.action(state, applied), -1.0, 1.0)
            applied, asked = self.actuators.reached(plan[step], applied, asked)
            state = self.one.advance(applied, force)[0]
        return plan

    def _searched(
        self, first: Values, state: Values, actuators: tuple[Values, Values], forces: Values
    ) -> Values:
        """Return the best plan (steps, lanes, k) of the first (steps, lanes, plans, k) and more."""
        search, rows = self.search, np.arange(self.lanes)[:, None]
        spread = np.full(self.plan.shape, search.spread)
        mean, kept = first[:, :, 0], first
        for _ in range(search.rounds):
            plans = mean[:, :, None] + spread[:, :, None] * self._drawn()
            plans[:, :, : kept.shape[2]] = kept
            np.clip(plans, -1.0, 1.0, out=plans)
            worth = self._worth(plans, state, actuators, forces)
            elite = np.argsort(-worth, axis=1)[:, : search.elite]
            kept = plans[:, rows, elite]
            mean = kept.mean(axis=2)
            spread = np.maximum(kept.std(axis=2), search.least_spread)
        return kept[:, :, 0]

    def _drawn(self) -> Values:
        """Return noise (steps, lanes, plans, k) that is correlated from step to step."""
        shape = (self.search.horizon, self.lanes, self.search.plans, self.columns)
        noise = self.noise.standard_normal(shape)
        for i in range(1, len(noise)):
            noise[i] = CORRELATION * noise[i - 1] + np.sqrt(1.0 - CORRELATION**2) * noise[i]
        return noise

    def _worth(
        self, plans: Values, state: Values, actuators: tuple[Values, Values], forces: Values
    ) -> Values:
        """Return the sums of rewards (lanes, plans) of the plans."""
        count = self.search.plans
        applied, asked = (np.repeat(value, count, axis=0) for value in actuators)
        self.many.begin(np.repeat(state, count, axis=0))
        price, total = self.scene.objective.effort_weight, np.zeros(self.lanes * count)
        for plan, force in zip(plans, forces, strict=True):
            actions = plan.reshape(-1, self.columns)
            applied, asked = self.actuators.reached(actions, applied, asked)
            total += self.many.advance(applied, np.repeat(force, count))[1]
            total -= price * (actions**2).sum(axis=1)
        return total.reshape(self.lanes, count)
