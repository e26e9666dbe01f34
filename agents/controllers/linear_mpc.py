"""Linear model predictive control (MPC): the LQR's problem with limits of force and motion."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from importlib import import_module
from math import inf
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from scipy.linalg import block_diag, toeplitz
from scipy.sparse import csc_matrix

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import force_weight, nominal, plant_of, require_number
from agents.control.trajectories import ends_of
from agents.controllers.lqr import Quadratic, design, problem_of
from agents.controllers.registry import Entry, regulator_entry, unless, without_weight
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array
from mm_gym.errors import refuse

HORIZON = 30  # control steps that are planned, by default
MOST_STEPS = 1000  # longest horizon; the matrices have the square of its size
RHO = 0.1  # step size with which the solver begins

KEPT, PENALTY = 0.9, 10.0
"""Of the limits at which episodes end, and of going beyond; see `Limits`.

They are the best tried on ActiveMassDamper's validation episodes: of 1, 0.9, ..., 0.65 of the rail,
and penalties of 1 to 1000. The rest of the rail is for disturbances, which the plan does not know.
"""

SETTINGS = {"rho": RHO, "verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 4000}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits that plans keep at the end of every step, as far as the force can.

    They are soft, so that there always is a plan: a step beyond a limit by a fraction e of it costs
    penalty (e + e^2). Of a large penalty the part that is proportional to e keeps plans within a
    limit that they can keep, and does not only bring them near.
    """

    displacement: float | None = None  # of |x1| [m]
    stroke: float | None = None  # of |x2 - x1| [m]
    coupling_force: float | None = None  # of the force between the masses, as in the reward [N]
    penalty: float = PENALTY  # [-], over a reward

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            absent = value is None and field.name != "penalty"
            if not (absent or (number and 0.0 < value < inf)):
                refuse(field.name, f"{value!r}", "a finite number greater than 0", DesignError)

    @classmethod
    def of(cls, scene: Scene, kept: float = KEPT) -> "Limits":
        """Return limits at a fraction of those at which the scene's episodes end."""
        require_number("kept", kept, high=1.0)
        stated = scene.objective.displacement_limit, scene.objective.rail_half_length
        displacement, stroke = (None if value is None else kept * value for value in stated)
        return cls(displacement=displacement, stroke=stroke)

    def rows(self, scene: Scene) -> Array:
        """Return what is limited over its limit (q, 5), by x1, x2, v1, v2 and the force [N]."""
        a, b = plant_of(scene).linear()
        coupling = nominal(scene, "sphere.mass") * np.append(a[3], b[3, 0])
        quantities = {
            "displacement": np.array([1.0, 0.0, 0.0, 0.0, 0.0]),
            "stroke": np.array([-1.0, 1.0, 0.0, 0.0, 0.0]),
            "coupling_force": coupling,
        }
        limits = {name: getattr(self, name) for name in quantities}
        found = [row / limits[name] for name, row in quantities.items() if limits[name] is not None]
        return np.array(found).reshape(-1, 5)


class Program:
    """The quadratic program of the forces of a horizon, of which the first is applied.

    Kerrigan and Maciejowski, *Soft constraints and exact penalty functions in model predictive
    control*, UKACC Control Conf. (2000); Stellato et al., *OSQP: an operator splitting solver for
    quadratic programs*, Math. Prog. Comp. 12 (2020).

    Parameters
    ----------
    a, b, cost
        Of a step of the states that are planned; the cost is of the state at its end and of the
        force that is commanded in it.
    last
        (n, n): weight of the state at the horizon's end.
    rows
        (q, n + 1): what is limited, over its limit, by the state and the commanded force [N].
    share
        Of the way to its command, that a force goes in a step within its travel.
    """

    def __init__(
        self,
        scene: Scene,
        a: Array,
        b: Array,
        cost: Quadratic,
        *,
        last: Array,
        rows: Array,
        share: float,
        horizon: int,
        penalty: float = PENALTY,
    ) -> None:
        command = Command(scene, "force")
        self.limit, self.horizon = command.high, horizon
        self.travel = command.travel / self.limit / share
        self.left = (1.0 - share) ** np.arange(horizon)  # of what is applied now, before each step
        ways = np.eye(horizon) - np.tril(toeplitz([0.0, *share * self.left[:-1]]))
        free, forced = _predicted(a, b * self.limit, horizon)
        weights = np.stack([cost.state] * (horizon - 1) + [last])
        both = np.einsum("kin,kij,kjm->nm", forced, weights, forced)
        slope = np.einsum("kin,kij,kjm->nm", forced, weights, free)
        hessian = both + cost.force * self.limit**2 * np.eye(horizon)
        across = self.limit * np.einsum("i,kin->kn", cost.cross[:, 0], forced)
        hessian += across + across.T
        slope += self.limit * np.einsum("i,kij->kj", cost.cross[:, 0], free)
        # Each limited quantity of each step has a slack, in units of its limit.
        size = len(rows) * horizon
        self.slope, self.penalties = slope, np.full(size, 0.5 * penalty)
        self.free = np.einsum("qi,kij->qkj", rows[:, :-1], free).reshape(size, len(a))
        moved = np.einsum("qi,kin->qkn", rows[:, :-1], forced)
        moved += self.limit * rows[:, -1, None, None] * np.eye(horizon)
        self.solver = _solver(
            block_diag(hessian, penalty * np.eye(size)),
            ways,
            moved.reshape(size, horizon),
            self._bounds(np.zeros(size)),
        )

    def begin(self, lanes: int) -> Memory:
        slacks = len(self.penalties)
        return {
            "plan": np.zeros((lanes, self.horizon + slacks)),
            "dual": np.zeros((lanes, 2 * self.horizon + 3 * slacks)),
        }

    def first(self, memory: Memory, state: Array, applied: Array) -> Acted:
        """Return the first forces (lanes, 1) over their limit, from what is applied (lanes,)."""
        slopes, drifts = state @ self.slope.T, state @ self.free.T
        plans, duals = memory["plan"].copy(), memory["dual"].copy()
        for lane, (slope, drift) in enumerate(zip(slopes, drifts, strict=True)):
            low, high = self._bounds(drift, applied[lane] / self.limit)
            self.solver.update(q=np.concatenate([slope, self.penalties]), l=low, u=high)
            blocks = plans[lane].reshape(-1, self.horizon)
            x = np.concatenate([blocks[:, 1:], blocks[:, -1:]], axis=1).ravel()
            self.solver.warm_start(x=x, y=duals[lane])
            self.solver.update_settings(rho=RHO)  # else it adapts to the lanes before
            found = self.solver.solve(raise_error=False)
            plans[lane], duals[lane] = found.x, found.y
        return plans[:, :1].copy(), {"plan": plans, "dual": duals}

    def _bounds(self, drift: Array, first: float = 0.0) -> tuple[Array, Array]:
        """Return the program's bounds, of what is limited without forces, and what is applied."""
        size, zero = self.horizon, np.zeros(len(drift))
        high = np.concatenate([np.ones(size), np.full(size, self.travel)])
        low = np.concatenate([-high, zero - inf, -1.0 - drift, zero])
        high = np.concatenate([high, 1.0 - drift, zero + inf, zero + inf])
        for bound in (low, high):
            bound[size : 2 * size] += self.left * first
        return low, high


class LinearMPC(Law):
    """Minimise the reward's quadratic cost over a horizon, within the force's limit and rate limit.

    The forces of the horizon are the unknowns of a quadratic program, solved at each step; the
    first is applied. Limits of the motion, by default none, add a slack for each step. Behind the
    horizon stands the LQR's cost to go, where there is one. Rawlings, Mayne and Diehl, *Model
    Predictive Control*, 2nd ed. (2017), chapter 1. Raise `DesignError` if there is no force, it is
    commanded by its rate or costs nothing, the motion has no weight, or the horizon is not allowed;
    `gymnasium.error.DependencyNotInstalled` without OSQP (extra: mpc).

    Parameters
    ----------
    horizon
        Control steps that are planned.
    limits
        Of the motion.
    """

    def __init__(self, scene: Scene, horizon: int = HORIZON, limits: Limits | None = None) -> None:
        if not (isinstance(horizon, int) and 1 <= horizon <= MOST_STEPS):
            refuse("horizon", f"{horizon!r}", f"1 to {MOST_STEPS} control steps", DesignError)
        force_weight(scene)
        limits = limits or Limits()
        rows = limits.rows(scene)
        self.states, a, b, cost = problem_of(scene, also=rows[:, :4])
        self.name = f"linear MPC, {horizon} steps ahead"
        if len(rows):
            self.name += ", within limits"
        self.program = Program(
            scene,
            a,
            b,
            cost,
            last=cost.state + _cost_to_go(scene, self.states),
            rows=np.column_stack([rows[:, self.states], rows[:, 4]]),
            share=1.0,
            horizon=horizon,
            penalty=limits.penalty,
        )
        self.begin = self.program.begin

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return self.program.first(memory, state[:, self.states], applied[:, 0])


def _predicted(a: Array, b: Array, horizon: int) -> tuple[Array, Array]:
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


def _cost_to_go(scene: Scene, states: Sequence[int]) -> Array:
    """Return P of the LQR behind the horizon, of these states; zero where there is none."""
    whole = np.zeros((4, 4))
    with suppress(DesignError):
        found = design(scene)
        whole[np.ix_(found.states, found.states)] = found.cost - found.weight
    return whole[np.ix_(states, states)]


def _solver(hessian: Array, ways: Array, moved: Array, bounds: tuple[Array, Array]) -> Any:  # noqa: ANN401 - of an optional package
    """Return the program of forces and slacks.

    `ways` is what forces do to the way that is left to each command, and `moved` what they do to
    what is limited.
    """
    try:
        osqp = import_module("osqp")
    except ImportError as error:
        msg = "linear MPC needs OSQP; install the extra `mpc`"
        raise DependencyNotInstalled(msg) from error
    slacks, count = moved.shape
    one, none = np.eye(slacks), np.zeros((count, slacks))
    limits = np.block(
        [
            [np.eye(count), none],
            [ways, none],
            [moved, -one],
            [moved, one],
            [none.T, one],
        ]
    )
    solver, upper = osqp.OSQP(), csc_matrix(np.triu(hessian))
    solver.setup(upper, np.zeros(len(hessian)), csc_matrix(limits), *bounds, **SETTINGS)
    return solver


_without_limits = unless(
    lambda scene: bool(ends_of(scene.objective)),
    "which keeps limits; objective.displacement_limit and objective.rail_half_length: missing",
)

ENTRIES = (
    regulator_entry("linear-mpc", ("force",), LinearMPC, 52, "further", label="linear MPC"),
    Entry(
        "constrained-mpc",
        ("force",),
        lambda scene: LinearMPC(scene, limits=Limits.of(scene)),
        52,
        "further",
        refuses=lambda scene: _without_limits(scene) or without_weight(scene),
    ),
)
