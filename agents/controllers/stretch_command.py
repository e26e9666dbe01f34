"""Laws that tune the springs: the command towards a wanted stretch, and what they refuse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import require_actuator
from mm_gym import DesignError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import Scene

FIELD = "carriage.linear_coefficient"


class StretchCommand:
    """Turn a wanted stretch into the action towards it, whether position or rate is commanded."""

    def __init__(self, scene: Scene) -> None:
        require_actuator(scene, "stretch")
        actuator = scene.actuation.stretch
        assert actuator is not None  # noqa: S101 - as required
        self.actuator = actuator
        self.time_step = scene.control.time_step

    def __call__(
        self, wanted: NDArray[np.float64], present: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return actions (lanes, 1) towards a wanted stretch (lanes,) from the present (lanes,).

        A wanted stretch beyond the actuator's range stands for the end of the range.
        """
        low, high = self.actuator.minimum, self.actuator.maximum
        wanted = np.clip(wanted, low, high)
        if self.actuator.command == "position":
            action = (wanted - 0.5 * (high + low)) / (0.5 * (high - low))
        else:
            assert self.actuator.rate_limit is not None  # noqa: S101 - the scene guarantees it
            action = (wanted - present) / (self.actuator.rate_limit * self.time_step)
        return np.clip(action, -1.0, 1.0)[:, None]


def has_stable_rest(scene: Scene) -> bool:
    """Tell whether the carriage's spring holds it at x1 = 0, for all values that are drawn."""
    drawn = scene.randomization.get(FIELD, (scene.carriage.linear_coefficient,))
    return min(drawn) >= 0.0


def require_stable_rest(scene: Scene, law: str) -> None:
    """Raise `DesignError` for a law that leaves the carriage to its spring, if that drives it off.

    Such laws tune the springs of the sphere, which cannot hold the carriage.
    """
    if not has_stable_rest(scene):
        got = scene.randomization.get(FIELD, scene.carriage.linear_coefficient)
        msg = (
            f"{FIELD}: got {got}; allowed for the {law}: at least 0; it tunes the springs about "
            "x1 = 0, which is unstable"
        )
        raise DesignError(msg)
