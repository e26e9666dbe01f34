"""The quadratic program of linear predictive control: a horizon of forces within limits."""

from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, toeplitz
from scipy.sparse import csc_matrix

from agents.control.actuators import Command
from agents.control.controller import Acted, Memory
from agents.controllers.lqr import Quadratic
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.extras import optional

RHO = 0.1  # step size with which OSQP begins

ROUNDS, AT_ONCE = 60, 3
"""Rounds of a search for the limits that matter, and those of them that change all at once."""

BEYOND, ROUND_OFF = 2, 1e-9  # the side of what is beyond a soft limit; see `Program`
TOGETHER = 32  # lanes whose programs are of one size, that of the one with most limits

SETTINGS = {"rho": RHO, "verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 4000}


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
    horizon
        Control steps.
    penalty
        Of going beyond a limit, see `linear_mpc.Limits`.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        Without OSQP (extra: mpc).
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
        penalty: float,
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


def _solver(hessian: Array, hard: Array, moved: Array) -> Any:  # noqa: ANN401 - of an optional package
    """Return the program of forces and slacks.

    `hard` is what forces do to what is limited for good, and `moved` to what has a slack.
    """
    osqp = optional("osqp", "linear MPC needs OSQP; install the extra `mpc`")
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
