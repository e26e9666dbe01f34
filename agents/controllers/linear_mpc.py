"""Linear model predictive control (MPC): the LQR's problem with limits of force and motion."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from math import inf

import numpy as np

from agents.control.controller import Acted, Law, Memory
from agents.control.scene import force_weight, nominal, plant_of, require_number
from agents.control.trajectories import ends_of
from agents.controllers.lqr import design, problem_of
from agents.controllers.quadratic_program import Program
from agents.controllers.registry import Entry, regulator_entry, unless, without_weight
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array
from mm_gym.errors import refuse

HORIZON = 30  # control steps that are planned, by default
MOST_STEPS = 1000  # longest horizon; the matrices have the square of its size

KEPT, PENALTY = 0.9, 10.0
"""Of the limits at which episodes end, and of going beyond; see `Limits`.

They are the best tried on ActiveMassDamper's validation episodes: of 1, 0.9, ..., 0.65 of the rail,
and penalties of 1 to 1000. The rest of the rail is for disturbances, which the plan does not know.
"""


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
        limited = (
            (self.displacement, np.array([1.0, 0.0, 0.0, 0.0, 0.0])),
            (self.stroke, np.array([-1.0, 1.0, 0.0, 0.0, 0.0])),
            (self.coupling_force, coupling),
        )
        found = [row / limit for limit, row in limited if limit is not None]
        return np.array(found).reshape(-1, 5)


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


def _cost_to_go(scene: Scene, states: Sequence[int]) -> Array:
    """Return P of the LQR behind the horizon, of these states; zero where there is none."""
    whole = np.zeros((4, 4))
    with suppress(DesignError):
        found = design(scene)
        whole[np.ix_(found.states, found.states)] = found.cost - found.weight
    return whole[np.ix_(states, states)]


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
