"""Linear model predictive control (MPC): the LQR's problem with limits of force and motion."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from importlib import import_module
from math import inf
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
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
RHO = 0.1  # step size with which OSQP begins

ROUNDS, AT_ONCE = 60, 3
"""Rounds of a search for the limits that matter, and those of them that change all at once."""

BEYOND, ROUND_OFF = 2, 1e-9  # the side of what is beyond a soft limit; see `Program`
TOGETHER = 32  # lanes whose programs are of one size, that of the one with most limits

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

    The limits that matter are found by the primal-dual active set, in all lanes together and to
    round-off; the last step's begin it. Where it finds none, which is rare, OSQP solves the lane.
    Hintermüller, Ito and Kunisch, *The primal-dual active set strategy as a semismooth Newton
    method*, SIAM J. Optim. 13 (2002); Kerrigan and Maciejowski, *Soft constraints and exact penalty
    functions in model predictive control*, UKACC Control Conf. (2000); Stellato et al., *OSQP: an
    operator splitting solver for quadratic programs*, Math. Prog. Comp. 12 (2020).

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
        self.slope, self.penalty, self.slacks = slope, penalty, size
        self.free = np.einsum("qi,kij->qkj", rows[:, :-1], free).reshape(size, len(a))
        moved = np.einsum("qi,kin->qkn", rows[:, :-1], forced)
        moved += self.limit * rows[:, -1, None, None] * np.eye(horizon)
        moved = moved.reshape(size, horizon)
        self.is_rated = bool(np.isfinite(self.travel))
        hard = np.vstack([np.eye(horizon), ways]) if self.is_rated else np.eye(horizon)
        self.limits = np.vstack([hard, moved])
        self.inverse = np.linalg.inv(hessian)
        self.pulled = self.limits @ self.inverse
        self.across = self.pulled @ self.limits.T
        self.solver = _solver(block_diag(hessian, penalty * np.eye(size)), hard, moved)

    def begin(self, lanes: int) -> Memory:
        return {
            "plan": np.zeros((lanes, self.horizon + self.slacks)),
            "sides": np.zeros((lanes, len(self.limits)), np.int8),
        }

    def first(self, memory: Memory, state: Array, applied: Array) -> Acted:
        """Return the first forces (lanes, 1) over their limit, from what is applied (lanes,)."""
        slope, drift = state @ self.slope.T, state @ self.free.T
        held = np.outer(applied / self.limit, self.left)
        zero = np.zeros_like(held)
        bounds = np.stack(
            [
                np.hstack([zero + end, *[held + end * self.travel] * self.is_rated, end - drift])
                for end in (-1.0, 1.0)
            ]
        )
        # The limits that the last step's plan was at, a step later.
        sides = memory["sides"].reshape(len(state), -1, self.horizon)
        sides = np.concatenate([sides[:, :, 1:], sides[:, :, -1:]], axis=2)
        sides = sides.reshape(len(state), -1)
        forces, sides, is_best = self._planned(-slope @ self.inverse, bounds, sides)
        for lane in np.flatnonzero(~is_best):
            forces[lane] = self._solved(slope[lane], *bounds[:, lane])
            sides[lane] = 0
        forces = np.clip(forces, -1.0, 1.0)
        beyond = np.abs(forces @ self.limits[len(self.limits) - self.slacks :].T + drift) - 1.0
        plan = np.hstack([forces, np.maximum(beyond, 0.0)])
        return plan[:, :1].copy(), {"plan": plan, "sides": sides}

    def _planned(
        self, start: Array, bounds: Array, sides: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return plans from those without limits, the limits' sides, and which plans are the best.

        Bounds (2, lanes, rows) are the low and the high ones. A side is -1 or 1 of a limit that the
        plan is at, -2 or 2 of one that it goes beyond, and else 0. With the sides the plan is
        linear. It tells the next sides: where a limit does not hold it, or where it goes beyond
        one. The plan that tells its own sides is the best one.
        """
        reached, pulls, sides = start @ self.limits.T, np.zeros(sides.shape), sides.copy()
        left = np.arange(len(start))
        for done in range(ROUNDS):
            side, ends = sides[left], bounds[:, left]
            pull = self._pulls(reached[left], ends, side)
            after = reached[left] - pull @ self.across
            goes = (side != 0) & (pull * side <= 0.0)
            over = np.where(side == 0, np.maximum(ends[0] - after, after - ends[1]), 0.0)
            comes = over > ROUND_OFF
            if done >= AT_ONCE:
                goes, comes = _largest(goes, np.abs(pull)), _largest(comes, over)
            soft = np.arange(sides.shape[1]) >= sides.shape[1] - self.slacks
            size = np.where(soft & (np.abs(pull) > 0.5 * self.penalty), BEYOND, 1)
            told = np.where(goes, 0, np.sign(side) * size)
            told = np.where(comes, np.where(after > ends[1], 1, -1), told)
            sides[left], pulls[left] = told, pull
            left = left[(told != side).any(axis=1)]
            if not left.size:
                break
        is_best = np.ones(len(start), np.bool_)
        is_best[left] = False
        return start - pulls @ self.pulled, sides, is_best

    def _pulls(self, reached: Array, bounds: Array, sides: Array) -> Array:
        """Return the multipliers (lanes, rows) of limits with which the plan is at their sides."""
        active, is_beyond = sides != 0, np.abs(sides) == BEYOND
        off = np.where(sides > 0, bounds[1], bounds[0]) - 0.5 * np.sign(sides) * is_beyond
        off = np.where(active, reached - off, 0.0)
        tiny = ROUND_OFF * self.across.diagonal().max()  # limits may be the same
        own = np.where(active, np.where(is_beyond, 1.0 / self.penalty, tiny), 1.0)
        order, counts = np.argsort(~active, axis=1, kind="stable"), active.sum(axis=1)
        pulls, by_count = np.zeros(sides.shape), np.argsort(counts, kind="stable")
        for lanes in np.array_split(by_count, -(-len(counts) // TOGETHER)):
            size = counts[lanes].max()
            at = lanes[:, None], order[lanes, :size]
            matrix = self.across[at[1][:, :, None], at[1][:, None, :]]
            matrix *= active[at][:, :, None] & active[at][:, None, :]
            matrix[:, np.arange(size), np.arange(size)] += own[at]
            pulls[at] = np.linalg.solve(matrix, off[at][:, :, None])[:, :, 0]
        return pulls

    def _solved(self, slope: Array, low: Array, high: Array) -> Array:
        """Return the plan (horizon,) of a lane by OSQP, which stops at a small residual."""
        hard, count = len(self.limits) - self.slacks, self.slacks
        zero = np.zeros(count)
        self.solver.update(
            q=np.concatenate([slope, np.full(count, 0.5 * self.penalty)]),
            l=np.concatenate([low[:hard], zero - inf, low[hard:], zero]),
            u=np.concatenate([high[:hard], high[hard:], zero + inf, zero + inf]),
        )
        still = np.zeros(self.horizon + count), np.zeros(hard + 3 * count)
        self.solver.warm_start(*still)  # else it begins as the lanes before ended
        self.solver.update_settings(rho=RHO)
        return self.solver.solve(raise_error=False).x[: self.horizon]


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


def _largest(which: NDArray[np.bool_], size: Array) -> NDArray[np.bool_]:
    """Return the one of largest size in each row, of those that are told."""
    most = np.where(which, size, -1.0).argmax(axis=1)[:, None]
    return which & (np.arange(which.shape[1]) == most)


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


def _solver(hessian: Array, hard: Array, moved: Array) -> Any:  # noqa: ANN401 - of an optional package
    """Return the program of forces and slacks.

    `hard` is what forces do to what is limited for good, and `moved` to what has a slack.
    """
    try:
        osqp = import_module("osqp")
    except ImportError as error:
        msg = "linear MPC needs OSQP; install the extra `mpc`"
        raise DependencyNotInstalled(msg) from error
    slacks, one = len(moved), np.eye(len(moved))
    limits = np.block(
        [
            [hard, np.zeros((len(hard), slacks))],
            [moved, -one],
            [moved, one],
            [np.zeros((slacks, hard.shape[1])), one],
        ]
    )
    solver, upper, wide = osqp.OSQP(), csc_matrix(np.triu(hessian)), np.full(len(limits), inf)
    solver.setup(upper, np.zeros(len(hessian)), csc_matrix(limits), -wide, wide, **SETTINGS)
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
