"""Entries of controllers: all that commands, rankings, bases and pages know of them, by name.

An entry stands in the controller's own file, in a tuple `ENTRIES`; every module of this package is
asked for it.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Literal, TypeAlias

import agents.controllers
from agents.controllers.controller import Controller
from agents.controllers.scene import force_weight
from mm_gym import DesignError, Scene, SceneError
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from agents.controllers.searched import Tunable


Role: TypeAlias = Literal["any", "law", "filter", "further", "informed"]
"""For any actuators; tuned law; with a filter of its own; slow or of extras; knows the episode."""


@dataclass(frozen=True)
class Entry:
    """What is known of a controller."""

    name: str  # for commands
    actuators: tuple[str, ...]  # the scene's, all of them; none for a controller of any actuators
    make: Callable[[Scene], Controller]  # makes it for a scene, tuned on the validation episodes
    order: int  # place in tables
    role: Role = "law"  # which tables it is in
    label: str = ""  # in the list of what is not scored; by default the name, in words
    # Returns why it does not apply to a scene that has its actuators, or None.
    refuses: Callable[[Scene], str | None] = lambda _: None
    told: bool = False  # whether tables tell that it is not scored where it is refused
    # Its free numbers, which `python -m agents tune-controllers` searches.
    tunable: Tunable | None = None


def unless(holds: Callable[[Scene], bool], reason: str) -> Callable[[Scene], str | None]:
    """Return what refuses scenes for a reason, unless something holds of them."""
    return lambda scene: None if holds(scene) else reason


def without_weight(scene: Scene) -> str | None:
    """Return why a regulator's force has no control weight, or None: see `force_weight`."""
    try:
        force_weight(scene)
    except DesignError as error:
        return f"which cannot be designed: {error}"
    return None


@cache
def every_entry() -> tuple[Entry, ...]:
    """Return the entries of all controllers, in the order of tables."""
    modules = [
        import_module(found.name)
        for found in pkgutil.iter_modules(agents.controllers.__path__, "agents.controllers.")
    ]
    found = [entry for module in modules for entry in getattr(module, "ENTRIES", ())]
    return tuple(sorted(found, key=lambda entry: entry.order))


def entries(scene: Scene, *roles: Role) -> list[Entry]:
    """Return the entries of roles, by default all, for the actuators of a scene."""
    return [
        entry
        for entry in every_entry()
        if entry.actuators in ((), scene.actuation.names) and (not roles or entry.role in roles)
    ]


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
        if entry.actuators in ((), scene.actuation.names):
            return entry.refuses(scene)
    suited = " or ".join(" and ".join(entry.actuators) for entry in named)
    return f"which is for other actuators: {suited}"


def not_a_law(text: str, scene: Scene, what: str, others: str) -> SceneError:
    """Return the error about a name that is no law of a scene, with the nearest that is.

    It names the setting and what else is allowed.
    """
    applicable = laws(scene)
    reason = obstacle(text, scene)
    why = "" if reason is None else f", {reason}"
    return SceneError(
        f"{what}: got {text!r}{why}{suggest(text, applicable)}; allowed for this scene: "
        f"{', '.join(applicable)}, {others}"
    )
