"""Controllers with the numbers of least cost on the validation episodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from agents.controllers.feedback import Feedback
from agents.controllers.observed_state import ObservedState
from agents.scoring import VALIDATION_SEED, evaluate

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Law, StateSource, Values
    from mm_gym import Scene

DECADES = np.linspace(-2.0, 2.0, 17)
"""Exponents of the gains and weights that are tried."""


def grid(scene: Scene, actuator: str) -> Values:
    """Return values over an actuator's range [-, N s/m, V]."""
    own = getattr(scene.actuation, actuator)
    return np.linspace(own.minimum, own.maximum, 33)


def searched(
    scene: Scene,
    make: Callable[[float], Law],
    values: Values,
    seed: int = VALIDATION_SEED,
    source: StateSource | None = None,
) -> Feedback:
    """Return the law of least cost: the best of some values, refined between its neighbours."""
    source = source or ObservedState(scene)

    def controller(value: float) -> Feedback:
        return Feedback(scene, make(float(value)), source)

    def cost(value: float) -> float:
        return tried(scene, controller(value), seed)

    costs = [cost(value) for value in values]
    best = int(np.argmin(costs))
    around = values[max(best - 1, 0)], values[min(best + 1, len(values) - 1)]
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-3})
    return controller(float(refined.x) if refined.fun < costs[best] else float(values[best]))


def searched_pair(
    scene: Scene, make: Callable[[float, float], Law], first: Values | None = None
) -> Feedback:
    """Search a first value on a coarse grid, by default a stretch, and a second over four decades.

    Then search the second finely.
    """
    source = ObservedState(scene)
    coarse = grid(scene, "stretch")[4::4] if first is None else first
    pairs = [(value, 10.0**e) for value in coarse for e in DECADES[::4]]
    best, _ = min(pairs, key=lambda pair: tried(scene, Feedback(scene, make(*pair), source)))
    return searched(scene, lambda exponent: make(best, 10.0**exponent), DECADES)


def tried(scene: Scene, controller: Feedback, seed: int = VALIDATION_SEED) -> float:
    """Return the cost on the validation episodes."""
    return evaluate(scene, controller, seed=seed, episodes=100).cost
