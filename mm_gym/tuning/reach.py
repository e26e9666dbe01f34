"""The stiffness that the springs of a scene reach, and the stretch that gives it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mm_gym.analysis.springs import spring_stiffness, stretch_for_stiffness
from mm_gym.errors import DesignError, OutOfReachError, positive_number
from mm_gym.plant.task import middle
from mm_gym.scene.mechanics import WITHOUT_STRETCH
from mm_gym.scene.scene import Scene, require_scene

REACHED = 1e-9  # relative distance from the end of the springs' range that is round-off


def stretch_for(scene: Scene, stiffness: float) -> float:
    """Return the stretch [-] at which the scene's springs have a given stiffness k2 [N/m].

    Raises
    ------
    OutOfReachError
        If no such stretch exists, or it is beyond the limits of `actuation.stretch`. The message
        states the range that the springs reach, and a suitable `springs.stiffness`.
    DesignError
        If the scene has no springs, or the stiffness is not a number greater than 0.
    """
    require_scene(scene)
    stiffness = positive_number("stiffness", stiffness, DesignError)
    reach, kind = reach_of(scene), scene.springs.kind
    if reach is None or kind in WITHOUT_STRETCH:
        msg = f"springs.kind: {kind!r} has no stretch; allowed: 'small_on_large', 'finite_stretch'"
        raise DesignError(msg)
    reason = obstacle(reach, stiffness)
    if reason is not None:
        raise OutOfReachError(reason)
    return stretch_within(reach, stiffness)


class Reach(NamedTuple):
    """What the springs of a scene reach."""

    k0: float  # springs.stiffness [N/m], the middle of its range
    low: float  # least k2 [N/m]; without limits of the stretch approached, and not reached
    high: float  # largest k2 [N/m]
    shortest: float  # least stretch [-], NaN of springs that have none
    longest: float  # largest
    is_limited: bool  # whether `actuation.stretch` limits the stretch


LONGEST = 1e4  # stretch [-] that stands for an infinite one: k2 is then 2 k0 but for 2e-12 of it


def reach_of(scene: Scene) -> Reach | None:
    """Return what the scene's springs reach; None without springs."""
    springs, actuator = scene.springs, scene.actuation.stretch
    if springs.kind == "none":
        return None
    k0 = middle(scene, "springs.stiffness", springs.stiffness)
    if springs.kind == "linear":
        return Reach(k0, 0.0, np.inf, np.nan, np.nan, is_limited=False)
    low, high = (1.0, LONGEST) if actuator is None else (actuator.minimum, actuator.maximum)
    least = spring_stiffness(np.inf if actuator is None else high, k0)
    return Reach(
        k0, float(least), float(spring_stiffness(low, k0)), low, high, actuator is not None
    )


def obstacle(reach: Reach, stiffness: float) -> str | None:
    """Return why no stretch gives a stiffness [N/m], or None."""
    low, high = reach.low, reach.high
    above = low * (1.0 - REACHED) <= stiffness if reach.is_limited else low < stiffness
    if above and stiffness <= high * (1.0 + REACHED):
        return None
    limits = "the limits of actuation.stretch" if reach.is_limited else "stretch >= 1"
    least, most = reach.k0 * stiffness / high, reach.k0 * stiffness / low
    return (
        f"k2 = {stiffness:.6g} N/m is out of reach: with springs.stiffness = {reach.k0:g} N/m and "
        f"{limits} the springs have {low:.6g} to {high:.6g} N/m. A springs.stiffness from "
        f"{least:.4g} to {most:.4g} N/m reaches it"
    )


def stretch_within(reach: Reach, stiffness: float) -> float:
    """Return the stretch of a stiffness that is in reach, kept from rounding out of its limits."""
    wanted = stretch_for_stiffness(stiffness, reach.k0)
    return float(np.clip(wanted, reach.shortest, reach.longest))


def tuned_field(scene: Scene) -> str:
    """Return the field that gives the scene's springs their stiffness."""
    if scene.springs.kind == "linear":
        return "springs.stiffness"
    return "springs.stretch" if scene.actuation.stretch is None else "initial.stretch"


def require_fixed(scene: Scene, beginnings: tuple[str, ...]) -> None:
    """Raise `DesignError` if a field whose name begins so is drawn."""
    for name in scene.randomization:
        if name.startswith(beginnings):
            msg = f"randomization.{name}: a tuned field cannot be drawn; leave it out"
            raise DesignError(msg)


def springs_with(scene: Scene, stiffness: float) -> tuple[dict[str, float], float | None]:
    """Return the field of a stiffness [N/m] in reach with its value, and the stretch if it is."""
    reach, name = reach_of(scene), tuned_field(scene)
    if reach is None:
        return {}, None
    if name == "springs.stiffness":
        return {name: stiffness}, None
    stretch = stretch_within(reach, stiffness)
    return {name: stretch}, stretch
