"""Laws on late and noisy sensors, beside the same laws on the true state."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from agents.controllers.feedback import Feedback
from agents.controllers.true_state import TrueState
from agents.evaluation.baselines import (
    best_without_memory,
    classical_laws,
    output_feedback,
    predictive_control,
)
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mm_gym import Scene

DELAY, NOISE, EPISODES = 2, 0.01, 20
"""Control steps; standard deviation over each channel's scale; and episodes of a score."""

RUNS, ACTIONS = 10, 10
"""Of the measurement of time."""


def late(scene: Scene) -> Scene:
    """Return the scene with late and noisy sensors; noise that it has already stays."""
    plant = compile_scene(scene)
    noise = {
        name: NOISE / channel.factor
        for name, channel in zip(plant.channels, plant.observed, strict=True)
        if name not in ("stretch", "applied_force")  # what the actuators report themselves
    }
    return scene.replace(
        **{"sensors.delay": DELAY, "sensors.noise": noise | dict(scene.sensors.noise)}
    )


def tuned(scene: Scene) -> list[Feedback]:
    """Return the laws, tuned with the scene's own sensors, predictive control last."""
    laws = classical_laws(scene)
    return [*laws, predictive_control(scene, best_without_memory(scene, laws))]


def compare(scene: Scene, laws: Sequence[Feedback]) -> list[tuple[str, float | None, float | None]]:
    """Return each law's name and its costs with late sensors, from these and from the true state.

    One that filters the observation itself has no
    cost from the true state; one whose state cannot be estimated has none from the observation.
    """
    shown = late(scene)
    rows: list[tuple[str, float | None, float | None]] = []
    for law in [controller.law for controller in laws]:
        known = evaluate(shown, Feedback(shown, law, TrueState()), episodes=EPISODES).cost
        try:
            seen = evaluate(shown, Feedback(shown, law), episodes=EPISODES).cost
        except DesignError:
            seen = None
        rows.append((law.name, seen, known))
    for controller in output_feedback(shown):
        cost = evaluate(shown, controller, episodes=EPISODES).cost
        rows.append((controller.name, cost, None))
    return rows


def time_of_action(scene: Scene, controller: Feedback) -> float:
    """Return the processor time [s] in which a controller finds an action of one episode.

    The mean of ten actions, in the quickest of ten runs: others may load the machine.
    """
    env = MovingMassVectorEnv(scene, 1)
    observation, _ = env.reset(seed=VALIDATION_SEED)
    controller.reset(env)
    spent = []
    for _ in range(RUNS * ACTIONS):
        began = time.process_time()
        action = controller.act(observation, {})
        spent.append(time.process_time() - began)
        observation, *_ = env.step(action)
    return min(sum(spent[k : k + ACTIONS]) for k in range(0, len(spent), ACTIONS)) / ACTIONS
