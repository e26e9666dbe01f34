"""Predictive control whose plans are improved by Gauss-Newton steps on exact derivatives."""

from dataclasses import dataclass

import numpy as np

from agents.control.controller import Acted, Law, Memory, joined, part
from agents.control.trajectories import Trajectories
from agents.controllers.forecast import PushForecast
from agents.controllers.noise import Noise, States
from mm_gym import DesignError, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

SEED = 5_000_000

TOLERANCE = 1e-3
"""Of the motion that is foreseen, where an interface is followed by Runge-Kutta steps: plans are
made anew in each control step, and the motion by then differs from it by much more."""

NEAR = 0.3  # standard deviation of how far plans are from the last step's [-]; of random ones 1


@dataclass(frozen=True, kw_only=True)
class Steps:
    """How plans are improved at each control step."""

    horizon: int = 40  # control steps planned ahead
    rounds: int = 3  # gauss-Newton steps of each plan
    stiffness: float = 0.1  # what is added to the curvature over each control at first (Levenberg)
    near: int = 3  # plans around the last step's
    fresh: int = 2  # random plans


class NewtonPredictiveControl(Law):
    """Improve plans over a receding horizon by Gauss-Newton steps, and begin the best.

    The plans are the rest of the last step's, some around it and some drawn at random: each alone
    leads to a local optimum. The model has no excitation; what the disturbance adds to the motion
    is its conditional mean, see `PushForecast`. Plans stay within the limits at which an episode
    ends, where they can. Tassa, Erez and Todorov, *Synthesis and stabilization of complex behaviors
    through online trajectory optimization*, IROS 2012; the real time iteration of Diehl, Bock and
    Schlöder, SIAM J. Control Optim. 43 (2005). Raise `DesignError` if there is an own reward,
    accelerations of the carriage are weighed under excitation, an actuator has a lag and is
    commanded by its rate, or has a weight on its effort and a rate limit but is commanded by value.
    """

    def __init__(self, scene: Scene, steps: Steps | None = None) -> None:
        if scene.excitation and scene.objective.carriage_acceleration_weight > 0.0:
            msg = (
                "objective.carriage_acceleration_weight: allowed for plans by Gauss-Newton under "
                "excitation: 0; their model has what a disturbance does in a step, not its force"
            )
            raise DesignError(msg)
        self.steps = steps or Steps()
        self.name = f"predictive control, {self.steps.horizon} steps ahead"
        self.scene = scene.replace(excitation=[], randomization={}, initial={}, sensors={})
        self.forecast = PushForecast(scene)
        self.noise, self._problems = Noise(SEED), dict[int, Trajectories]()
        self._problem(1)  # refuses actuators that it cannot plan for

    def begin(self, lanes: int) -> Memory:
        problem = self._problem(lanes)
        return {
            **joined(forecast=self.forecast.begin(lanes)),
            "plan": np.zeros((lanes, self.steps.horizon, len(problem.actuators))),
            # The interface's own state, which nothing shows, is what the model makes of it.
            "own": np.zeros((lanes, len(problem.support.own_rows))),
            "noise": self.noise.begin(lanes),
        }

    def _problem(self, lanes: int) -> Trajectories:
        """Return the problem of so many lanes, whose start is written anew in each step."""
        if lanes not in self._problems:
            env = MovingMassVectorEnv(self.scene, lanes, autoreset_mode="Disabled")
            env.reset(seed=0)
            start = env.get_state()
            self._problems[lanes] = Trajectories(
                self.scene, env.plant, start, self.steps.horizon, tolerance=TOLERANCE
            )
        return self._problems[lanes]

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        steps, problem, count = self.steps, self._problem(len(state)), len(state)
        own_rows = problem.support.own_rows
        values = problem.start[0]
        values[:4], values[own_rows] = state.T, memory["own"].T
        for actuator, has in zip(problem.actuators, applied.T, strict=True):
            values[actuator.row] = values[actuator.asked_row] = has
        problem.pushes, forecast = self.forecast.ahead(
            part(memory, "forecast"), state, applied, steps.horizon
        )
        plan = np.moveaxis(memory["plan"], 0, 2)
        around, noise = self._drawn(memory["noise"], plan, steps.near)
        random, noise = self._drawn(noise, plan, steps.fresh)
        plans = np.concatenate([plan[None], plan + NEAR * around, random])
        plans = np.clip(plans, -1.0, 1.0)
        together = np.concatenate(list(plans), axis=2)
        episodes = np.tile(np.arange(count), len(plans))
        found = problem.improve(episodes, together, steps.rounds, steps.stiffness)
        best = found.cost.reshape(len(plans), count).argmin(axis=0) * count + np.arange(count)
        plan = np.concatenate([found.controls[1:, :, best], np.zeros_like(plan[:1])])
        return found.actions[0][:, best].T, {
            **joined(forecast=forecast),
            "plan": np.moveaxis(plan, 2, 0),
            "own": found.states[1, 4 : found.motion.shape[1], best],
            "noise": noise,
        }

    def _drawn(self, noise: States, plan: Array, plans: int) -> tuple[Array, States]:
        """Return noise (plans, steps, k, lanes), and the states of the generators then."""
        drawn, noise = self.noise.drawn(noise, (len(plan), plans, *plan.shape[1:]), axis=3)
        return np.moveaxis(drawn, 1, 0), noise
