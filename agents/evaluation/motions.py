"""The motions of a controller in some episodes."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import periodogram

from agents.control.controller import Controller
from agents.evaluation.contestants import Episodes
from agents.rollout import Rollout
from agents.scoring import spread_frequency
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array


@dataclass(frozen=True, eq=False)
class Motions:
    """What one controller did in some episodes; NaN after an early end."""

    time: Array  # (steps + 1,) from the start of the episode [s]
    # displacement, stroke: (steps + 1, episodes): x1 and x2 - x1 [m].
    displacement: Array
    stroke: Array
    applied: Array  # (steps + 1, episodes, k): what the actuators have, in the order of the action

    def spectrum(self) -> tuple[Array, Array]:
        """Return frequencies (n,) [Hz] and the one-sided power spectral density of x1 [m^2/Hz].

        It is the mean of the periodograms, in Hann's window, of the episodes that lasted to their
        end; both are empty if none did.
        """
        lasted = self.displacement[:, ~np.isnan(self.displacement).any(axis=0)]
        if not lasted.size:
            return np.empty(0), np.empty(0)
        step = self.time[1] - self.time[0]
        frequencies, power = periodogram(lasted, 1.0 / step, window="hann", axis=0)
        return frequencies, power.mean(axis=1)


def motions(scene: Scene, controller: Controller, episodes: Episodes) -> Motions:
    """Return what a controller does in the episodes of the first seed."""
    lanes, steps = episodes.each, scene.control.steps
    env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
    seeds = range(episodes.first, episodes.first + lanes)
    rollout = Rollout(env, controller, seed=seeds, options=spread_frequency(scene, lanes))
    position = np.full((steps + 1, lanes, 2), np.nan)
    applied = np.full((steps + 1, lanes, env.single_action_space.shape[0]), np.nan)
    position[0], applied[0] = rollout.info["state"][:, :2], rollout.info["applied"]
    for step, made in enumerate(rollout, 1):
        position[step, made.ran] = made.info["state"][made.ran, :2]
        applied[step, made.ran] = made.info["applied"][made.ran]
    x1, x2 = position[..., 0], position[..., 1]
    return Motions(scene.control.time_step * np.arange(steps + 1), x1, x2 - x1, applied)
