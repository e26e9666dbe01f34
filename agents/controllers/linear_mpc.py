"""Linear model predictive control (MPC): the LQR's problem with the limits of the force."""

from importlib import import_module
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from scipy.sparse import csc_matrix

from agents.controllers.actuators import Command
from agents.controllers.controller import Acted, Law, Memory, Values
from agents.controllers.feedback import Feedback
from agents.controllers.lqr import design, problem_of
from agents.controllers.registry import Entry, without_weight
from mm_gym import DesignError, Scene

MOST_STEPS = 1000  # longest horizon; the matrices have the square of its size
RHO = 0.1  # step size with which the solver begins

SETTINGS = {"rho": RHO, "verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 4000}


class LinearMPC(Law):
    """Minimise the reward's quadratic cost over a horizon, within the force's limit and rate limit.

    The forces of the horizon are the unknowns of a quadratic program, solved at each step; the
    first is applied. Behind the horizon stands the LQR's cost to go, where there is one. Rawlings,
    Mayne and Diehl, *Model Predictive Control*, 2nd ed. (2017), chapter 1; Stellato et al., *OSQP:
    an operator splitting solver for quadratic programs*, Math. Prog. Comp. 12 (2020). Raise
    `DesignError` if there is no force, it is commanded by its rate or costs nothing, the motion has
    no weight, or the horizon is not allowed; `gymnasium.error.DependencyNotInstalled` without OSQP
    (extra: mpc).
    """

    def __init__(self, scene: Scene, horizon: int = 30) -> None:
        if not (isinstance(horizon, int) and 1 <= horizon <= MOST_STEPS):
            msg = f"horizon: got {horizon!r}; allowed: 1 to {MOST_STEPS} control steps"
            raise DesignError(msg)
        self.states, a, b, cost = problem_of(scene)
        command = Command(scene, "force")
        self.name, self.limit = f"linear MPC, {horizon} steps ahead", command.high
        free, forced = _predicted(a, b * self.limit, horizon)
        weights = np.stack([cost.state] * (horizon - 1) + [cost.state + _cost_to_go(scene, len(a))])
        both = np.einsum("kin,kij,kjm->nm", forced, weights, forced)
        self.slope = np.einsum("kin,kij,kjm->nm", forced, weights, free)
        self.travel = command.travel / self.limit
        self.hessian = both + cost.force * self.limit**2 * np.eye(horizon)
        across = self.limit * np.einsum("i,kin->kn", cost.cross[:, 0], forced)
        self.hessian += across + across.T
        self.slope += self.limit * np.einsum("i,kij->kj", cost.cross[:, 0], free)
        self.solver = _solver(self.hessian, self.travel)

    def begin(self, lanes: int) -> Memory:
        size = len(self.slope)
        return {"plan": np.zeros((lanes, size)), "dual": np.zeros((lanes, 2 * size))}

    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
        size = len(self.slope)
        slopes = state[:, self.states] @ self.slope.T
        low = np.concatenate([-np.ones(size), -np.full(size, self.travel)])
        plans, duals = memory["plan"].copy(), memory["dual"].copy()
        for lane, slope in enumerate(slopes):
            first = applied[lane, 0] / self.limit
            bounds = low.copy(), -low
            for bound in bounds:
                bound[size] += first  # the first move is from what is applied
            self.solver.update(q=slope, l=bounds[0], u=bounds[1])
            x = np.append(plans[lane, 1:], plans[lane, -1])
            self.solver.warm_start(x=x, y=duals[lane])
            self.solver.update_settings(rho=RHO)  # else it adapts to the lanes before
            found = self.solver.solve(raise_error=False)
            plans[lane], duals[lane] = found.x, found.y
        return plans[:, :1].copy(), {"plan": plans, "dual": duals}


def _predicted(a: Values, b: Values, horizon: int) -> tuple[Values, Values]:
    """Return the states of the steps to come: (k, n, n) times the state, (k, n, k) the forces."""
    size = len(a)
    free, forced = np.empty((horizon, size, size)), np.zeros((horizon, size, horizon))
    power = np.eye(size)
    for step in range(horizon):
        for later in range(step, horizon):
            forced[later, :, later - step] = (power @ b)[:, 0]
        power = a @ power
        free[step] = power
    return free, forced


def _cost_to_go(scene: Scene, size: int) -> Values:
    """Return P of the LQR behind the horizon; zero where there is none."""
    try:
        found = design(scene)
    except DesignError:
        return np.zeros((size, size))
    return found.cost - found.weight


def _solver(hessian: Values, travel: float) -> Any:  # noqa: ANN401 - of an optional package
    try:
        osqp = import_module("osqp")
    except ImportError as error:
        msg = "linear MPC needs OSQP; install the extra `mpc`"
        raise DependencyNotInstalled(msg) from error
    count = len(hessian)
    moves = np.eye(count) - np.eye(count, k=-1)
    limits = np.vstack([np.eye(count), moves])
    bound = np.concatenate([np.ones(count), np.full(count, travel)])
    solver = osqp.OSQP()
    upper = csc_matrix(np.triu(hessian))
    solver.setup(upper, np.zeros(count), csc_matrix(limits), -bound, bound, **SETTINGS)
    return solver


ENTRIES = (
    Entry(
        "linear-mpc",
        ("force",),
        lambda scene: Feedback(scene, LinearMPC(scene)),
        52,
        "further",
        "linear MPC",
        refuses=without_weight,
        told=True,
    ),
)
