"""Every controller on the same held-out episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from agents.controller import ConstantStretch, Zero
from agents.lqr import LQR
from agents.semi_active import PhaseLaw
from agents.tuned_mass_damper import FREQUENCY, MatchingStretch
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from agents.controller import Controller
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
    score
        Root mean square of x1 / objective.displacement_scale over all steps of all episodes [-].
    episode_scores, returns
        (episodes,) the same of each episode, and its sum of rewards.
    frequency
        (episodes,) [rad/s] of the first excitation, or the episode's number where there is none.
    time, displacement, applied
        (steps,) [s]; (steps, episodes) x1 / displacement_scale; (steps, episodes, k) what the
        actuators reached.
    """

    name: str
    score: float
    episode_scores: NDArray[np.float64]
    returns: NDArray[np.float64]
    frequency: NDArray[np.float64]
    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    applied: NDArray[np.float64]


def evaluate(
    scene: Scene, controller: Controller, *, seed: int = HELD_OUT_SEED, episodes: int = 200
) -> Evaluation:
    """Run a controller through one episode a lane.

    An unknown frequency is spread evenly over its band. A lane whose episode terminates early keeps
    the displacement that it ended with.
    """
    env = MovingMassVectorEnv(scene, episodes, autoreset_mode="Disabled")
    band = scene.randomization.get(FREQUENCY)
    options = {} if band is None else {FREQUENCY: np.linspace(*band, episodes)}
    observation, info = env.reset(seed=seed, options=options)
    controller.reset(env)
    steps = scene.control.steps
    displacement = np.empty((steps, episodes))
    applied = np.empty((steps, episodes, env.single_action_space.shape[0]))
    rewards, alive = np.zeros(episodes), np.ones(episodes, np.bool_)
    for step in range(steps):
        displacement[step], applied[step] = displacement[step - 1], applied[step - 1]
        observation, reward, terminated, truncated, info = env.step(
            controller.act(observation, info)
        )
        displacement[step, alive] = info["state"][alive, 0]
        applied[step, alive] = info["applied"][alive]
        rewards[alive] += reward[alive]
        ended = terminated | truncated
        alive &= ~ended
        if not alive.any():
            displacement[step + 1 :], applied[step + 1 :] = displacement[step], applied[step]
            break
        if ended.any():
            env.reset(options={"reset_mask": ended})
    displacement /= scene.objective.displacement_scale
    return Evaluation(
        name=controller.name,
        score=float(np.sqrt(np.mean(displacement**2))),
        episode_scores=np.sqrt(np.mean(displacement**2, axis=0)),
        returns=rewards,
        frequency=np.arange(episodes, dtype=np.float64) if band is None else options[FREQUENCY],
        time=scene.control.time_step * np.arange(1, steps + 1),
        displacement=displacement,
        applied=applied,
    )


def baselines(scene: Scene) -> list[Controller]:
    """Return the classical controllers that apply to a scene, tuned on the validation episodes.

    The first is the one that ratios refer to: the best constant stretch, or no control where there
    is no stretch.
    """
    found: list[Controller] = [Zero(scene)]
    if scene.actuation.stretch is not None and scene.actuation.force is None:
        found = [best_constant_stretch(scene), *found, best_phase_law(scene)]
        if FREQUENCY in scene.randomization:
            found.append(MatchingStretch(scene))
    if scene.actuation.force is not None and scene.objective.effort_weight > 0.0:
        found.append(LQR(scene))
    return found


def best_constant_stretch(scene: Scene) -> Controller:
    """Search the constant stretch of least score: a grid, then a bounded descent about its best."""
    actuator = scene.actuation.stretch
    if actuator is None:
        msg = "actuation.stretch: missing; there is no stretch to hold"
        raise ValueError(msg)
    grid = np.linspace(actuator.minimum, actuator.maximum, 33)
    return _search(scene, lambda stretch: ConstantStretch(scene, stretch), grid)


def best_phase_law(scene: Scene) -> Controller:
    """Search the gain of the phase law with the least score, over four decades."""
    law = lambda exponent: PhaseLaw(scene, 10.0**exponent)  # noqa: E731 - the search is over the exponent
    return _search(scene, law, np.linspace(-2.0, 2.0, 17))


def _search(
    scene: Scene, make: Callable[[float], Controller], grid: NDArray[np.float64]
) -> Controller:
    def score(value: float) -> float:
        return evaluate(scene, make(float(value)), seed=VALIDATION_SEED, episodes=100).score

    scores = [score(value) for value in grid]
    best = int(np.argmin(scores))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    refined = minimize_scalar(score, bounds=around, method="bounded", options={"xatol": 1e-3})
    return make(float(refined.x) if refined.fun < scores[best] else float(grid[best]))
