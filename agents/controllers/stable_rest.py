"""The refusal of laws that need a carriage whose middle is a stable place of rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym import DesignError

if TYPE_CHECKING:
    from mm_gym import Scene

FIELD = "carriage.linear_coefficient"


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
