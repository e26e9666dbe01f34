"""The LQR of an episode that ends: its gain varies with the time that is left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.lqr import quadratic_cost, states_that_matter
from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


MOST_STEPS = 100_000
"""Longest episode: its gains are found and kept step by step."""


class FiniteHorizonLQR:
    """Feed the state back through the gain that is optimal for the steps left of the episode.

    The Riccati recursion runs back from the end, so nothing need be stabilisable: a stroke that the
    force does not reach is weighed, too. Kwakernaak and Sivan, *Linear Optimal Control Systems*
    (1972), section 6.4.

    Parameters
    ----------
    scene
        A scene with a force; it is linear about rest, with the middle of each range.
    stretch
        Stretch of the springs [-]; by default the initial one.

    Attributes
    ----------
    gains
        (steps, n) [N/m, N s/m], the first of the first step.
    cost
        (n, n): the sum of rewards from a state is -(x'P x), without limits of the force.

    Raises
    ------
    DesignError
        If there is no force, it is commanded by its rate or costs nothing, the motion has no
        weight, or the episode is too long.
    """

    name = "finite-horizon LQR"

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        own, steps = quadratic_cost(scene, stretch), scene.control.steps
        if steps > MOST_STEPS:
            msg = (
                f"control.steps: got {steps}; allowed for a finite-horizon LQR: at most "
                f"{MOST_STEPS}; the LQR is its limit for long episodes"
            )
            raise DesignError(msg)
        assert scene.actuation.force is not None  # noqa: S101 - `quadratic_cost` refuses otherwise
        self.limit = scene.actuation.force.limit
        plant = compile_scene(scene)
        self.states = states_that_matter(plant.linear(stretch)[0], own.state)
        a, b = plant.discrete(stretch)
        rows = np.ix_(self.states, self.states)
        a, b, own = a[rows], b[list(self.states), :1], own.of(self.states)
        across = 2.0 * b.T @ own.cross
        self.gains = np.empty((steps, len(a)))
        cost = np.zeros_like(a)
        for step in reversed(range(steps)):
            ahead = own.state + cost  # the reward is of the state at the step's end
            gain = (b.T @ ahead @ a + own.cross.T @ a) / (own.force + b.T @ ahead @ b + across)
            closed = a - b @ gain
            crossed = closed.T @ own.cross @ gain
            cost = closed.T @ ahead @ closed + own.force * gain.T @ gain - (crossed + crossed.T)
            self.gains[step] = gain[0]
        self.cost = cost

    def begin(self, lanes: int) -> None:
        """Begin at the first step."""
        self.step = 0

    def action(self, state: Values, applied: Values) -> Values:
        """Return the force over the limit."""
        gain = self.gains[min(self.step, len(self.gains) - 1)]
        self.step += 1
        return -(state[:, self.states] @ gain)[:, None] / self.limit
