"""Plans that are made anew in every step, with and without knowledge of what is to come."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.trajectories import Trajectories

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads
    from mm_gym import MovingMassVectorEnv, Scene

    Array = NDArray[np.float64]

AHEAD, FIRST, ROUNDS = 40, 30, 3
"""Steps that are planned, and steps of Gauss and Newton at an episode's start and in each step."""


class Replanner:
    """In every step take the first action of the best plan found for the steps to come.

    It knows the true state, and those of the filters that shape the noise. One that does not
    foresee plans for the mean of what is to come: no random impulse, and noise that dies out as its
    filters do. Both are alike in all else, so that the difference of their costs is what foresight
    is worth to this controller. Neither is a bound: plans are local optima, and where the problem
    is not linear and quadratic the best plan for the mean is not the best on average.

    Parameters
    ----------
    scene
        The scene.
    foresees
        Whether the disturbance of the steps that are planned is known.
    """

    def __init__(self, scene: Scene, *, foresees: bool) -> None:
        self.scene, self.foresees = scene, foresees
        self.name = f"replanning, {AHEAD} steps ahead" + (", foresees them" if foresees else "")
        self.reads: Reads = "episode" if foresees else "full state"

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin without a plan."""
        self.env, self.rounds = env, FIRST
        self.controls = np.zeros((AHEAD, env.single_action_space.shape[0], env.num_envs))

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Array:
        """Return the first actions of new plans, which go on from those of the step before."""
        start, lanes = self.env.get_state(), np.arange(self.env.num_envs)
        problem = Trajectories(self.scene, self.env.plant, start, AHEAD, foresees=self.foresees)
        found = problem.improve(lanes, self.controls, self.rounds)
        self.controls = np.concatenate([found.controls[1:], np.zeros_like(found.controls[:1])])
        self.rounds = ROUNDS
        return found.actions[0].T
