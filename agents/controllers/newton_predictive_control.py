"""Predictive control whose plans are improved by Gauss-Newton steps on exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.cross_entropy import correlated
from agents.controllers.forecast import PushForecast
from agents.controllers.trajectories import Trajectories
from mm_gym import DesignError, MovingMassVectorEnv

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

SEED = 5_000_000


@dataclass(frozen=True, kw_only=True)
class Steps:
    """How plans are improved at each control step.

    Attributes
    ----------
    horizon
        Control steps planned ahead.
    rounds
        Gauss-Newton steps of each plan.
    stiffness
        What is added to the curvature over each control at first (Levenberg).
    near, near_spread
        Plans around the last step's, and the standard deviation of their distance [-].
    fresh, fresh_spread
        Random plans, and their standard deviation [-].
    """

    horizon: int = 40
    rounds: int = 3
    stiffness: float = 0.1
    near: int = 3
    near_spread: float = 0.3
    fresh: int = 2
    fresh_spread: float = 1.0


class NewtonPredictiveControl:
    """Improve plans over a receding horizon by Gauss-Newton steps, and begin the best.

    The plans are the rest of the last step's, some around it and some drawn at random: each alone
    leads to a local optimum. The model has no excitation; what the disturbance adds to the motion
    is its conditional mean, see `PushForecast`. Plans stay within the limits at which an episode
    ends, where they can. Tassa, Erez and Todorov, *Synthesis and
    stabilization of complex behaviors through online trajectory optimization*, IROS 2012; the real
    time iteration of Diehl, Bock and Schlöder, SIAM J. Control Optim. 43 (2005).

    Parameters
    ----------
    scene
        The scene that is controlled.
    steps
        How plans are improved.

    Raises
    ------
    DesignError
        If there is an own reward, accelerations of the carriage are weighed under excitation, an
        actuator has a lag and a rate limit, or has a weight on its effort and a rate limit but is
        commanded by value.
    """

    def __init__(self, scene: Scene, steps: Steps | None = None) -> None:
        if scene.excitation and scene.objective.carriage_acceleration_weight > 0.0:
            msg = (
                "objective.carriage_acceleration_weight: allowed for plans by Gauss-Newton under "
                "excitation: 0; their model knows what a disturbance does in a step, not its force"
            )
            raise DesignError(msg)
        self.steps = steps or Steps()
        self.name = f"predictive control, {self.steps.horizon} steps ahead"
        self.scene = scene.replace(excitation=[], randomization={}, initial={}, sensors={})
        self.forecast = PushForecast(scene)
        self._prepare(1)  # refuses actuators that it cannot plan for

    def begin(self, lanes: int) -> None:
        """Begin without a plan."""
        self.forecast.begin(lanes)
        self._prepare(lanes)
        self.plan: Values = np.zeros((self.steps.horizon, len(self.problem.actuators), lanes))
        # The interface's own state, which nothing shows, is what the model makes of it.
        self.own: Values = np.zeros((len(self.problem.support.own_rows), lanes))
        self.noise = np.random.default_rng(SEED)

    def _prepare(self, lanes: int) -> None:
        env = MovingMassVectorEnv(self.scene, lanes, autoreset_mode="Disabled")
        env.reset(seed=0)
        ahead = self.steps.horizon
        self.problem = Trajectories(self.scene, env.plant, env.get_state(), ahead)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the first action of the best plan."""
        steps, problem, count = self.steps, self.problem, len(state)
        values = problem.start[0]
        values[:4] = state.T
        values[self.problem.support.own_rows] = self.own
        for actuator, has in zip(problem.actuators, applied.T, strict=True):
            values[actuator.row] = values[actuator.asked_row] = has
        problem.pushes = self.forecast.ahead(state, applied, steps.horizon)
        near = self.plan + steps.near_spread * self._drawn(steps.near)
        fresh = steps.fresh_spread * self._drawn(steps.fresh)
        plans = np.clip(np.concatenate([self.plan[None], near, fresh]), -1.0, 1.0)
        together = np.concatenate(list(plans), axis=2)
        episodes = np.tile(np.arange(count), len(plans))
        found = problem.improve(episodes, together, steps.rounds, steps.stiffness)
        best = found.cost.reshape(len(plans), count).argmin(axis=0) * count + np.arange(count)
        self.plan = np.concatenate([found.controls[1:, :, best], np.zeros_like(self.plan[:1])])
        self.own = found.states[1, 4 : found.motion.shape[1], best].T
        return found.actions[0][:, best].T

    def _drawn(self, plans: int) -> Values:
        """Return noise (plans, steps, k, lanes) of unit variance, correlated from step to step."""
        steps, *rest = self.plan.shape
        return np.moveaxis(correlated(self.noise, (steps, plans, *rest)), 1, 0)
