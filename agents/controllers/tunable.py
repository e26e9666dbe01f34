"""Controllers with free numbers, and the numbers that a search found for each scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from mm_gym import SceneError
from mm_gym.files import read_json

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from mm_gym import Scene

NUMBERS = Path(__file__).parents[2] / "configs" / "controllers.json"
"""What `python -m agents tune-controllers` found for the tasks."""

Coordinate = TypeVar("Coordinate", float, "NDArray[np.float64]")

MOST = 14.0
"""Logarithm of the largest change of a ratio, a million."""

MOST_BYTES = 2**20
"""Largest file of numbers."""


@dataclass(frozen=True)
class Free:
    """A free number of a controller, in units of its own.

    Attributes
    ----------
    first
        Where a search begins; without one it is used as it is.
    spread
        Standard deviation of the first trials; of the number's logarithm if it is a ratio.
    ratio
        Whether it is positive, and searched by its logarithm.
    low, high
        Limits.
    """

    first: float
    spread: float = 1.0
    ratio: bool = True
    low: float = -inf
    high: float = inf

    def value(self, coordinate: Coordinate, start: float | None = None) -> Coordinate:
        """Return the number at a coordinate, which is 0 at the start; by default at the first.

        Arrays of coordinates give arrays.
        """
        start = self.first if start is None else start
        moved = self.spread * coordinate
        value = start * np.exp(np.minimum(moved, MOST)) if self.ratio else start + moved
        return np.clip(value, self.low, self.high)


class Found(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """What a search found for a controller of a scene.

    Attributes
    ----------
    numbers
        By name.
    cost, first_cost
        On the validation episodes, with these numbers and with the first ones [-].
    further_cost
        On the further validation episodes that decided between the finalists [-].
    trials, seed
        Number of designs tried, and the search's seed.
    """

    numbers: dict[str, float]
    cost: float = Field(ge=0)
    first_cost: float | None = Field(ge=0)
    further_cost: float = Field(ge=0)
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
    """A controller whose design has free numbers.

    Attributes
    ----------
    name
        For commands, as of its entry.
    free
        Returns the free numbers of a scene's design by name.
    design
        Makes the controller of such numbers.
    by_lane
        Numbers that the design also takes as arrays (lanes,): other ones in each episode.
    """

    name: str
    free: Callable[[Scene], Mapping[str, Free]]
    design: Callable[[Scene, Mapping[str, Any]], Controller]
    by_lane: frozenset[str] = frozenset()

    def first(self, scene: Scene) -> Controller:
        """Return the controller with the numbers that it is designed with before any search."""
        return self.design(scene, {name: one.first for name, one in self.free(scene).items()})

    def at(self, scene: Scene, coordinates: Sequence[float]) -> dict[str, float]:
        """Return the numbers at coordinates of a search."""
        pairs = zip(self.free(scene).items(), coordinates, strict=True)
        return {name: float(one.value(float(coordinate))) for (name, one), coordinate in pairs}

    def best(self, scene: Scene) -> Controller:
        """Return the controller with its best numbers."""
        return self.design(scene, self.numbers(scene))

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
        pairs, numbers = self.free(scene).items(), self.numbers(scene)
        drawn = spread * generator.standard_normal(len(numbers))
        moved = {
            name: float(one.value(float(z), numbers[name]))
            for (name, one), z in zip(pairs, drawn, strict=True)
        }
        return self.design(scene, moved)
