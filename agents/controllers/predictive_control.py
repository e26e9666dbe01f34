"""Predictive control: plans tried on the scene's own model, of which the best is begun."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from agents.control.actuators import Actuators
from agents.control.controller import Acted, Law, Memory, chosen, joined, part
from agents.control.feedback import Feedback
from agents.control.model import Model, require_reward_of_motion
from agents.control.trajectories import ends_of
from agents.controllers.forecast import Forecast
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.noise import Noise
from agents.controllers.registry import Entry
from agents.controllers.tuned import best_law, classical_laws
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

Start: TypeAlias = tuple[Array, Array, tuple[Array, Array]]
"""States of the motion, the interface's own ones, and what actuators have and were asked."""

QUICK, SHORT = 0.002, 20  # control steps [s] up to which fewer steps ahead are planned, to keep up

SEED = 4_000_000

ENDED = 1e9
"""What a step costs after an early end: every plan that stays within the limits is better, and of
two that do not the one that ends later."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """Search for plans by the cross-entropy method.

    De Boer et al., *A tutorial on the cross-entropy method*, Ann. Oper. Res. 134 (2005).
    """

    horizon: int  # control steps planned ahead
    # plans, elite, rounds: plans tried at once, those that the next are drawn around, and
    # repetitions
    plans: int
    elite: int
    rounds: int
    kept: int  # best plans that are tried again in the next round, at most `elite`
    # spread, least_spread: standard deviation of the first plans' actions, and the least later on
    # [-]
    spread: float
    least_spread: float = 0.0


SEARCH = Search(horizon=30, plans=48, elite=5, rounds=2, kept=5, spread=0.6, least_spread=0.05)


class PredictiveControl(Law):
    """Try plans over a receding horizon by the cross-entropy method, and begin the best.

    The first plans are those of a law, the rest of the last step's plan, and the constant ones. The
    model knows the state that is given, and follows the interface's own; the disturbance to come is
    its conditional mean, see `Forecast`. Plans stay within the limits at which an episode ends, if
    one of those tried does. Mayne, Rawlings, Rao and Scokaert, *Constrained model predictive
    control*, Automatica 36 (2000). Raise `DesignError` if the reward reads what a disturbance is,
    not what it does.
    """

    def __init__(self, scene: Scene, law: Law, search: Search = SEARCH) -> None:
        require_reward_of_motion(scene)
        self.name = f"predictive control, {search.horizon} steps ahead"
        self.law, self.search = law, search
        self.columns = len(scene.actuation.names)
        self.actuators, self.forecast = Actuators(scene), Forecast(scene)
        self.model, self.noise = Model(scene), Noise(SEED)
        self.ends = ends_of(scene.objective)

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(forecast=self.forecast.begin(lanes), law=self.law.begin(lanes)),
            "begun": np.zeros(lanes, np.bool_),
            "plan": np.zeros((lanes, self.search.horizon, self.columns)),
            "asked": np.zeros((lanes, self.columns)),
            "own": self.model.at_rest(lanes),
            "state": np.zeros((lanes, 4)),  # the last one, and the force expected after it
            "force": np.zeros(lanes),
            "noise": self.noise.begin(lanes),
        }

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        asked = chosen(memory["begun"], memory["asked"], applied)
        own = self._own(memory, applied)
        forces, forecast = self.forecast.ahead(
            part(memory, "forecast"), state, applied, self.search.horizon
        )
        start = state, own, (applied, asked)
        plan = np.moveaxis(memory["plan"], 1, 0)
        of_law, law = self._plan_of_law(part(memory, "law"), start, forces)
        first = [of_law, plan, *(np.full(plan.shape, value) for value in (-1.0, 0.0, 1.0))]
        search, noise, rows = self.search, memory["noise"], np.arange(len(state))[:, None]
        mean, kept, spread = of_law, np.stack(first, axis=2), np.full(plan.shape, search.spread)
        for _ in range(search.rounds):
            shape = (*plan.shape[:2], search.plans, self.columns)
            drawn, noise = self.noise.drawn(noise, shape, axis=1)
            plans = mean[:, :, None] + spread[:, :, None] * drawn
            plans[:, :, : kept.shape[2]] = kept
            np.clip(plans, -1.0, 1.0, out=plans)
            order = np.argsort(-self._worth(plans, start, forces), axis=1)[:, : search.elite]
            elite = plans[:, rows, order]
            kept, mean = elite[:, :, : search.kept], elite.mean(axis=2)
            spread = np.maximum(elite.std(axis=2), search.least_spread)
        best = kept[:, :, 0]
        return best[0], {
            **joined(forecast=forecast, law=law),
            "begun": np.ones_like(memory["begun"]),
            "plan": np.moveaxis(np.concatenate([best[1:], best[-1:]]), 0, 1),
            "asked": self.actuators.reached(best[0], applied, asked)[1],
            "own": own,
            "state": state.copy(),
            "force": forces[0],
            "noise": noise,
        }

    def _own(self, memory: Memory, applied: Array) -> Array:
        """Return the interface's own states after the last step, in which so much was applied."""
        begun, own = memory["begun"], memory["own"]
        if not (begun.any() and self.model.own_rows):
            return own
        self.model.begin(memory["state"], own)
        self.model.advance(applied, memory["force"])
        return chosen(begun, self.model.own, own)

    def _plan_of_law(self, memory: Memory, start: Start, forces: Array) -> Acted:
        """Return the law's plan, and its memory after the first step."""
        state, own, (applied, asked) = start
        plan, memories = np.empty((*forces.shape, self.columns)), []
        self.model.begin(state, own)
        for step, force in enumerate(forces):
            action, memory = self.law.action(memory, state, applied)
            memories.append(memory)
            plan[step] = np.clip(action, -1.0, 1.0)
            applied, asked = self.actuators.reached(plan[step], applied, asked)
            state = self.model.advance(applied, force)[0]
        return plan, memories[0]

    def _worth(self, plans: Array, start: Start, forces: Array) -> Array:
        """Return the sums of rewards (lanes, plans) of the plans."""
        state, own, (applied, asked) = start
        state, own, applied, asked = (
            np.repeat(value, self.search.plans, axis=0) for value in (state, own, applied, asked)
        )
        self.model.begin(state, own)
        pushed = np.repeat(forces, self.search.plans, axis=1)
        actions = plans.reshape(len(plans), -1, self.columns)
        total = -self.model.effort_weight * (actions**2).sum(axis=(0, 2))
        beyond = np.zeros(len(total), np.bool_)
        for each, force in zip(actions, pushed, strict=True):
            applied, asked = self.actuators.reached(each, applied, asked)
            state, rewards = self.model.advance(applied, force)
            for limit, of in self.ends:
                beyond |= np.abs(state[:, :2] @ of) >= limit
            total += np.where(beyond, -ENDED, rewards)
        return total.reshape(plans.shape[1:3])


def predictive_control(scene: Scene, law: Law) -> Feedback:
    """Return predictive control of the quickest kind that suits a scene.

    Plans are improved by derivatives where a force acts, if actuators and control steps allow it;
    elsewhere they are searched around a law.
    """
    if scene.actuation.force is not None and scene.control.time_step > QUICK:
        with suppress(DesignError):
            return Feedback(scene, NewtonPredictiveControl(scene))
    horizon = SHORT if scene.control.time_step <= QUICK else SEARCH.horizon
    return Feedback(scene, PredictiveControl(scene, law, replace(SEARCH, horizon=horizon)))


ENTRIES = (
    Entry(
        "predictive-control",
        (),
        lambda scene: predictive_control(scene, best_law(scene, classical_laws(scene))),
        3,
        "any",
    ),
)
