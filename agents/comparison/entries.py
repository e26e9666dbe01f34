"""The episodes of a comparison, and the controllers that go through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.baselines import Baselines, baselines, best_constant
from agents.evaluation.episodes import HELD_OUT_SEED, VALIDATION_SEED, evaluate
from mm_gym import DesignError, SceneError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from agents.comparison.contestants import Field
    from agents.controllers.controller import Controller
    from mm_gym import Scene

SEEDS, EACH = 5, 64
"""Seeds and episodes of each where none are asked for."""

LEAST = 2
"""Least number of episodes of a seed."""


@dataclass(frozen=True)
class Episodes:
    """The episodes that all controllers go through.

    Attributes
    ----------
    seeds, each
        Number of seeds, and of episodes of each.
    first
        Seed of the first episode; the others count up from it.
    """

    seeds: int
    each: int
    first: int = HELD_OUT_SEED

    @classmethod
    def of_field(
        cls, field: Field, seeds: int | None, each: int | None, *, first: int = HELD_OUT_SEED
    ) -> Episodes:
        """Return the episodes to compare in; raise `SceneError` for numbers that do not fit."""
        trainings = field.trainings
        seeds = (trainings if trainings > 1 else SEEDS) if seeds is None else seeds
        each = EACH if each is None else each
        if seeds < 1 or (trainings > 1 and seeds != trainings):
            allowed = "at least 1" if trainings == 1 else f"{trainings}, as many as there are runs"
            msg = f"--seeds: got {seeds}; allowed: {allowed}"
            raise SceneError(msg)
        if each < LEAST:
            msg = f"--episodes: got {each}; allowed: at least {LEAST}, to estimate their scatter"
            raise SceneError(msg)
        last = VALIDATION_SEED - seeds * each
        if not HELD_OUT_SEED <= first <= last:
            allowed = f"{HELD_OUT_SEED} to {last}: laws are tuned, and agents trained, on others"
            msg = f"--first-seed: got {first} for {seeds} x {each} episodes; allowed: {allowed}"
            raise SceneError(msg)
        return cls(seeds, each, first)

    def of(self, number: int) -> Episodes:
        """Return the episodes of one of the seeds alone."""
        return Episodes(1, self.each, self.first + number * self.each)


@dataclass(frozen=True)
class Entry:
    """A row of a task: its label, and one controller, or one for each seed."""

    label: str
    controllers: Sequence[Controller]
    classical: bool = False
    """Whether it is one of the baselines."""

    @property
    def trained(self) -> bool:
        """Whether each seed is a training of its own."""
        return len(self.controllers) > 1

    def penalties(self, scene: Scene, episodes: Episodes) -> NDArray[np.float64]:
        """Return the penalties (seeds, episodes) of the episodes."""
        if not self.trained:
            return penalties(scene, self.controllers[0], episodes)
        own = [
            penalties(scene, controller, episodes.of(number))
            for number, controller in enumerate(self.controllers)
        ]
        return np.concatenate(own)


def penalties(scene: Scene, controller: Controller, episodes: Episodes) -> NDArray[np.float64]:
    """Return the penalties (seeds, episodes) of one controller, all episodes side by side."""
    seeds, each = episodes.seeds, episodes.each
    result = evaluate(scene, controller, seed=episodes.first, episodes=seeds * each, blocks=seeds)
    return result.penalties.reshape(seeds, each)


def entries(field: Field, task: str) -> tuple[list[Entry], dict[str, str]]:
    """Return the rows of a task, the best constant first, and why others cannot be designed."""
    scene = field.scenes[task]
    made, not_scored = baselines(scene) if field.baselines else Baselines([], {})
    constant = made.pop(0) if made and scene.actuation.stretch is not None else best_constant(scene)
    rows = [Entry("best constant", [constant])]
    rows += [Entry(controller.name, [controller], classical=True) for controller in made]
    for one in field.contestants:
        try:
            if task in one.texts:
                rows.append(Entry(one.label, one.make(task, scene)))
        except DesignError as error:
            not_scored[one.label] = str(error)
    return rows, not_scored


def best_classical(scene: Scene, rows: Sequence[Entry]) -> int | None:
    """Return the classical law that does best on the validation episodes, of those that observe."""
    laws = [k for k, row in enumerate(rows) if row.classical]
    laws = [k for k in laws if rows[k].controllers[0].reads == "observation"]
    return min(laws, key=lambda k: validation_cost(scene, rows[k].controllers[0]), default=None)


def validation_cost(scene: Scene, controller: Controller) -> float:
    """Return the cost on the episodes that laws are tuned on."""
    return evaluate(scene, controller, seed=VALIDATION_SEED, episodes=100).cost
