"""Held-out episodes: every controller runs through the same ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.matching_stretch import FREQUENCY
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from mm_gym import Scene

HELD_OUT_SEED = 1_000_000
"""Seed of the first lane of the final evaluation; training seeds are far below."""

VALIDATION_SEED = 2_000_000
"""Seed of the first lane of the evaluations during training, and of what baselines are tuned on."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What one controller did.

    Attributes
    ----------
    name
        The controller's name.
    penalties
        (episodes,) mean of -reward over the steps of each [-].
    returns
        (episodes,) sum of the rewards of each [-].
    frequency
        (episodes,) [rad/s] of the first excitation, or None where its field is not randomised.
    time, displacement, applied
        (steps,) [s]; (steps, episodes) x1 / objective.displacement_scale; (steps, episodes, k) what
        the actuators reached.
    """

    name: str
    penalties: NDArray[np.float64]
    returns: NDArray[np.float64]
    frequency: NDArray[np.float64] | None
    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    applied: NDArray[np.float64]

    @property
    def cost(self) -> float:
        """Root of the mean of -reward over all steps of all episodes [-]: what the task asks for.

        Where only the displacement is rewarded, it is the same as `rms`.
        """
        return float(np.sqrt(np.mean(self.penalties)))

    @property
    def episode_costs(self) -> NDArray[np.float64]:
        """(episodes,) the same of each episode [-]."""
        return np.sqrt(self.penalties)

    @property
    def rms(self) -> float:
        """Root mean square of x1 / objective.displacement_scale over all steps [-]."""
        return float(np.sqrt(np.mean(self.displacement**2)))

    @property
    def episode_rms(self) -> NDArray[np.float64]:
        """(episodes,) the same of each episode [-]."""
        return np.sqrt(np.mean(self.displacement**2, axis=0))


def evaluate(
    scene: Scene, controller: Controller, *, seed: int = HELD_OUT_SEED, episodes: int = 200
) -> Evaluation:
    """Run a controller through one episode a lane.

    An unknown frequency is spread evenly over its band. An episode that terminates early counts as
    if its last step were repeated, so that nothing is gained by ending; its return is what it got.
    """
    env = MovingMassVectorEnv(scene, episodes, autoreset_mode="Disabled")
    band = scene.randomization.get(FREQUENCY)
    options = {} if band is None else {FREQUENCY: np.linspace(*band, episodes)}
    observation, info = env.reset(seed=seed, options=options)
    controller.reset(env)
    steps = scene.control.steps
    displacement, rewards = np.empty((steps, episodes)), np.empty((steps, episodes))
    applied = np.empty((steps, episodes, env.single_action_space.shape[0]))
    returns, alive = np.zeros(episodes), np.ones(episodes, np.bool_)
    for step in range(steps):
        for record in (displacement, rewards, applied):
            record[step] = record[step - 1]
        observation, reward, terminated, truncated, info = env.step(
            controller.act(observation, info)
        )
        displacement[step, alive] = info["state"][alive, 0]
        rewards[step, alive] = reward[alive]
        applied[step, alive] = info["applied"][alive]
        returns[alive] += reward[alive]
        ended = terminated | truncated
        alive &= ~ended
        if not alive.any():
            for record in (displacement, rewards, applied):
                record[step + 1 :] = record[step]
            break
        if ended.any():
            env.reset(options={"reset_mask": ended})
    return Evaluation(
        name=controller.name,
        penalties=-rewards.mean(axis=0),
        returns=returns,
        frequency=None if band is None else options[FREQUENCY],
        time=scene.control.time_step * np.arange(1, steps + 1),
        displacement=displacement / scene.objective.displacement_scale,
        applied=applied,
    )
