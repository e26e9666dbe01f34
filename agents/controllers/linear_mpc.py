"""Linear model predictive control (MPC): the LQR's problem with the limits of the force."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from scipy.sparse import csc_matrix

from agents.controllers.lqr import design, quadratic_cost, states_that_matter
from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

MOST_STEPS = 1000
"""Longest horizon; the matrices have the square of its size."""

SETTINGS = {"verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 4000}


class LinearMPC:
    """Minimise the reward's quadratic cost over a horizon, within the force's limit and rate limit.

    The forces of the horizon are the unknowns of a quadratic program, solved at each step; the
    first is applied. Behind the horizon stands the LQR's cost to go, where there is one. Rawlings,
    Mayne and Diehl, *Model Predictive Control*, 2nd ed. (2017), chapter 1; Stellato et al., *OSQP:
    an operator splitting solver for quadratic programs*, Math. Prog. Comp. 12 (2020).

    Parameters
    ----------
    scene
        A scene with a force; it is linear about rest, with the middle of each range.
    horizon
        Control steps.

    Raises
    ------
    DesignError
        If there is no force, it is commanded by its rate or costs nothing, the motion has no
        weight, or the horizon is not allowed.
    gymnasium.error.DependencyNotInstalled
        Without OSQP (extra: mpc).
    """

    def __init__(self, scene: Scene, horizon: int = 30) -> None:
        if not (isinstance(horizon, int) and 1 <= horizon <= MOST_STEPS):
            msg = f"horizon: got {horizon!r}; allowed: 1 to {MOST_STEPS} control steps"
            raise DesignError(msg)
        cost = quadratic_cost(scene)
        actuator = scene.actuation.force
        assert actuator is not None  # noqa: S101 - `quadratic_cost` refuses otherwise
        self.name, self.limit = f"linear MPC, {horizon} steps ahead", actuator.limit
        plant = compile_scene(scene)
        self.states = states_that_matter(plant.linear()[0], cost.state)
        a, b = plant.discrete()
        rows = np.ix_(self.states, self.states)
        a, b, cost = a[rows], b[list(self.states), :1] * self.limit, cost.of(self.states)
        free, forced = _predicted(a, b, horizon)
        weights = np.stack([cost.state] * (horizon - 1) + [cost.state + _cost_to_go(scene, len(a))])
        both = np.einsum("kin,kij,kjm->nm", forced, weights, forced)
        self.slope = np.einsum("kin,kij,kjm->nm", forced, weights, free)
        most = np.inf if actuator.rate_limit is None else actuator.rate_limit / self.limit
        self.travel = most * scene.control.time_step
        self.hessian = both + cost.force * self.limit**2 * np.eye(horizon)
        across = self.limit * np.einsum("i,kin->kn", cost.cross[:, 0], forced)
        self.hessian += across + across.T
        self.slope += self.limit * np.einsum("i,kij->kj", cost.cross[:, 0], free)
        self.begin(0)  # or tell at once that there is no solver

    def begin(self, lanes: int) -> None:
        """Begin without plans, and with a solver that remembers no other episodes."""
        self.solver = _solver(self.hessian, self.travel)
        self.plans = np.zeros((lanes, len(self.slope)))

    def action(self, state: Values, applied: Values) -> Values:
        """Return the first force of each plan over the limit."""
        slopes = state[:, self.states] @ self.slope.T
        low = np.concatenate([-np.ones(len(self.slope)), -np.full(len(self.slope), self.travel)])
        for lane, slope in enumerate(slopes):
            first = applied[lane, 0] / self.limit
            bounds = low.copy(), -low
            for bound in bounds:
                bound[len(slope)] += first  # the first move is from what is applied
            self.solver.update(q=slope, l=bounds[0], u=bounds[1])
            self.solver.warm_start(x=np.append(self.plans[lane, 1:], self.plans[lane, -1]))
            self.plans[lane] = self.solver.solve(raise_error=False).x
        return self.plans[:, :1].copy()


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
        msg = 'linear MPC needs OSQP; install it with: pip install "mm-gym[mpc]"'
        raise DependencyNotInstalled(msg) from error
    count = len(hessian)
    moves = np.eye(count) - np.eye(count, k=-1)
    limits = np.vstack([np.eye(count), moves])
    bound = np.concatenate([np.ones(count), np.full(count, travel)])
    solver = osqp.OSQP()
    upper = csc_matrix(np.triu(hessian))
    solver.setup(upper, np.zeros(count), csc_matrix(limits), -bound, bound, **SETTINGS)
    return solver
