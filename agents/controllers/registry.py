"""Entries of controllers: all that commands, rankings, bases and pages know of them, by name.

An entry stands in the controller's own file, in a tuple `ENTRIES`; every module of this package is
asked for it.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from importlib import import_module
from math import inf
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

import agents.controllers
from agents.control.controller import Controller, Law
from agents.control.feedback import Feedback
from agents.control.scene import force_weight
from agents.controllers.choices import chosen, is_remade, note, recorded
from mm_gym import DesignError, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import refuse, suggest
from mm_gym.files import read_json

Made = TypeVar("Made")

MADE = 64  # designs that are remembered


@dataclass(frozen=True)
class _Known:
    """A scene, the same as all of its digest."""

    digest: str
    scene: Scene = field(compare=False)


def once(make: Callable[..., Made], scene: Scene, *further: Hashable) -> Made:
    """Return what is made of a scene and further arguments, and the same when asked again.

    Searches of designs take long, and several controllers begin with the same one. A reward of
    one's own has no part in the digest: with it everything is made anew, as with known numbers.
    """
    if scene.own_reward is not None or is_remade():
        return make(scene, *further)
    made, numbers = _once(make, _Known(scene.digest, scene), *further)
    note(numbers)
    return made


@lru_cache(maxsize=MADE)
def _once(
    make: Callable[..., Any], known: _Known, *further: Hashable
) -> tuple[Any, Sequence[float]]:
    return recorded(lambda: make(known.scene, *further))


Role: TypeAlias = Literal["any", "law", "filter", "further", "informed"]
"""For any actuators; tuned law; with a filter of its own; slow or of extras; knows the episode."""


@dataclass(frozen=True)
class Entry:
    """What is known of a controller."""

    name: str  # for commands
    actuators: tuple[str, ...]  # the scene's, all of them; none for a controller of any actuators
    # Makes it for a scene, tuned on the validation episodes; a law is fed with what is observed.
    made: Callable[[Scene], Controller | Law]
    order: int  # place in tables
    role: Role = "law"  # which tables it is in
    label: str = ""  # its title, by default the name in words
    # Returns why it does not apply to a scene that has its actuators, or None.
    refuses: Callable[[Scene], str | None] = lambda _: None
    told: bool = False  # whether tables tell that it is not scored where it is refused
    # Its free numbers, which `python -m agents tune-controllers` searches.
    tunable: Tunable | None = None

    @property
    def title(self) -> str:
        """What tables call it before it is made."""
        return self.label or self.name.replace("-", " ")

    def make(self, scene: Scene) -> Controller:
        """Return the controller for a scene; without free numbers in a file, the same each time."""
        return fed(scene, self.made(scene) if self.tunable else once(self.made, scene))


def fed(scene: Scene, made: Controller | Law) -> Controller:
    """Return a controller as it is, and a law fed with what is observed."""
    return Feedback(scene, made) if isinstance(made, Law) else made


NUMBERS = Path(__file__).parents[2] / "configs" / "controllers.json"
"""What `python -m agents tune-controllers` found for the tasks."""

Coordinate = TypeVar("Coordinate", float, Array)

MOST = 14.0  # logarithm of the largest change of a ratio, a million
MOST_BYTES = 2**20  # largest file of numbers


@dataclass(frozen=True)
class Free:
    """A free number of a controller, in units of its own."""

    first: float  # where a search begins; without one it is used as it is
    # Standard deviation of the first trials; of the number's logarithm if it is a ratio.
    spread: float = 1.0
    ratio: bool = True  # whether it is positive, and searched by its logarithm
    # low, high: limits
    low: float = -inf
    high: float = inf

    @property
    def allowed(self) -> str:
        """Its limits, in words."""
        return f"{max(self.low, 0.0) if self.ratio else self.low:g} to {self.high:g}"

    def has(self, number: float) -> bool:
        """Tell whether it can be this number."""
        return self.low <= number <= self.high and (number >= 0.0 or not self.ratio)

    def value(self, coordinate: Coordinate, start: float | None = None) -> Coordinate:
        """Return the number at a coordinate, which is 0 at the start; by default at the first.

        Arrays of coordinates give arrays.
        """
        start = self.first if start is None else start
        moved = self.spread * coordinate
        value = start * np.exp(np.minimum(moved, MOST)) if self.ratio else start + moved
        return np.clip(value, self.low, self.high)


class Found(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """What a search found for a controller of a scene."""

    numbers: dict[str, float]  # by name
    # cost, first_cost: on the validation episodes, with these numbers and with the first ones [-]
    cost: float = Field(ge=0)
    first_cost: float | None = Field(ge=0)
    # On the further validation episodes that decided between the finalists [-].
    further_cost: float = Field(ge=0)
    # trials, seed: number of designs tried, and the search's seed
    trials: int = Field(gt=0)
    seed: int = Field(ge=0)


class OfScene(BaseModel, extra="forbid", strict=True):
    """What was found for a scene: the controllers by name."""

    scene_digest: str
    controllers: dict[str, Found]


def read_found(path: Path = NUMBERS) -> dict[str, OfScene]:
    """Return what was found, by task; raise `SceneError` for a file that is not of this kind."""
    content = read_json(path, most=MOST_BYTES)
    try:
        return TypeAdapter(dict[str, OfScene]).validate_python(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        msg = f"{path}: {where}: {first['msg']}; write it: python -m agents tune-controllers"
        raise SceneError(msg) from None


@dataclass(frozen=True)
class Tunable:
    """A controller whose design has free numbers."""

    name: str  # for commands, as of its entry
    free: Callable[[Scene], Mapping[str, Free]]  # returns the free numbers of a design by name
    make: Callable[[Scene, Mapping[str, Any]], Controller | Law]  # of such numbers

    def entry(
        self,
        actuators: tuple[str, ...],
        order: int,
        role: Role = "law",
        label: str = "",
        refuses: Callable[[Scene], str | None] = lambda _: None,
    ) -> Entry:
        """Return the entry of the controller with its best numbers."""
        return Entry(self.name, actuators, self.best, order, role, label, refuses, tunable=self)

    def design(self, scene: Scene, numbers: Mapping[str, Any]) -> Controller:
        """Return the controller of such numbers; a law is fed with what is observed."""
        return fed(scene, self.make(scene, numbers))

    def first(self, scene: Scene) -> Controller:
        """Return the controller with the numbers that it is designed with before any search."""
        return self.design(scene, {name: one.first for name, one in self.free(scene).items()})

    def at(
        self, scene: Scene, coordinates: Sequence[float], start: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Return the numbers at coordinates of a search, by default one from the first numbers."""
        pairs, begun = zip(self.free(scene).items(), coordinates, strict=True), start or {}
        return {name: float(one.value(float(at), begun.get(name))) for (name, one), at in pairs}

    def best(self, scene: Scene) -> Controller:
        """Return the controller with its best numbers."""
        free, found = self.free(scene), self.numbers(scene)
        numbers = {name: chosen(partial(found.__getitem__, name)) for name in free}
        for name, one in free.items():
            if not one.has(numbers[name]):
                refuse(f"{self.name}.{name}", f"{numbers[name]:g}", one.allowed, DesignError)
        return self.design(scene, numbers)

    def numbers(self, scene: Scene) -> dict[str, float]:
        """Return the numbers found for the scene, else the first ones.

        Numbers of another design, with other names, are not used.
        """
        free = self.free(scene)
        for known in read_found().values():
            found = known.controllers.get(self.name)
            if found is None or known.scene_digest != scene.digest:
                continue
            if set(found.numbers) == set(free):
                return found.numbers
        return {name: one.first for name, one in free.items()}

    def near(self, scene: Scene, spread: float, generator: np.random.Generator) -> Controller:
        """Return the controller with numbers drawn around its best ones.

        The spread is over that of a search's first trials.
        """
        numbers = self.numbers(scene)
        drawn = spread * generator.standard_normal(len(numbers))
        return self.design(scene, self.at(scene, drawn, numbers))


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


def regulator_entry(
    name: str,
    actuators: tuple[str, ...],
    made: Callable[[Scene], Controller | Law],
    order: int,
    role: Role = "law",
    *,
    label: str,
) -> Entry:
    """Return the entry of a regulator of the force; where it has none, tables tell the reason."""
    return Entry(name, actuators, made, order, role, label, without_weight, told=True)


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
