"""Predictive control: plans tried on the scene's own model, of which the best is begun."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from agents.control.actuators import Actuators
from agents.control.controller import Acted, Law, Memory, chosen, joined, part
from agents.control.feedback import Feedback
from agents.control.model import Model, require_reward_of_motion
from agents.control.trajectories import ends_of
from agents.controllers.adjustable import Adjustable
from agents.controllers.forecast import Forecast
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.noise import Noise, States
from agents.controllers.registry import Entry
from agents.controllers.tuned import best_law, classical_laws
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

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
    plans: int  # tried at once
    elite: int  # best plans, around which the next are drawn, and which are tried again with them
    rounds: int = 2
    # spread, least_spread: standard deviation of the first plans' actions, and the least later on
    # [-]
    spread: float = 0.6
    least_spread: float = 0.05


SEARCH = Search(horizon=30, plans=48, elite=5)

ROLLOUTS = Search(horizon=60, plans=64, elite=6)


class Now(NamedTuple):
    """What plans begin with."""

    # state, own: (lanes, 4) and (lanes, n), of the motion and the interface
    state: Array
    own: Array
    # applied, asked: (lanes, k), what actuators have and were asked
    applied: Array
    asked: Array
    forces: Array  # (steps, lanes) that are expected [N]
    law: Memory  # of the law


class Followed:
    """What a law does from step to step, and its memories."""

    def __init__(self, law: Law, memory: Memory) -> None:
        self.law, self.memory = law, memory
        self.actions: list[Array] = []
        self.memories: list[Memory] = []

    def __call__(self, _step: int, state: Array, applied: Array) -> Array:
        action, self.memory = self.law.action(self.memory, state, applied)
        self.memories.append(self.memory)
        self.actions.append(np.clip(action, -1.0, 1.0))
        return self.actions[-1]


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
        self.shape, self.most = (search.horizon, self.columns), 1.0  # of a plan, and its numbers
        self.actuators, self.forecast = Actuators(scene), Forecast(scene)
        self.model, self.noise = Model(scene), Noise(SEED)
        self.ends = ends_of(scene.objective)

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(forecast=self.forecast.begin(lanes), law=self.law.begin(lanes)),
            "begun": np.zeros(lanes, np.bool_),
            "plan": np.zeros((lanes, *self.shape)),
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
        now = Now(state, own, applied, asked, forces, part(memory, "law"))
        plan, noise = np.moveaxis(memory["plan"], 1, 0), memory["noise"]
        action, law, plan, noise = self._planned(now, plan, noise)
        return action, {
            **joined(forecast=forecast, law=law),
            "begun": np.ones_like(memory["begun"]),
            "plan": np.moveaxis(plan, 0, 1),
            "asked": self.actuators.reached(action, applied, asked)[1],
            "own": own,
            "state": state.copy(),
            "force": forces[0],
            "noise": noise,
        }

    def _planned(self, now: Now, plan: Array, noise: States) -> tuple[Array, Memory, Array, States]:
        """Return the action, the law's memory, the plan to begin the next step with, and noise."""
        of_law, law = self._plan_of_law(now)
        kept = [of_law, plan, *(np.full(plan.shape, value) for value in (-1.0, 0.0, 1.0))]
        best, noise = self._searched(now, of_law, np.stack(kept, axis=2), noise)
        return best[0], law, np.concatenate([best[1:], best[-1:]]), noise

    def _searched(self, now: Now, mean: Array, kept: Array, noise: States) -> tuple[Array, States]:
        """Return the best plan (steps, lanes, d), from a mean and others that are tried first."""
        search, rows = self.search, np.arange(len(now.state))[:, None]
        spread = np.full(mean.shape, search.spread)
        for _ in range(search.rounds):
            steps, lanes, numbers = mean.shape
            drawn, noise = self.noise.drawn(noise, (steps, lanes, search.plans, numbers), axis=1)
            plans = mean[:, :, None] + spread[:, :, None] * drawn
            plans[:, :, : kept.shape[2]] = kept
            np.clip(plans, -self.most, self.most, out=plans)
            order = np.argsort(-self._worth(plans, now), axis=1, kind="stable")[:, : search.elite]
            kept = plans[:, rows, order]
            mean, spread = kept.mean(axis=2), np.maximum(kept.std(axis=2), search.least_spread)
        return kept[:, :, 0], noise

    def _own(self, memory: Memory, applied: Array) -> Array:
        """Return the interface's own states after the last step, in which so much was applied."""
        begun, own = memory["begun"], memory["own"]
        if not (begun.any() and self.model.own_rows):
            return own
        self.model.begin(memory["state"], own)
        self.model.advance(applied, memory["force"])
        return chosen(begun, self.model.own, own)

    def _plan_of_law(self, now: Now) -> Acted:
        """Return the law's plan, and its memory after the first step."""
        followed = Followed(self.law, now.law)
        self._rewards(now, followed, 1)
        return np.array(followed.actions), followed.memories[0]

    def _worth(self, plans: Array, now: Now) -> Array:
        """Return the sums of rewards (lanes, plans) of the plans."""
        actions = plans.reshape(len(plans), -1, self.columns)
        return self._rewards(now, lambda step, *_: actions[step], self.search.plans)

    def _rewards(self, now: Now, act: Callable[[int, Array, Array], Array], count: int) -> Array:
        """Return the sums of rewards (lanes, count) of what acts in so many copies of each lane."""
        begun = now.state, now.own, now.applied, now.asked
        state, own, applied, asked = (np.repeat(value, count, axis=0) for value in begun)
        self.model.begin(state, own)
        total, beyond = np.zeros(len(state)), np.zeros(len(state), np.bool_)
        for step, force in enumerate(np.repeat(now.forces, count, axis=1)):
            each = act(step, state, applied)
            total -= self.model.effort_weight * (each**2).sum(axis=1)
            applied, asked = self.actuators.reached(each, applied, asked)
            state, rewards = self.model.advance(applied, force)
            for limit, of in self.ends:
                beyond |= np.abs(state[:, :2] @ of) >= limit
            total += np.where(beyond, -ENDED, rewards)
        return total.reshape(-1, count)


class RolloutPredictiveControl(PredictiveControl):
    """Try a law with other numbers over a receding horizon, and act as the best of them.

    A plan is what the law does, so a few numbers make a long plan. They are searched anew in each
    control step, around the last ones; those of the law are always tried. Bertsekas, Tsitsiklis and
    Wu, *Rollout algorithms for combinatorial optimization*, J. Heuristics 3 (1997). Raise
    `DesignError` as `PredictiveControl` does.
    """

    law: Adjustable

    def __init__(self, scene: Scene, law: Adjustable, search: Search = ROLLOUTS) -> None:
        super().__init__(scene, law, search)
        self.shape, self.most = (1, len(law.free)), np.inf

    def _planned(self, now: Now, plan: Array, noise: States) -> tuple[Array, Memory, Array, States]:
        best, noise = self._searched(now, plan, np.stack([plan, np.zeros_like(plan)], 2), noise)
        action, law = self.law.at(best[0]).action(now.law, now.state, now.applied)
        return np.clip(action, -1.0, 1.0), law, best, noise

    def _worth(self, plans: Array, now: Now) -> Array:
        law, count = self.law.at(plans.reshape(-1, len(self.law.free))), self.search.plans
        memory = {name: np.repeat(array, count, axis=0) for name, array in now.law.items()}
        return self._rewards(now, Followed(law, memory), count)


def predictive_control(scene: Scene, law: Law) -> Feedback:
    """Return predictive control of the kind that suits a scene.

    Plans are what the law does with other numbers, where these can change in each step. Else they
    are improved by derivatives where a force acts, if actuators and control steps allow it, and
    elsewhere they are searched around the law.
    """
    if isinstance(law, Adjustable):
        return Feedback(scene, RolloutPredictiveControl(scene, law))
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
