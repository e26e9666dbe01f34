"""Sweeps: trainings of tasks, algorithms, settings and seeds, each a run folder of its own."""

import itertools
import json
import os
from collections.abc import Iterable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Literal, Self, TypeAlias, get_args

from pydantic import BaseModel, Field, JsonValue, Strict, model_validator
from tyro.constructors import PrimitiveConstructorSpec

from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.scoring import evaluate
from agents.training.config import (
    Algorithm,
    Changes,
    Count,
    RunSettings,
    TrainSettings,
    check_folder_name,
    good_settings,
    short_name,
)
from agents.training.parts import agent_of, recorded_parts
from agents.training.runs import Run, RunError, by_dotted_name, differences, few, read_as
from agents.value_iteration.iteration import IterateSettings, iterate
from mm_gym import SceneError
from mm_gym.errors import check_name, refuse
from mm_gym.files import write_csv, write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids, robust_ids

Learner: TypeAlias = Literal[
    "evolution",
    "gradient",
    "recurrent",
    "value_iteration",
    "evolved_residual",
    "residual",
    Algorithm,
]

FIXED = {"task": "tasks", "algorithm": "algorithms", "seed": "seeds", "name": "name"}
"""Settings of a training that its sweep makes, and of what."""

LEARNERS: tuple[Learner, ...] = get_args(Learner)  # those of `Algorithm` last

SEARCHES = {
    "evolution": (EvolveSettings, evolve),
    "gradient": (GradientSettings, descend),
    "recurrent": (GradientSettings, descend),
    "evolved_residual": (EvolveSettings, evolve),
    "value_iteration": (IterateSettings, iterate),
}
"""The searches by agents' own algorithms: their settings, and what runs them. All others are those
of the command train."""

RESIDUAL = "residual"
"""PPO with settings of its own, such as the law to which it is added; "recurrent" and
"evolved_residual" have theirs too."""

EPISODES = 100  # held-out episodes on which each policy is scored

COLUMNS = ("task", "algorithm", "variant", "seed", "steps", "validation", "cost")
"""Of ``results.csv``; the last two are costs [-], on the validation and the held-out episodes."""

HERE = "none"  # what ``--ray`` alone stands for

Address = Annotated[
    str | None,
    PrimitiveConstructorSpec(
        nargs=(0, 1),
        metavar="[ADDRESS]",
        instance_from_str=lambda texts: texts[0] if texts else HERE,
        is_instance=lambda value: value is None or isinstance(value, str),
        str_from_instance=lambda value: [str(value)],
    ),
]


class Score(BaseModel, strict=True, allow_inf_nan=False):
    """What ``result.json`` holds: costs on the held-out episodes [-]."""

    cost: float
    episodes: list[float]  # of each
    # The mean over them of the energy that changing the stretch put in [J], if it is actuated.
    injected: float | None
    # The settings that were asked for; of an own scene, those of the record are measured.
    asked: dict[str, JsonValue] | None = None


class SweepSettings(Document):
    """The trainings of a sweep: every task with every algorithm, variant and seed."""

    name: str = "sweep"
    """folder under `runs`, with a folder for each training"""
    tasks: Annotated[tuple[str, ...], Strict(False), Field(min_length=1)] = ("PreStretch",)
    """registered ids, of which ``mm_gym/`` and ``-v0`` may be left out"""
    algorithms: Annotated[tuple[Learner, ...], Strict(False), Field(min_length=1)] = ("ppo",)
    """those of the command train; evolution, gradient and value_iteration, which are the commands
    evolve, descend and iterate; recurrent, residual and evolved_residual, which are gradient, ppo
    and evolution with settings of their own"""
    seeds: Count = 1
    """trainings of each kind, with the seeds 0, 1, ..."""
    settings: Changes = Field(default_factory=dict[str, JsonValue])
    """settings of all trainings, by dotted name: '{"scene": "my.toml"}'; those of one algorithm
    begin with its name, such as "ppo.epochs" or "evolution.hidden"; they override the defaults and
    the file in configs/gradient; a setting that an algorithm of the sweep does not have is
    refused"""
    algorithm_settings: Changes = Field(default_factory=dict[str, JsonValue])
    """for each algorithm the settings in which it differs, by dotted name"""
    task_settings: Changes = Field(default_factory=dict[str, JsonValue])
    """for each task's short name the settings in which it differs, by dotted name"""
    variants: Changes = Field(default_factory=lambda: dict[str, JsonValue]({"plain": {}}))
    """for each name the settings in which it differs, by dotted name"""
    processes: Count | None = None
    """trainings at once; by default one for each processor"""
    ray: Address = None
    """train on a Ray cluster: its address, or none to start one on this machine"""

    @model_validator(mode="after")
    def _has_own_folders(self) -> Self:
        check_folder_name(self.name)
        for what, given in (
            ("tasks", [*map(short_name, self.tasks)]),
            ("algorithms", self.algorithms),
        ):
            for one in given:
                if given.count(one) > 1:
                    refuse(what, f"{one!r} twice", "each once", ValueError)
        if not self.variants:
            refuse(
                "variants", "none", "one or more tables of settings, each by its name", ValueError
            )
        return self

    def trials(self) -> list[RunSettings]:
        """Return the settings of each training, its name the folder in that of the sweep.

        Raise `SceneError` if a setting is wrong; the message names the training.
        """
        tasks = [short_name(task) for task in self.tasks]
        known = [short_name(task) for task in (*ids(), *robust_ids())]
        for task in self.task_settings:
            check_name("task_settings", task, known)
        for algorithm in self.algorithm_settings:
            check_name("algorithm_settings", algorithm, LEARNERS)
        choices = itertools.product(tasks, self.algorithms, self.variants, range(self.seeds))
        trials = [self._trial(*choice) for choice in choices]
        check_scenes(trials)
        return trials

    def _trial(self, task: str, algorithm: Learner, variant: str, seed: int) -> RunSettings:
        name = f"{task}-{algorithm}-{variant}-{seed}"
        tables = (
            self.settings,
            _table({algorithm: {}} | self.algorithm_settings, algorithm, "algorithm_settings"),
            _table({task: {}} | self.task_settings, task, "task_settings"),
            _table(self.variants, variant, "variants"),
        )
        data = _nested(item for table in tables for item in table.items())
        own = {learner: data.pop(learner, {}) for learner in (*SEARCHES, RESIDUAL)}
        fixed: dict[str, JsonValue] = {"task": f"mm_gym/{task}-v0", "seed": seed, "name": name}
        try:
            if algorithm in own:
                data = _nested([*data.items(), *_table(own, algorithm).items()])
            if algorithm not in SEARCHES:
                _check_settings(algorithm, TrainSettings, data)
                data |= fixed | {"algorithm": "ppo" if algorithm == RESIDUAL else algorithm}
                unused = TrainSettings.of(data).unused
                return TrainSettings.of({k: v for k, v in data.items() if k not in unused})
            kind, _ = SEARCHES[algorithm]
            table = {key: value for key, value in data.items() if key not in LEARNERS}
            _check_settings(algorithm, kind, table)
            alone = {"threads": 1} if "threads" in kind.model_fields else {}
            good: dict[str, JsonValue] = {}
            if not table.keys() & kind.fitted:  # known to be good for the task, without defaults
                good = good_settings(f"mm_gym/{task}-v0", kind).model_dump(exclude_unset=True)
            settings = kind.of({**alone, **good, **table, **fixed})
            settings.refuse_unused(table)
        except SceneError as error:
            msg = "\n".join(f"{name}: {line}" for line in str(error).splitlines())
            raise SceneError(msg) from None
        return settings


def _check_settings(
    algorithm: str, kind: type[RunSettings], table: Mapping[str, JsonValue]
) -> None:
    """Refuse settings that only other algorithms have, and those that the sweep itself makes."""
    for name in table:
        if name in FIXED:
            msg = f"{name}: made by the sweep, from its {FIXED[name]}"
            raise SceneError(msg)
        having = [other for other in LEARNERS if name in _kind(other).model_fields]
        if having and name not in kind.model_fields:
            msg = (
                f"{name}: {algorithm} has no such setting; state it in the table "
                f"algorithm_settings.NAME of those that have it; allowed: {', '.join(having)}"
            )
            raise SceneError(msg)


def _kind(algorithm: str) -> type[RunSettings]:
    return SEARCHES[algorithm][0] if algorithm in SEARCHES else TrainSettings


def check_scenes(trials: Iterable[RunSettings], folder: Path | None = None) -> None:
    """Refuse a sweep that would compare trainings on different scenes.

    Trainings of one task and one variant have to have the same scene. With the sweep's folder, the
    scene of a run there is that of its record. Raise `SceneError` if a scene differs, or cannot be
    read; the message names the trainings; `RunError` if a run's record cannot be read.
    """
    scenes: dict[str, str] = {}
    first: dict[tuple[str, str], tuple[str, str]] = {}
    for trial in trials:
        place = trial.model_dump_json(include={"task", "scene", "changes"})
        run = None if folder is None else Run(trial.name, folder)
        if run is not None and os.path.lexists(run.record):
            digest = run.read()["scene_digest"]
        elif place in scenes:
            digest = scenes[place]
        else:
            try:
                digest = scenes[place] = trial.load_scene().digest
            except SceneError as error:
                msg = "\n".join(f"{trial.name}: {line}" for line in str(error).splitlines())
                raise SceneError(msg) from None
        name, other = first.setdefault((trial.task, variant_of(trial)), (trial.name, digest))
        if other != digest:
            msg = (
                f"scene: that of {trial.name} is not that of {name}; allowed: the same for all "
                "trainings of a task and a variant; begin another sweep with --name, or state "
                "the difference in [variants]"
            )
            raise SceneError(msg)


def _table(
    tables: Mapping[str, JsonValue], name: str, what: str = "settings"
) -> dict[str, JsonValue]:
    """Return one of several tables of settings; refuse what is none."""
    own = tables[name]
    if not isinstance(own, dict):
        refuse(f"{what}.{name}", f"{own!r}", "a table of settings")
    return own


def _nested(settings: Iterable[tuple[str, JsonValue]]) -> dict[str, JsonValue]:
    """Return settings by dotted name as tables in tables; the later of two goes over the other."""
    nested: dict[str, JsonValue] = {}
    for name, value in settings:
        table, (*path, last) = nested, name.split(".")
        for word in path:
            inner = table.setdefault(word, {})
            if not isinstance(inner, dict):
                msg = f"settings: {name} and {word} exclude each other"
                raise SceneError(msg)
            table = inner
        old = table.get(last)
        if isinstance(old, dict) and isinstance(value, dict):
            table[last] = {**old, **value}
        else:
            table[last] = deepcopy(value)  # the next name may go into it
    return nested


def do_trial(text: str, folder: str | Path) -> None:
    """Train, or go on where a killed training was, and score the policy; done before, do nothing.

    The settings are JSON, which any process can be sent.
    """
    data = json.loads(text)
    settings = _kind(_words(data["name"])[1]).of(data)
    run = Run(settings.name, folder)
    if not result_file(run).exists():
        write_text(result_file(run), _scored_training(settings, run).model_dump_json() + "\n")


def _scored_training(settings: RunSettings, run: Run) -> Score:
    """Train, and return what the run stands for scores on the held-out episodes."""
    if isinstance(settings, TrainSettings):
        from agents.training.reinforcement import train  # noqa: PLC0415 - torch, of workers alone

        train(settings, run, bar=False)
    else:
        _, search = SEARCHES[algorithm_of(settings)]
        search(settings, run, bar=False)
    parts = recorded_parts(settings.load_scene(), run.read(), trust=True)
    found = evaluate(parts.scene, agent_of(run, parts), episodes=EPISODES)
    return Score(
        cost=found.cost,
        episodes=found.episode_costs.tolist(),
        injected=found.mean_injected,
        asked=_written(settings),
    )


def check_settings(trial: RunSettings, run: Run) -> None:
    """Refuse a finished training of other settings than are asked for.

    Those of algorithms other than the training's make no difference. What an earlier version
    scored has kept no settings: those of its record are compared, unless the scene is one's own.
    Raise `RunError` if a setting differs, or a file is damaged.
    """
    asked = read_score(run).asked
    if asked is None:
        if trial.scene is not None:
            return
        asked = run.read()["settings"]
    # A setting that there was not yet had its default.
    before = by_dotted_name(_written(type(trial)())) | by_dotted_name(asked)
    other = differences(before, by_dotted_name(_written(trial)), trial.unused)
    if other:
        msg = (
            f"{run.folder}: holds a finished training with other settings ({few(other)}); "
            "allowed: the same; begin another sweep with --name, or move the folder away"
        )
        raise RunError(msg)


def _written(settings: RunSettings) -> dict[str, JsonValue]:
    return json.loads(settings.model_dump_json())


def variant_of(trial: RunSettings) -> str:
    """Return the variant of a training of a sweep, by its name."""
    return _words(trial.name)[2].rpartition("-")[0]


def algorithm_of(trial: RunSettings) -> str:
    """Return the algorithm of a training of a sweep, by its name."""
    return _words(trial.name)[1]


def _words(name: str) -> list[str]:
    """Return task, algorithm, and variant with seed, from TASK-ALGORITHM-VARIANT-SEED."""
    return name.split("-", 2)


def result_file(run: Run) -> Path:
    """Return the path of the file with a training's score."""
    return run.folder / "result.json"


def read_score(run: Run) -> Score:
    """Return a training's score; raise `RunError` if its file has none."""
    return read_as(Score, result_file(run), "a training's score")


def write_results(trials: Iterable[RunSettings], folder: Path) -> Path:
    """Write ``results.csv``, a row for each training that is done, in the order of the sweep.

    Raise `SceneError` if trainings that are compared had different scenes; see `check_scenes`;
    `RunError`, once the others are written, if a run's files are damaged.
    """
    rows: list[tuple[object, ...]] = []
    damaged: list[str] = []
    done = [trial for trial in trials if result_file(Run(trial.name, folder)).exists()]
    check_scenes(done, folder)
    for trial in done:
        run = Run(trial.name, folder)
        try:
            steps, costs, _ = run.validations()
            cost = read_score(run).cost
        except RunError as error:
            damaged.append(str(error))
            continue
        rows.append(
            (
                *(short_name(trial.task), algorithm_of(trial), variant_of(trial), trial.seed),
                *(steps[-1], costs.min(), cost),
            )
        )
    path = folder / "results.csv"
    write_csv(path, COLUMNS, list(zip(*rows, strict=True)) or [[]] * len(COLUMNS))
    if damaged:
        raise RunError("\n".join(damaged))
    return path
