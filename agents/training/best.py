"""The best classical controller of a scene, than which no search returns a worse agent."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from gymnasium.error import DependencyNotInstalled

from agents.controllers.registry import RANDOM, laws
from agents.controllers.tuned import NOT_SCORED
from agents.scoring import validation_cost
from mm_gym import ActionError, MovingMassVectorEnv

if TYPE_CHECKING:
    from mm_gym import Scene

SLOW = RANDOM, "predictive-control"
"""Not tried: what is no controller, and what plans for minutes on the validation episodes."""


class Best(NamedTuple):
    """A controller of a scene.

    Attributes
    ----------
    name
        The one that commands take.
    cost
        On the validation episodes, on which it was tuned [-].
    """

    name: str
    cost: float


def best_controller(scene: Scene) -> Best:
    """Return the controller of least validation cost, of those that read the observation alone.

    It is no control where none costs less.

    Raises
    ------
    SceneError, CompileError
        If there is nothing to control.
    """
    MovingMassVectorEnv(scene, 1).close()
    key = scene.digest if scene.own_reward is None else ""
    if key and key in _FOUND:
        return _FOUND[key]
    found: list[Best] = []
    for name, make in laws(scene).items():
        if name in SLOW:
            continue
        try:
            controller = make(scene)
            if controller.reads == "observation":
                found.append(Best(name, validation_cost(scene, controller)))
        except (*NOT_SCORED, ActionError, DependencyNotInstalled):
            continue
    best = min(found, key=lambda one: one.cost if np.isfinite(one.cost) else np.inf)
    if key:
        _FOUND[key] = best
    return best


_FOUND: dict[str, Best] = {}
"""By the digest of the scene: trials of a search of settings share it."""
