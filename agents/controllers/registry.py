"""Entries of controllers: all that commands, rankings, bases and pages know of them.

An entry stands in the controller's own file, in a tuple `ENTRIES`; every module of this package is
asked for it.
"""

from __future__ import annotations

import pkgutil
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Literal, TypeAlias

import agents.controllers
from agents.controllers.controller import columns, force_weight
from mm_gym import DesignError

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Controller
    from agents.controllers.tunable import Tunable
    from mm_gym import Scene

Role: TypeAlias = Literal["any", "law", "filter", "further", "informed"]
"""For any actuators; tuned law; with a filter of its own; slow or of extras; knows the episode."""


@dataclass(frozen=True)
class Entry:
    """What is known of a controller.

    Attributes
    ----------
    name
        For commands.
    actuators
        The scene's, all of them; none for a controller of any actuators.
    make
        Makes it for a scene, tuned on the validation episodes.
    order
        Place in tables.
    role
        Which tables it is in.
    label
        In the list of what is not scored; by default the name, in words.
    refuses
        Returns why it does not apply to a scene that has its actuators, or None.
    told
        Whether tables tell that it is not scored where it is refused.
    tunable
        Its free numbers, which `python -m agents tune-controllers` searches.
    """

    name: str
    actuators: tuple[str, ...]
    make: Callable[[Scene], Controller]
    order: int
    role: Role = "law"
    label: str = ""
    refuses: Callable[[Scene], str | None] = lambda _: None
    told: bool = False
    tunable: Tunable | None = None


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
        if entry.actuators in ((), columns(scene)) and (not roles or entry.role in roles)
    ]
