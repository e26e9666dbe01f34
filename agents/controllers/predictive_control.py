"""Predictive control: plans tried on the scene's own model, of which the best is begun."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.actuators import Actuators
from agents.controllers.controller import columns
from agents.controllers.cross_entropy import Search
from agents.controllers.forecast import Forecast
from agents.controllers.model import Model, require_reward_of_motion

if TYPE_CHECKING:
    from agents.controllers.controller import Law, Values
    from mm_gym import Scene

SEED = 4_000_000
SEARCH = Search(horizon=30, plans=48, elite=5, rounds=2, kept=5, spread=0.6, least_spread=0.05)


class PredictiveControl:
    """Try plans over a receding horizon by the cross-entropy method, and begin the best.

    The first plans are those of a law, the rest of the last step's plan, and the constant ones. The
    model knows the state that is given, and follows the interface's own; the disturbance to come is
    its conditional mean, see `Forecast`. Mayne, Rawlings, Rao and Scokaert, *Constrained model
    predictive control*, Automatica 36 (2000).

    Parameters
    ----------
    scene
        The scene that is controlled.
    law
        A law without memory, whose own plan is among the first.
    search
        How plans are searched.

    Raises
    ------
    DesignError
        If the reward reads what a disturbance is, not what it does.
    """

    def __init__(self, scene: Scene, law: Law, search: Search = SEARCH) -> None:
        require_reward_of_motion(scene)
        self.name = f"predictive control, {search.horizon} steps ahead"
        self.scene, self.law, self.search = scene, law, search
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
        self.own = self.one.own
        self.last: tuple[Values, Values] | None = None  # state, and the force expected after it
        self.noise = np.random.default_rng(SEED)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the first action of the best plan."""
        asked = applied if self.asked is None else self.asked
        self._follow_own(applied)
        forces = self.forecast.ahead(state, applied, self.search.horizon)
        first = [self._plan_of_law(state, applied, asked, forces), self.plan]
        first += [np.full(self.plan.shape, value) for value in (-1.0, 0.0, 1.0)]
        best = self.search.best(
            np.stack(first, axis=2),
            lambda plans: self._worth(plans, state, (applied, asked), forces),
            self.noise,
        )
        self.plan = np.concatenate([best[1:], best[-1:]])
        _, self.asked = self.actuators.reached(best[0], applied, asked)
        self.last = state.copy(), forces[0]
        return best[0]

    def _follow_own(self, applied: Values) -> None:
        """Move the interface's own states on by the last step, in which so much was applied."""
        if self.last is not None and self.one.own_rows:
            state, force = self.last
            self.one.begin(state, self.own)
            self.one.advance(applied, force)
            self.own = self.one.own

    def _plan_of_law(self, state: Values, applied: Values, asked: Values, forces: Values) -> Values:
        plan = np.empty(self.plan.shape)
        self.one.begin(state, self.own)
        for step, force in enumerate(forces):
            plan[step] = np.clip(self.law.action(state, applied), -1.0, 1.0)
            applied, asked = self.actuators.reached(plan[step], applied, asked)
            state = self.one.advance(applied, force)[0]
        return plan

    def _worth(
        self, plans: Values, state: Values, actuators: tuple[Values, Values], forces: Values
    ) -> Values:
        """Return the sums of rewards (lanes, plans) of the plans."""
        count = self.search.plans
        applied, asked = (np.repeat(value, count, axis=0) for value in actuators)
        self.many.begin(np.repeat(state, count, axis=0), np.repeat(self.own, count, axis=1))
        price, pushed = self.many.effort_weight, np.repeat(forces, count, axis=1)
        actions = plans.reshape(len(plans), -1, self.columns)
        total = -price * (actions**2).sum(axis=(0, 2))
        for each, force in zip(actions, pushed, strict=True):
            applied, asked = self.actuators.reached(each, applied, asked)
            total += self.many.advance(applied, force)[1]
        return total.reshape(self.lanes, count)
