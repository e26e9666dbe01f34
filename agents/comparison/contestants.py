"""What is compared: laws by name, runs, patterns of runs, files of policies, the user's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.user_defined import user_defined
from agents.evaluation.laws import laws
from agents.policies import load_policy
from agents.recording.laws import law_of
from agents.training.runs import Run, RunError
from agents.user_code import is_path
from mm_gym import SceneError, load_scene
from mm_gym.errors import suggest
from mm_gym.tasks import ids, task_or_scene

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from agents.controllers.controller import Controller
    from mm_gym import Scene

BASELINES = "baselines"
"""The name of all classical controllers that apply to a task."""


@dataclass(frozen=True)
class Contestant:
    """What stands in one row of the tables.

    Attributes
    ----------
    label
        Its name there.
    texts
        Task -> what makes its controllers: names that `law_of` takes, or FILE.py:NAME. Several are
        runs of one training with several seeds.
    """

    label: str
    texts: Mapping[str, tuple[str, ...]]

    def make(self, task: str, scene: Scene) -> list[Controller]:
        """Return its controllers for a task: one, or one for each seed."""
        made: list[Controller] = []
        for text in self.texts[task]:
            if is_path(text):
                made.append(user_defined(text, scene)[-1])
            else:
                made.append(law_of(text, scene, np.random.default_rng(0)))
        return made


@dataclass(frozen=True)
class Field:
    """All that is compared.

    Attributes
    ----------
    scenes
        Task -> scene.
    contestants
        In the order in which they were given.
    baselines
        Whether all classical controllers of each task are compared too.
    """

    scenes: Mapping[str, Scene]
    contestants: tuple[Contestant, ...]
    baselines: bool

    @property
    def trainings(self) -> int:
        """Number of seeds of the trainings that have several, else 1."""
        counts = (len(texts) for one in self.contestants for texts in one.texts.values())
        return max(counts, default=1)


def read_field(texts: Sequence[str], tasks: Sequence[str] = ()) -> Field:
    """Return what texts name: contestants, on the given tasks or else on those of the runs.

    Without tasks and runs it is all tasks of mm_gym.

    Raises
    ------
    SceneError
        If a name is unknown or given twice, or applies to none of the tasks.
    RunError
        If a run is missing or not over, is of another task or scene, or patterns of runs have
        different numbers of them.
    PolicyError
        If a file is no policy.
    """
    twice = [text for text in texts if list(texts).count(text) > 1]
    if twice:
        msg = f"{twice[0]}: given twice; allowed: once"
        raise SceneError(msg)
    runs = {text: finished_runs(text) for text in texts if _may_be_runs(text)}
    tasks = [task_or_scene(task) for task in tasks]
    if not tasks:
        own = {task: None for of_task in runs.values() for task in of_task}
        tasks = [name for name in ids() if name in own] or list(own) or ids()
    scenes = {task: load_scene(task) for task in tasks}
    named = [text for text in texts if text != BASELINES]
    found = [
        _trained(text, runs[text], scenes) if text in runs else _named(text, scenes)
        for text in named
    ]
    counts = {one.label: {len(texts) for texts in one.texts.values()} for one in found}
    several = {label: count for label, (count, *_) in counts.items() if count > 1}
    if len(set(several.values())) > 1:
        told = ", ".join(f"{label} has {count}" for label, count in several.items())
        msg = f"seeds: got different numbers of runs ({told}); allowed: the same for all, or one"
        raise RunError(msg)
    return Field(scenes, tuple(found), baselines=BASELINES in texts)


def _may_be_runs(text: str) -> bool:
    """Tell whether a text is a path of runs, and not a name, a policy or a file of the user's."""
    if text == BASELINES or is_path(text) or text.endswith(".npz"):
        return False
    return "*" in text or "/" in text or Path(text).is_dir()


def finished_runs(text: str) -> dict[str, list[Run]]:
    """Return the runs of a folder, or of a pattern of folders, by their task.

    Raise `RunError` if there are none, or one is not over.
    """
    path = Path(text)
    folders = sorted(path.parent.glob(path.name)) if "*" in text else [path]
    folders = [folder for folder in folders if os.path.lexists(folder / "run.json")]
    if not folders:
        near = suggest(path.name, [file.name for file in path.parent.glob("*") if file.is_dir()])
        msg = f"{text}: no finished run here{near}; train first: python -m agents.train"
        raise RunError(msg)
    found: dict[str, list[Run]] = {}
    for folder in folders:
        run = Run(folder.name, folder.parent)
        if not run.finished:
            msg = f"{folder}: training is not over; continue it: python -m agents.train"
            raise RunError(msg)
        found.setdefault(run.read()["settings"]["task"], []).append(run)
    return found


def agents_of(texts: Iterable[str]) -> dict[str, list[Controller]]:
    """Return the agents of finished runs by their task; raise `RunError` for another scene."""
    found: dict[str, list[Controller]] = {}
    for text in texts:
        for task, runs in finished_runs(text).items():
            scene = load_scene(task)
            for run in runs:
                if run.read()["scene_digest"] != scene.digest:
                    msg = f"{run.folder}: trained on another scene than that of {task}"
                    raise RunError(msg)
                agent = law_of(str(run.folder), scene, np.random.default_rng(0))
                agent.name = run.folder.name
                found.setdefault(task, []).append(agent)
    return found


def _trained(
    text: str, runs: Mapping[str, Sequence[Run]], scenes: Mapping[str, Scene]
) -> Contestant:
    """Return the contestant of a run or of several; refuse what cannot stand in one table."""
    missing = [task for task in scenes if task not in runs]
    other = [task for task in runs if task not in scenes]
    if missing or other:
        msg = f"{text}: got runs of {', '.join(runs)}; allowed: of each of {', '.join(scenes)}"
        raise RunError(msg)
    counts = {task: len(of_task) for task, of_task in runs.items()}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{count} of {task}" for task, count in counts.items())
        msg = f"{text}: got {told}; allowed: the same number of runs of each task"
        raise RunError(msg)
    for task, of_task in runs.items():
        for run in of_task:
            if run.read()["scene_digest"] != scenes[task].digest:
                msg = (
                    f"{run.folder}: trained on another scene than that of {task}; score it by "
                    f"itself: python -m agents.evaluate {run.folder}"
                )
                raise RunError(msg)
    label = Path(text).name.replace("*", "").strip("-_.") or Path(text).parent.name
    texts = {task: tuple(str(run.folder) for run in runs[task]) for task in scenes}
    return Contestant(label, texts)


def _named(text: str, scenes: Mapping[str, Scene]) -> Contestant:
    """Return the contestant of a law's name, a policy's file or a file of the user's."""
    if text.endswith(".npz"):
        load_policy(text)
        return Contestant(Path(text).stem, dict.fromkeys(scenes, (text,)))
    if is_path(text):
        return Contestant(text.rpartition(":")[2], dict.fromkeys(scenes, (text,)))
    applicable = {task: laws(scene) for task, scene in scenes.items()}
    found = {task: (text,) for task, names in applicable.items() if text in names}
    if not found:
        known = dict.fromkeys(name for names in applicable.values() for name in names)
        msg = (
            f"controller: got {text!r}{suggest(text, [BASELINES, *known])}; allowed for these "
            f"tasks: {BASELINES}, {', '.join(known)}, the folder of a run, a pattern of runs in "
            "quotes, a policy's .npz file, or FILE.py:NAME"
        )
        raise SceneError(msg)
    return Contestant(text, found)
