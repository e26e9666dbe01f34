"""The linear-quadratic regulator (LQR) of the sampled plant, checked after it is computed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import control
import numpy as np

from agents.control.actuators import Actuators, Command
from agents.control.controller import Acted, Law, Memory
from agents.control.feedback import Both, Feedback
from agents.control.kalman_filter import hidden_mode, solvable, told_by
from agents.control.model import state_scales
from agents.control.scene import STATES, drawn_but, force_weight, nominal, plant_of
from agents.controllers.constant import Held
from agents.controllers.registry import Entry, regulator_entry, without_weight
from agents.controllers.searched import grid, searched
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

FED_BACK = (*STATES, "force")  # the last is what is applied [N], a state where it has a lag

RESIDUAL, INDEFINITE = 1e-9, 1e-12
"""Bounds, relative to P, on the Riccati residual and on the size of a negative eigenvalue."""


@dataclass(frozen=True, eq=False)
class Design:
    """A regulator u = -gain @ state[states], with the cost-to-go state' P state."""

    # Indices of the states that the cost depends on and that it feeds back, out of `FED_BACK`.
    states: tuple[int, ...]
    gain: Array  # (1, n) [N/m, N s/m]
    # (n, n): P of the discrete Riccati equation; the sum of rewards from a state is -(x'P x - x'Q
    # x).
    cost: Array
    weight: Array  # (n, n): Q, the reward's weight of the state


def design(scene: Scene, stretch: float | None = None) -> Design:
    """Solve the discrete Riccati equation for the scene's reward and its sampled linear plant.

    Accelerations at a step's end are linear in state and force, which gives the cost cross terms.

    The plant is linearised about rest at a stretch, by default the one that an episode starts from.
    The states are those that the cost depends on: a sphere without springs drifts freely, its
    position is neither rewarded nor controllable, and Riccati solvers silently return garbage.
    Raise `DesignError` if there is no force, it is commanded by its rate or costs nothing, the
    motion has no weight or is not stabilisable, or the solution fails its checks: residual,
    definiteness, closed-loop eigenvalues.
    """
    return solved(scene, problem_of(scene, stretch))


def solved(scene: Scene, problem: Problem) -> Design:
    """Solve the discrete Riccati equation of a scene's problem, in units of the objective's scales.

    In SI units an equation of fast or heavy masses has too few digits. Raise `DesignError` as
    `design` does.
    """
    states, limit = problem.states, Command(scene, "force").high
    x = np.append(state_scales(scene), limit)[list(states)]
    a, b = problem.a * x / x[:, None], problem.b * limit / x[:, None]
    cost = problem.cost.in_units(x, limit)
    unreached = hidden_mode(a.T, b.T)
    if unreached is not None:
        msg = (
            f"the states {', '.join(FED_BACK[i] for i in states)} are not stabilisable: "
            f"the force does not reach the mode {unreached:.6g}"
        )
        raise DesignError(msg)
    stage = cost.ahead(a, b) if cost.cross.any() else cost
    with solvable("the Riccati equation"):
        gain, riccati, _ = control.dlqr(a, b, *stage.weights, method="scipy")
    gain, riccati = np.asarray(gain), np.asarray(riccati)
    _check(gain, riccati, a, b, stage)
    if stage is not cost:
        riccati = riccati + cost.state
    return Design(states, gain * limit / x, riccati / np.outer(x, x), problem.cost.state)


class Quadratic(NamedTuple):
    """A cost x'Q x + 2 x'N u + u'R u of states x and a force u [N]."""

    # state, cross, force: Q (n, n), N (n, 1) and R (1, 1).
    state: Array
    cross: Array
    force: Array

    @property
    def weights(self) -> tuple[Array, ...]:
        """Q and R, and N if it is not zero: SciPy rounds otherwise where it is given."""
        both = self.state, self.force
        return (*both, self.cross) if self.cross.any() else both

    def in_units(self, x: Array, force: float) -> Quadratic:
        """Return it of states (n,) and a force that are measured in such units."""
        return Quadratic(
            self.state * np.outer(x, x), self.cross * x[:, None] * force, self.force * force**2
        )

    def at(self, state: Array, force: float) -> float:
        """Return the cost of a state (n,) and a force."""
        crossed, effort = self.cross[:, 0] * force, self.force.item() * force**2
        return float(state @ self.state @ state + 2.0 * (state @ crossed) + effort)

    def of(self, states: Sequence[int]) -> Quadratic:
        """Return the cost of some of the states, where the others have no part in it."""
        rows = np.ix_(states, states)
        return Quadratic(self.state[rows], self.cross[list(states)], self.force)

    def ahead(self, a: Array, b: Array) -> Quadratic:
        """Return it as a cost of the state before the step a x + b u in which the force acts."""
        before, through = a.T @ self.state @ a, self.state @ b + self.cross
        return Quadratic(
            0.5 * (before + before.T),  # round-off is not symmetric
            a.T @ through,
            self.force + b.T @ self.state @ b + self.cross.T @ b + b.T @ self.cross,
        )


class Problem(NamedTuple):
    """The sampled plant and its cost, of the states that the cost depends on."""

    states: tuple[int, ...]  # indices out of `FED_BACK`
    # a, b: (n, n) and (n, 1) of a control step.
    a: Array
    b: Array
    cost: Quadratic  # of a step


def problem_of(scene: Scene, stretch: float | None = None, also: Array | None = None) -> Problem:
    """Return what a regulator of the force is designed for, at a stretch of the springs.

    Its states are those of the cost, and of other quantities (q, 4) that are linear in the state,
    and those that move them. The cost is of x1, x2, v1, v2 at a step's end and of the force that is
    held in it. Accelerations are linear in both: a1 and a2 are the third and fourth rows of A x + B
    u, and the force between the masses is m2 a2. What disturbs the plant is left out. Raise
    `DesignError` if the motion has no weight, or as for `force_weight`.
    """
    weight = np.zeros((5, 5))
    weight[4, 4] = force_weight(scene)
    weight[:4, :4] = motion_weight(scene)
    plant, reactions = plant_of(scene), reaction_weights(scene)
    a, b = plant.linear(stretch)
    if any(reactions):
        for row, squared in zip(np.hstack([a, b])[2:], reactions, strict=True):
            weight += squared * np.outer(row, row)
    require_weight(weight[:4, :4])
    shown = weight[:4, :4] if also is None else np.vstack([weight[:4, :4], also])
    matters = told_by(a, shown.any(axis=0) | np.array([True, False, True, False]))
    states = tuple(int(i) for i in np.flatnonzero(matters))
    cost = Quadratic(weight[:4, :4], weight[:4, 4:], weight[4:, 4:]).of(states)
    a, b = plant.discrete(stretch)
    return Problem(states, a[np.ix_(states, states)], b[list(states), :1], cost)


def lagging(scene: Scene, problem: Problem) -> Problem:
    """Return the problem of a force p that follows its command u with a lag, p its last state.

    In a control step p goes a share of the way to u, and is held.
    """
    states, a, b, cost = problem
    effort, share = force_weight(scene), float(Actuators(scene).lag_factor[0])
    moved = np.block([[a, (1.0 - share) * b], [np.zeros((1, len(a))), np.eye(1) * (1.0 - share)]])
    weight = np.block([[cost.state, cost.cross], [cost.cross.T, cost.force - effort]])
    own = Quadratic(weight, np.zeros((len(moved), 1)), np.full((1, 1), effort))
    return Problem((*states, len(STATES)), moved, share * np.vstack([b, [[1.0]]]), own)


def reaction_weights(scene: Scene) -> tuple[float, float]:
    """Return the weights of the squared accelerations of carriage and sphere [s^4/m^2].

    That of the force between the masses is in the second, with the middle of the sphere's mass.
    """
    o, mass = scene.objective, nominal(scene, "sphere.mass")
    on_sphere = o.sphere_acceleration_weight / o.sphere_acceleration_scale**2
    on_sphere += o.coupling_force_weight * (mass / o.coupling_force_scale) ** 2
    return o.carriage_acceleration_weight / o.carriage_acceleration_scale**2, on_sphere


def state_weight(scene: Scene) -> Array:
    """Return the (4, 4) weight of the state in a reward of nothing but state and actions.

    Raise `DesignError` if the motion has no weight, or the reward is also of accelerations or the
    force between the masses.
    """
    if any(reaction_weights(scene)):
        msg = (
            "objective: carriage_acceleration_weight, sphere_acceleration_weight and "
            "coupling_force_weight cannot be used in this design; allowed: 0. The LQR, the "
            "finite-horizon LQR, the LQG and linear MPC can use them"
        )
        raise DesignError(msg)
    weight = motion_weight(scene)
    require_weight(weight)
    return weight


def motion_weight(scene: Scene) -> Array:
    """Return the (4, 4) weight of displacement, velocity and stroke in the scene's reward."""
    objective = scene.objective
    stroke = objective.stroke_weight / objective.stroke_scale**2
    weight = np.zeros((4, 4))
    weight[0, 0] = objective.displacement_weight / objective.displacement_scale**2 + stroke
    weight[1, 1] = stroke
    weight[0, 1] = weight[1, 0] = -stroke
    weight[2, 2] = objective.velocity_weight / objective.velocity_scale**2
    return weight


def require_weight(weight: Array) -> None:
    """Raise `DesignError` if nothing of the motion has a weight."""
    if not weight.any():
        msg = (
            "objective: displacement_weight, velocity_weight and stroke_weight are 0; allowed: one "
            "greater than 0, for a motion to keep small"
        )
        raise DesignError(msg)


def _check(gain: Array, p: Array, a: Array, b: Array, stage: Quadratic) -> None:
    closed, crossed = a - b @ gain, stage.cross @ gain
    residual = closed.T @ p @ closed + gain.T @ stage.force @ gain + stage.state - p
    residual -= crossed + crossed.T
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


class LQR(Law):
    """Feed the state back through the optimal gain."""

    name = "LQR"

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        self.design = design(scene, stretch)
        self.limit = Command(scene, "force").high

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return state[:, self.design.states] @ (-self.design.gain.T / self.limit), memory


class LaggingLQR(Law):
    """Feed back the state, and the force that is applied: the LQR of plant and lag.

    A lag is part of the plant, and what is applied is known from the actions. Kwakernaak and Sivan,
    *Linear Optimal Control Systems* (1972), section 6.4. Of a drawn lag the middle is known. Raise
    `DesignError` as `design` does.
    """

    name = "LQR of plant and lag"

    def __init__(self, scene: Scene) -> None:
        self.design = solved(scene, lagging(scene, problem_of(scene)))
        self.limit = Command(scene, "force").high

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        fed_back = np.hstack([state, applied])[:, self.design.states]
        return fed_back @ (-self.design.gain.T / self.limit), memory


def _without_lag(scene: Scene) -> str | None:
    if nominal(scene, "actuation.force.lag") == 0.0:
        return "which knows how a force lags behind its command; actuation.force.lag: got 0"
    return without_weight(scene)


def regulator(scene: Scene, stretch: float | None = None) -> LQR:
    """Return the LQR, without the stroke's weight if none can be designed with it."""
    try:
        return LQR(scene, stretch)
    except DesignError as error:
        with suppress(DesignError):
            law = LQR(scene.replace(**{"objective.stroke_weight": 0.0}), stretch)
            law.name = "LQR, blind to the stroke"
            return law
        raise error from None


def with_constant_stretch(scene: Scene) -> Feedback:
    """Search the stretch that is held next to the LQR."""
    stretches = grid(scene, "stretch")
    return searched(scene, lambda s: Both(LQR(scene, s), Held(scene, "stretch", s)), stretches)


def with_constant_damping(scene: Scene) -> Feedback:
    """Search the damping that is held next to the LQR of the plant with it."""
    dampings = grid(scene, "damping")
    return searched(
        scene,
        lambda damping: Both(LQR(held_damping(scene, damping)), Held(scene, "damping", damping)),
        dampings,
    )


def held_damping(scene: Scene, damping: float) -> Scene:
    """Return the scene of a force alone, in which the damper that is actuated has a damping."""
    damped = str(scene.actuation.damped)
    return scene.replace(
        **{
            "actuation.damping": None,
            "randomization": drawn_but(scene, damped, "sensors.", "actuation.damping."),
            "sensors": {},
            damped: damping,
        }
    )


def _without_weight_at_a_damping(scene: Scene) -> str | None:
    damper = scene.actuation.damping
    return without_weight(scene if damper is None else held_damping(scene, damper.minimum))


ENTRIES = (
    regulator_entry("lqr", ("force",), regulator, 10, label="LQR"),
    Entry("lagging-lqr", ("force",), LaggingLQR, 17, label=LaggingLQR.name, refuses=_without_lag),
    regulator_entry(
        "lqr", ("force", "stretch"), with_constant_stretch, 30, label="LQR + constant stretch"
    ),
    Entry(
        "lqr",
        ("force", "damping"),
        with_constant_damping,
        30,
        label="LQR + constant damping",
        refuses=_without_weight_at_a_damping,
        told=True,
    ),
)
