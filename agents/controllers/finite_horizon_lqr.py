"""The LQR of an episode that ends: its gain varies with the time that is left."""

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory, looked_up
from agents.controllers.lqr import problem_of
from agents.controllers.registry import regulator_entry
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

MOST_STEPS = 100_000  # longest episode: its gains are found and kept step by step


class FiniteHorizonLQR(Law):
    """Feed the state back through the gain that is optimal for the steps left of the episode.

    The Riccati recursion runs back from the end, so nothing need be stabilisable: a stroke that the
    force does not reach is weighed, too. Kwakernaak and Sivan, *Linear Optimal Control Systems*
    (1972), section 6.4. Raise `DesignError` if there is no force, it is commanded by its rate or
    costs nothing, the motion has no weight, or the episode is too long.

    Attributes
    ----------
    gains
        (steps, n) [N/m, N s/m], the first of the first step.
    cost
        (n, n): the sum of rewards from a state is -(x'P x), without limits of the force.
    """

    name = "finite-horizon LQR"

    def __init__(self, scene: Scene) -> None:
        (self.states, a, b, own), steps = problem_of(scene), scene.control.steps
        if steps > MOST_STEPS:
            msg = (
                f"control.steps: got {steps}; allowed for a finite-horizon LQR: at most "
                f"{MOST_STEPS}; the LQR is its limit for long episodes"
            )
            raise DesignError(msg)
        self.limit = Command(scene, "force").high
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

    def begin(self, lanes: int) -> Memory:
        return {"step": np.zeros(lanes, np.int64)}

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        step = memory["step"]
        gain = looked_up(self.gains[None, :, None], np.minimum(step, len(self.gains) - 1))
        force = np.einsum("lij,lj->li", gain, state[:, self.states])
        return -force / self.limit, {"step": step + 1}


ENTRIES = (
    regulator_entry(
        "finite-horizon-lqr",
        ("force",),
        FiniteHorizonLQR,
        51,
        "further",
        label=FiniteHorizonLQR.name,
    ),
)
