"""Sweeps: trainings of tasks, algorithms, settings and seeds, each a run folder of its own."""

from __future__ import annotations

import itertools
import json
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, JsonValue, Strict

from agents.evaluation.episodes import evaluate
from agents.policies import load_policy
from agents.training.algorithm_settings import Algorithm, Count  # noqa: TC001 - pydantic reads them
from agents.training.config import Changes, TrainSettings, short_name
from agents.training.parts import make_parts
from agents.training.runs import Run
from mm_gym import SceneError
from mm_gym.files import write_csv, write_text
from mm_gym.scene import Part

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

EPISODES = 100
"""Held-out episodes on which each policy is scored."""

COLUMNS = ("task", "algorithm", "variant", "seed", "steps", "validation", "cost")
"""Of ``results.csv``; the last two are costs [-], on the validation and the held-out episodes."""


class SweepSettings(Part):
    """The trainings of a sweep: every task with every algorithm, variant and seed."""

    name: str = "sweep"
    """folder under `runs`, with a folder for each training"""
    tasks: Annotated[tuple[str, ...], Strict(False), Field(min_length=1)] = ("PreStretch",)
    """registered ids, of which ``mm_gym/`` and ``-v0`` may be left out"""
    algorithms: Annotated[tuple[Algorithm, ...], Strict(False), Field(min_length=1)] = ("ppo",)
    """as for agents.train"""
    seeds: Count = 1
    """each training is done with the seeds 0, 1, ... below"""
    settings: Changes = Field(default_factory=dict[str, JsonValue])
    """settings of agents.train that all have in common, by dotted name: '{"ppo.epochs": 4}'"""
    variants: Changes = Field(default_factory=lambda: dict[str, JsonValue]({"plain": {}}))
    """for each name the settings in which it differs, by dotted name"""
    processes: Count | None = None
    """trainings at once; by default one for each processor"""
    ray: str | None = None
    """train on a Ray cluster: its address, or none to begin one on this machine"""

    def trials(self) -> list[TrainSettings]:
        """Return the settings of each training, its name the folder in that of the sweep.

        Raises
        ------
        SceneError
            If a setting is wrong; the message names the training.
        """
        choices = itertools.product(self.tasks, self.algorithms, self.variants, range(self.seeds))
        return [self._trial(*choice) for choice in choices]

    def _trial(self, task: str, algorithm: Algorithm, variant: str, seed: int) -> TrainSettings:
        own = self.variants[variant]
        if not isinstance(own, dict):
            msg = f"variants.{variant}: got {own!r}; allowed: a table of settings"
            raise SceneError(msg)
        short = short_name(task)
        name = f"{short}-{algorithm}-{variant}-{seed}"
        data = _nested({**self.settings, **own})
        fixed = {"task": f"mm_gym/{short}-v0", "algorithm": algorithm, "seed": seed, "name": name}
        try:
            return TrainSettings.of({**data, **fixed})
        except SceneError as error:
            msg = "\n".join(f"{name}: {line}" for line in str(error).splitlines())
            raise SceneError(msg) from None


def _nested(settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """Return settings by dotted name as tables in tables."""
    nested: dict[str, JsonValue] = {}
    for name, value in settings.items():
        table, (*path, last) = nested, name.split(".")
        for word in path:
            inner = table.setdefault(word, {})
            if not isinstance(inner, dict):
                msg = f"settings: {name} and {word} exclude each other"
                raise SceneError(msg)
            table = inner
        old = table.get(last)
        table[last] = (
            {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
        )
    return nested


def do_trial(text: str, folder: str | Path) -> None:
    """Train, or go on where a killed training was, and score the policy; done before, do nothing.

    Parameters
    ----------
    text
        The settings as JSON, which any process can be sent.
    folder
        The sweep's folder.
    """
    from agents.training.reinforcement import train  # noqa: PLC0415 - torch, of the workers alone

    settings = TrainSettings.of(json.loads(text))
    run = Run(settings.name, folder)
    if not result_file(run).exists():
        train(settings, run, bar=False)
        parts = make_parts(settings)
        agent = parts.controller(load_policy(run.policy))
        scored = evaluate(parts.scene, agent, episodes=EPISODES, rewards_of=parts.rewards_of)
        write_text(result_file(run), json.dumps({"cost": scored.cost}) + "\n")


def result_file(run: Run) -> Path:
    """Return the path of the file with a training's score."""
    return run.folder / "result.json"


def write_results(trials: Iterable[TrainSettings], folder: Path) -> Path:
    """Write ``results.csv``, a row for each training that is done, in the order of the sweep."""
    rows: list[tuple[object, ...]] = []
    for trial in trials:
        run = Run(trial.name, folder)
        if not result_file(run).exists():
            continue
        steps, costs = _validations(run)
        cost = json.loads(result_file(run).read_text("utf-8"))["cost"]
        variant = trial.name.split("-", 2)[2].rpartition("-")[0]
        rows.append(
            (short_name(trial.task), trial.algorithm, variant, trial.seed, steps, min(costs), cost)
        )
    path = folder / "results.csv"
    write_csv(path, COLUMNS, list(zip(*rows, strict=True)) or [[]] * len(COLUMNS))
    return path


def _validations(run: Run) -> tuple[float, list[float]]:
    """Return the steps of the last validation, and the costs of all."""
    lines = run.metrics.read_text("utf-8").splitlines()[1:]
    pairs = [tuple(map(float, line.split(","))) for line in lines]
    return pairs[-1][0], [cost for _, cost in pairs]
