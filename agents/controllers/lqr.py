"""The linear-quadratic regulator (LQR) of the sampled plant, checked after it is computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import control
import numpy as np

from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Values
    from mm_gym import Scene

STATES = ("x1", "x2", "v1", "v2")

UNREACHED = 1e-10
"""Singular value of a mode's pencil below which the force does not reach it.

It is well above the round-off of entries of order one, and far below a usable input.
"""

RESIDUAL, INDEFINITE = 1e-9, 1e-12
"""Bounds, relative to P, on the Riccati residual and on the size of a negative eigenvalue."""


@dataclass(frozen=True, eq=False)
class Design:
    """A regulator u = -gain @ state[states], with the cost-to-go state' P state.

    Attributes
    ----------
    states
        Indices of the states that the cost depends on and that it feeds back, out of x1, x2, v1,
        v2.
    gain
        (1, n) [N/m, N s/m].
    cost
        (n, n): P of the discrete Riccati equation; the sum of rewards from a state is
        -(x'P x - x'Q x).
    weight
        (n, n): Q, the reward's weight of the state.
    """

    states: tuple[int, ...]
    gain: NDArray[np.float64]
    cost: NDArray[np.float64]
    weight: NDArray[np.float64]


def design(scene: Scene, stretch: float | None = None) -> Design:
    """Solve the discrete Riccati equation for the scene's reward and its sampled linear plant.

    The plant is linearised about rest at a stretch, by default the one that an episode starts from.
    The states are those that the cost depends on: a sphere without springs drifts freely, its
    position is neither rewarded nor controllable, and Riccati solvers silently return garbage.

    Raises
    ------
    DesignError
        If there is no force, it is commanded by its rate or costs nothing, the motion has no
        weight or is not stabilisable, or the solution fails its checks: residual, definiteness,
        closed-loop eigenvalues.
    """
    price = np.array([[force_price(scene)]])
    plant = compile_scene(scene)
    weight = state_weight(scene)
    states = states_that_matter(plant.linear(stretch)[0], weight)
    a, b = plant.discrete(stretch)
    a, b, weight = a[np.ix_(states, states)], b[list(states)], weight[np.ix_(states, states)]
    _require_stabilisable(a, b, states)
    try:
        gain, cost, _ = control.dlqr(a, b, weight, price, method="scipy")
    except (np.linalg.LinAlgError, control.ControlArgument) as error:
        msg = f"the Riccati equation has no stabilising solution: {error}"
        raise DesignError(msg) from error
    solution = Design(states, np.asarray(gain), np.asarray(cost), weight)
    _check(solution, a, b, price)
    return solution


def force_price(scene: Scene) -> float:
    """Return the cost of the force [1/N^2].

    Raises
    ------
    DesignError
        If there is no force, it is commanded by its rate or costs nothing.
    """
    actuator, weight = scene.actuation.force, scene.objective.effort_weight
    if actuator is None:
        msg = (
            "actuation.force: missing; "
            "a regulator needs a force (a stretch does not enter the linear plant)"
        )
        raise DesignError(msg)
    if actuator.command == "rate":
        msg = "actuation.force.command: got 'rate'; allowed: 'position'"
        raise DesignError(msg)
    if weight == 0.0:
        msg = (
            "objective.effort_weight: got 0; "
            "allowed: greater than 0 (the Riccati equation needs a weight on the force)"
        )
        raise DesignError(msg)
    return weight / actuator.limit**2


def state_weight(scene: Scene) -> NDArray[np.float64]:
    """Return the (4, 4) weight of the state in the scene's reward.

    Raises
    ------
    DesignError
        If the motion has no weight.
    """
    objective = scene.objective
    stroke = objective.stroke_weight / objective.stroke_scale**2
    weight = np.zeros((4, 4))
    weight[0, 0] = objective.displacement_weight / objective.displacement_scale**2 + stroke
    weight[1, 1] = stroke
    weight[0, 1] = weight[1, 0] = -stroke
    weight[2, 2] = objective.velocity_weight / objective.velocity_scale**2
    if not weight.any():
        msg = (
            "objective: displacement_weight, velocity_weight and stroke_weight are 0; allowed: one "
            "greater than 0, for a motion to keep small"
        )
        raise DesignError(msg)
    return weight


def states_that_matter(a: NDArray[np.float64], weight: NDArray[np.float64]) -> tuple[int, ...]:
    """Return the states with a weight in the reward, and those that move one of them."""
    matters = weight.any(axis=0) | np.array([True, False, True, False])
    for _ in range(len(a)):
        matters = matters | a[matters].any(axis=0)
    return tuple(int(i) for i in np.flatnonzero(matters))


def _require_stabilisable(
    a: NDArray[np.float64], b: NDArray[np.float64], states: tuple[int, ...]
) -> None:
    """Apply the test of Popov, Belevitch and Hautus to every eigenvalue that does not decay."""
    names = ", ".join(STATES[i] for i in states)
    for eigenvalue in np.linalg.eigvals(a):
        if abs(eigenvalue) >= 1.0 - 1e-12:
            pencil = np.hstack([a - eigenvalue * np.eye(len(a)), b / max(np.abs(b).max(), 1e-300)])
            smallest = np.linalg.svd(pencil, compute_uv=False)[-1]
            if smallest < UNREACHED:
                msg = (
                    f"the states {names} are not stabilisable: "
                    f"the force does not reach the mode {eigenvalue:.6g}"
                )
                raise DesignError(msg)


def _check(
    solution: Design, a: NDArray[np.float64], b: NDArray[np.float64], price: NDArray[np.float64]
) -> None:
    p, gain = solution.cost, solution.gain
    closed = a - b @ gain
    residual = closed.T @ p @ closed + gain.T @ price @ gain + solution.weight - p
    relative = np.abs(residual).max() / np.abs(p).max()
    if not relative < RESIDUAL:
        msg = f"the Riccati residual is {relative:.1e} of P; allowed: below {RESIDUAL}"
        raise DesignError(msg)
    least = np.linalg.eigvalsh(p).min() / np.abs(p).max()
    if not least > -INDEFINITE:
        msg = (
            "P is not positive semidefinite: "
            f"its least eigenvalue is {least:.1e} of its largest entry"
        )
        raise DesignError(msg)
    radius = np.abs(np.linalg.eigvals(closed)).max()
    if not radius < 1.0:
        msg = f"the closed loop is not stable: its spectral radius is {radius:.12f}"
        raise DesignError(msg)


class LQR:
    """Feed the state back through the optimal gain."""

    name = "LQR"

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        self.design = design(scene, stretch)
        assert scene.actuation.force is not None  # noqa: S101 - design refuses otherwise
        self.limit = scene.actuation.force.limit

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return -gain @ state over the force limit."""
        return state[:, self.design.states] @ (-self.design.gain.T / self.limit)
