"""Controllers by the names that commands take."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.controller import columns
from agents.controllers.registry import entries, every_entry
from mm_gym import SceneError
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Controller
    from mm_gym import Scene

RANDOM = "random"


def laws(scene: Scene) -> dict[str, Callable[[Scene], Controller]]:
    """Return the laws that apply to a scene, by name."""
    return {own.name: own.make for own in entries(scene) if own.refuses(scene) is None}


def obstacle(name: str, scene: Scene) -> str | None:
    """Return why a law does not apply to a scene, or None for a name that is no law's."""
    named = [entry for entry in every_entry() if entry.name == name]
    if not named:
        return None
    for entry in named:
        if entry.actuators in ((), columns(scene)):
            return entry.refuses(scene)
    suited = " or ".join(" and ".join(entry.actuators) for entry in named)
    return f"which is for other actuators: {suited}"


def not_a_law(text: str, scene: Scene, what: str, others: str) -> SceneError:
    """Return the error about a name that is no law of a scene, with the nearest that is.

    Parameters
    ----------
    what
        The setting, for messages.
    others
        What else is allowed.
    """
    applicable = laws(scene)
    reason = obstacle(text, scene)
    why = "" if reason is None else f", {reason}"
    return SceneError(
        f"{what}: got {text!r}{why}{suggest(text, applicable)}; allowed for this scene: "
        f"{', '.join(applicable)}, {others}"
    )
