"""The best classical controller of a scene, than which no search returns a worse agent."""

from typing import NamedTuple

import numpy as np
from gymnasium.error import DependencyNotInstalled

from agents.controllers.registry import RANDOM, laws
from agents.controllers.tuned import NOT_SCORED
from agents.scoring import VALIDATION_EPISODES, validation_cost
from mm_gym import ActionError, MovingMassVectorEnv, Scene

PLANS = "predictive-control"
"""The controller that plans anew in each control step: it takes minutes on the validation
episodes, and is no base of a training."""

TENTH, NEAR = VALIDATION_EPISODES // 10, 1.1
"""Episodes on which it is tried first, and by how much it may cost more there than the best of the
others: it is scored on all of them only then."""


class Best(NamedTuple):
    """A controller of a scene."""

    name: str  # the one that commands take
    cost: float  # on the validation episodes, on which it was tuned [-]


def best_controller(scene: Scene, *, plans: bool = True, worst: float = 1.0) -> Best:
    """Return the controller of least validation cost, of those that read the observation alone.

    It is no control where none costs less. Raise `SceneError` or `CompileError` if there is nothing
    to control.

    Parameters
    ----------
    scene
        What is controlled.
    plans
        Whether predictive control by plans of its own is among them.
    worst
        Share of the episodes, those that cost most, whose mean is the cost.
    """
    MovingMassVectorEnv(scene, 1).close()
    key = (scene.digest, plans, worst) if scene.own_reward is None else None
    if key in _FOUND:
        return _FOUND[key]
    if plans:
        best = _or_plans(scene, best_controller(scene, plans=False, worst=worst), worst)
    else:
        names = [name for name in laws(scene) if name not in {RANDOM, PLANS}]
        found = [Best(name, _cost(scene, name, worst)) for name in names]
        best = min(found, key=lambda one: one.cost)
    if key:
        _FOUND[key] = best
    return best


def _or_plans(scene: Scene, best: Best, worst: float) -> Best:
    """Return the best controller, or predictive control if it costs less."""
    if _cost(scene, PLANS, worst, TENTH) > NEAR * _cost(scene, best.name, worst, TENTH):
        return best
    return min(best, Best(PLANS, _cost(scene, PLANS, worst)), key=lambda one: one.cost)


def _cost(scene: Scene, name: str, worst: float, episodes: int = VALIDATION_EPISODES) -> float:
    """Return the cost of a controller on validation episodes, or infinity if it has none."""
    try:
        controller = laws(scene)[name](scene)
        if controller.reads != "observation":
            return np.inf
        cost = validation_cost(scene, controller, worst, episodes)
    except (*NOT_SCORED, ActionError, DependencyNotInstalled):
        return np.inf
    return cost if np.isfinite(cost) else np.inf


_FOUND: dict[tuple[str, bool, float] | None, Best] = {}
"""By the digest of the scene: trials of a search of settings share it."""
