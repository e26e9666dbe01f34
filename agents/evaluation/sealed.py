"""Sealed episodes: those of a release, on which nothing was tuned, trained or chosen."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, JsonValue

from agents.control.controller import Controller
from agents.controllers.constant import best_constant
from agents.evaluation.aggregates import shared_episodes
from agents.evaluation.headroom import (
    CLASSICAL,
    MOST_BYTES,
    SCORES,
    Cost,
    Row,
    controllers_of,
    interval,
)
from agents.network.files import content_of, read_content
from agents.scoring import VALIDATION_SEED, evaluate, written
from agents.training.runs import checked
from mm_gym import DesignError, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.files import read_bytes, read_json, write_bytes

EPISODES = 1_000  # of a task and a release

SEALED = 1 << 62
"""The bit that the seeds of sealed episodes have; those of all other episodes do not."""

FILE = SCORES.with_name("sealed_scores.json")

AGENT = "agent"  # role of what was trained
LARGEST = 2**28  # size of a file of penalties [bytes]


def first_seed(release: str) -> int:
    """Return the seed of the first sealed episode of a release; the others count up from it.

    It follows from the release's name by SHA-256, so that nobody chooses it, and nobody draws these
    episodes before the release has its name.
    """
    drawn = int.from_bytes(hashlib.sha256(f"mm_gym {release}".encode()).digest()[:4], "big")
    return SEALED | drawn << 24


@dataclass(frozen=True, eq=False)
class Scored:
    """What was scored on a task."""

    # name, role: of the controller, or of several trainings of one kind
    name: str
    role: str
    # (seeds, episodes) as in `agents.scoring.Evaluation`, of the same episodes.
    penalties: Array

    @property
    def cost(self) -> float:
        """The interquartile mean of the seeds' costs [-]."""
        return shared_episodes(self.penalties).value

    def row(self) -> Row:
        """Return the row of the table: the cost with its 95 % interval, and its worst seed.

        The interval is for other episodes, and of several seeds for other seeds too; one seed says
        nothing of others.
        """
        found = shared_episodes(self.penalties)
        ends = found[1:] if len(self.penalties) > 1 else interval(self.penalties[0])
        costs = np.sqrt(self.penalties.mean(axis=1))
        told = {"controller": self.name, "role": self.role, "seeds": len(self.penalties)}
        values = found.value, *ends, costs.max()
        return told | written(dict(zip(("cost", "low", "high", "worst"), values, strict=True)))

    def over(self, other: Scored) -> Row:
        """Return the ratio of the costs of this and another controller, with its 95 % interval."""
        found = shared_episodes(self.penalties, other.penalties[0])
        finite = {name: value for name, value in found._asdict().items() if np.isfinite(value)}
        return {"agent": self.name, "over": other.name} | written(finite)


class SealedRow(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """A row of `SealedTask`."""

    controller: str
    role: str
    seeds: int
    cost: Cost
    low: Cost
    high: Cost
    worst: Cost


class SealedTask(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What is known of a task."""

    scene_digest: str
    rows: list[SealedRow]
    compared: list[dict[str, JsonValue]]


class SealedScores(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What ``docs/sealed_scores.json`` holds."""

    release: str
    tasks: dict[str, SealedTask]


def read_sealed(file: Path = FILE) -> dict[str, Any]:
    """Return the release that was scored, and its tasks, as data of `SealedScores`.

    There are none without the file. Raise `SceneError` if it cannot be read, or is damaged.
    """
    if not os.path.lexists(file):
        return {"release": "", "tasks": {}}
    scores: Any = read_json(file, most=MOST_BYTES)
    checked(SealedScores, scores, file, "a file of sealed scores")
    return scores


def mark_again(rows: Sequence[Row], known: Sequence[Row]) -> None:
    """Mark the rows of a task that its earlier scores of this release lack; marks are kept.

    Such a controller was changed or added after the task had been scored.
    """
    scored = {(row["controller"], row["cost"]): row.get("again", False) for row in known}
    for row in rows:
        if scored.get((row["controller"], row["cost"]), True):
            row["again"] = True


class Seal:
    """The penalties on a task's sealed episodes, in a file that is written after each controller.

    What is in the file is not scored again: sealed episodes are scored once. Raise `SceneError` if
    the file is damaged, or of other episodes.
    """

    def __init__(self, file: Path, scene: Scene, release: str, episodes: int = EPISODES) -> None:
        self.file, self.scene, self.seed = file, scene, first_seed(release)
        self._is_of = {"scene": scene.digest, "release": release, "episodes": episodes}
        self.episodes = episodes
        self.scored = self._read() if os.path.lexists(file) else {}

    def _read(self) -> dict[str, Scored]:
        try:
            told, arrays = read_content(read_bytes(self.file, most=LARGEST))
            roles = told.pop("roles")
            found = {name: Scored(name, roles[name], array) for name, array in arrays.items()}
            shapes = {one.penalties.shape[1:] for one in found.values()}
        except (ValueError, KeyError, TypeError) as error:
            msg = f"{self.file}: not a file of sealed penalties: {error}"
            raise SceneError(msg) from None
        if told != self._is_of or shapes != {(self.episodes,)}:
            refuse(f"{self.file}", json.dumps(told), json.dumps(self._is_of))
        return found

    def score(self, name: str, role: str, controllers: Sequence[Controller]) -> None:
        """Score controllers, one or a training's seeds, and write the file."""
        found = [
            evaluate(self.scene, one, seed=self.seed, episodes=self.episodes).penalties
            for one in controllers
        ]
        self._read_again()
        self.scored[name] = Scored(name, role, np.array(found))
        roles = {one.name: one.role for one in self.scored.values()}
        arrays = {one.name: one.penalties for one in self.scored.values()}
        write_bytes(self.file, content_of(self._is_of | {"roles": roles}, arrays))

    def _read_again(self) -> None:
        """Take over what others have written since."""
        if os.path.lexists(self.file):
            self.scored |= self._read()

    def summary(self, controllers: Container[str]) -> Row:
        """Return the rows, least cost first, and how agents compare with the best of the others.

        Both are the best on these very episodes, the agent and the controller alike. The rows are
        of these controllers and all agents: what an earlier version had is not told.
        """
        self._read_again()
        every = sorted(self.scored.values(), key=lambda one: one.cost)
        found = [one for one in every if one.role == AGENT or one.name in controllers]
        rows, agents = [one.row() for one in found], [one for one in found if one.role == AGENT]
        others = [one for one in found if one.role in CLASSICAL]
        compared = [agent.over(other) for agent in agents[:1] for other in others[:1]]
        return {"scene_digest": self.scene.digest, "rows": rows, "compared": compared}


def fixed_and_classical(scene: Scene) -> Iterator[tuple[str, Controller]]:
    """Yield what an agent is compared with, each behind its role.

    The best constant is that of the validation episodes, as all that is tuned.
    """
    for role, controller in controllers_of(scene):
        if role in {"zero", *CLASSICAL}:
            yield role, controller
    try:
        yield "constant", best_constant(scene, VALIDATION_SEED)
    except DesignError:
        return
