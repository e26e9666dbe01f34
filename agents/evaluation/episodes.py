"""Every controller on the same held-out episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from agents.controllers.controller import Both, ConstantForce, ConstantStretch, Zero, columns
from agents.controllers.lqr import LQR, DesignError
from agents.controllers.neutraliser import FREQUENCY, MatchingStretch
from agents.controllers.semi_active import ClippedLQR, PhaseLaw
from agents.controllers.velocity_feedback import VelocityFeedback
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from mm_gym import Scene

HELD_OUT_SEED = 1_000_000
"""Seed of the first lane of the final evaluation; training seeds are far below."""

VALIDATION_SEED = 2_000_000
"""Seed of the first lane of the evaluations during training, and of what baselines are tuned on."""

DECADES = np.linspace(-2.0, 2.0, 17)
"""Exponents of the gains and prices that are tried."""

CENTRED = np.linspace(-0.5, 0.5, 17)
"""Threads of the force limit that are tried."""


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

    @property
    def cost(self) -> float:
        """Root of the mean of -reward over all steps of all episodes [-].

        Where only the displacement is paid for, it is the score.
        """
        return float(np.sqrt(np.mean(self.episode_costs)))

    @property
    def episode_costs(self) -> NDArray[np.float64]:
        """(episodes,) mean of -reward over the steps of each [-]."""
        return -self.returns / self.time.size


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
    if scene.actuation.stretch is not None:
        found.insert(0, best_constant_stretch(scene))
    found += classical_laws(scene)
    if FREQUENCY in scene.randomization and columns(scene) == ("stretch",):
        found.append(MatchingStretch(scene))
    return found


def classical_laws(scene: Scene) -> list[Controller]:
    """Return the tuned laws that need nothing but the present state."""
    match columns(scene):
        case ("force",):
            return [*regulators(scene), best_velocity_feedback(scene)]
        case ("stretch",):
            return [best_phase_law(scene), best_clipped_lqr(scene)]
        case _:
            return [best_lqr_at_constant_stretch(scene), best_lqr_with_clipped_lqr(scene)]


def regulators(scene: Scene) -> list[Controller]:
    """Return the LQR, if one can be designed, without the price of the stroke if it must be."""
    if scene.objective.effort_weight == 0.0:
        return []
    try:
        return [LQR(scene)]
    except DesignError:
        regulator = LQR(scene.replace(**{"objective.stroke_weight": 0.0}))
        regulator.name = "LQR, blind to the stroke"
        return [regulator]


def best_constant(scene: Scene, seed: int = VALIDATION_SEED) -> Controller:
    """Return the best of what never moves: a stretch, or a force where there is no stretch.

    With the seed of the final evaluation it is the best in hindsight.
    """
    actuator = scene.actuation.force
    if scene.actuation.stretch is not None or actuator is None:
        return best_constant_stretch(scene, seed)
    return _search(scene, lambda force: ConstantForce(scene, force), actuator.limit * CENTRED, seed)


def best_constant_stretch(scene: Scene, seed: int = VALIDATION_SEED) -> Controller:
    """Search the constant stretch of least cost: a grid, then a bounded descent about its best."""

    def law(stretch: float) -> Controller:
        still = ConstantStretch(scene, stretch)
        return still if scene.actuation.force is None else Both(ConstantForce(scene), still)

    return _search(scene, law, _stretches(scene), seed)


def best_phase_law(scene: Scene) -> Controller:
    """Search the gain of the phase law with the least cost, over four decades."""
    return _search(scene, lambda exponent: PhaseLaw(scene, 10.0**exponent), DECADES)


def best_velocity_feedback(scene: Scene) -> Controller:
    """Search the gain of the velocity feedback with the least cost, over four decades."""
    critical = 2.0 * np.sqrt(scene.carriage.mass * scene.carriage.stiffness)
    return _search(
        scene, lambda exponent: VelocityFeedback(scene, critical * 10.0**exponent), DECADES
    )


def best_clipped_lqr(scene: Scene) -> Controller:
    """Search the stretch and the price of the clipped LQR with the least cost."""
    return _search_pair(scene, lambda stretch, price: ClippedLQR(scene, stretch, price))


def best_lqr_at_constant_stretch(scene: Scene) -> Controller:
    """Search the stretch that a regulator of the force does best with."""
    return _search(
        scene, lambda s: Both(LQR(scene, s), ConstantStretch(scene, s)), _stretches(scene)
    )


def best_lqr_with_clipped_lqr(scene: Scene) -> Controller:
    """Search the same two with a regulator of the force beside it."""
    return _search_pair(
        scene,
        lambda stretch, price: Both(LQR(scene, stretch), ClippedLQR(scene, stretch, price)),
    )


def _stretches(scene: Scene) -> NDArray[np.float64]:
    actuator = scene.actuation.stretch
    if actuator is None:
        msg = "actuation.stretch: missing; there is no stretch to hold"
        raise ValueError(msg)
    return np.linspace(actuator.minimum, actuator.maximum, 33)


def _search(
    scene: Scene,
    make: Callable[[float], Controller],
    grid: NDArray[np.float64],
    seed: int = VALIDATION_SEED,
) -> Controller:
    def cost(value: float) -> float:
        return _tried(scene, make(float(value)), seed)

    costs = [cost(value) for value in grid]
    best = int(np.argmin(costs))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-3})
    return make(float(refined.x) if refined.fun < costs[best] else float(grid[best]))


def _search_pair(scene: Scene, make: Callable[[float, float], Controller]) -> Controller:
    """Search a stretch on a coarse grid, with prices over four decades, then the price finely."""
    pairs = [(s, 10.0**e) for s in _stretches(scene)[8::8] for e in DECADES[::4]]
    stretch, _ = min(pairs, key=lambda pair: _tried(scene, make(*pair)))
    return _search(scene, lambda exponent: make(stretch, 10.0**exponent), DECADES)


def _tried(scene: Scene, controller: Controller, seed: int = VALIDATION_SEED) -> float:
    return evaluate(scene, controller, seed=seed, episodes=100).cost
