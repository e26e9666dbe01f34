"""What is compared: laws by name, runs, patterns of runs, files of policies, the user's own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from agents.control.controller import Controller
from agents.controllers.learned import Learned
from agents.controllers.noise import RandomActions
from agents.controllers.registry import RANDOM, laws, not_a_law, obstacle
from agents.controllers.user_defined import user_defined
from agents.network.files import ENDINGS
from agents.policies import load_policy
from agents.scoring import HELD_OUT_SEED, VALIDATION_SEED, evaluate
from agents.training.parts import agent_of, trained_parts
from agents.training.runs import Run, RunError
from mm_gym import OwnReward, Scene, SceneError, load_scene, rewarded
from mm_gym.arrays import Array
from mm_gym.errors import check_name, refuse, suggest
from mm_gym.tasks import ids, robust_ids, short_name, task_or_scene
from mm_gym.user_code import is_path

BASELINES = "baselines"  # the name of the quick classical controllers that apply to a task
SEEDS, EACH = 5, 64  # seeds and episodes of each where none are asked for
LEAST = 2  # least number of episodes of a seed


@dataclass(frozen=True)
class Contestant:
    """What stands in one row of the tables."""

    name: str  # its name there
    text: str  # what was given for it
    # Task -> what makes its controllers: names that `law_of` takes. Several are runs of one
    # training with several seeds.
    texts: Mapping[str, tuple[str, ...]]
    addition: str = ""  # what is told behind its name
    trust: bool = False  # whether the user's own code that runs name is run

    @property
    def label(self) -> str:
        """What it is called in the tables."""
        return self.name + self.addition

    def make(self, task: str, scene: Scene) -> list[Controller]:
        """Return its controllers for a task: one, or one for each seed."""
        return [
            law_of(text, scene, np.random.default_rng(0), trust=self.trust)
            for text in self.texts[task]
        ]


@dataclass(frozen=True)
class Field:
    """All that is compared."""

    scenes: Mapping[str, Scene]  # task -> scene
    contestants: tuple[Contestant, ...]  # in the order in which they were given
    baselines: bool  # whether all classical controllers of each task are compared too

    @property
    def trainings(self) -> int:
        """Number of seeds of the trainings that have several, else 1."""
        counts = (len(texts) for one in self.contestants for texts in one.texts.values())
        return max(counts, default=1)


@dataclass(frozen=True)
class Episodes:
    """The episodes that all controllers go through."""

    # seeds, each: number of seeds, and of episodes of each
    seeds: int
    each: int
    first: int = HELD_OUT_SEED  # seed of the first episode; the others count up from it

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
            refuse("--seeds", f"{seeds}", allowed)
        if each < LEAST:
            refuse("--episodes", f"{each}", f"at least {LEAST}, to estimate their scatter")
        last = VALIDATION_SEED - seeds * each
        if last < HELD_OUT_SEED:
            allowed = f"at most {VALIDATION_SEED - HELD_OUT_SEED} together"
            refuse("--seeds and --episodes", f"{seeds} x {each} episodes", allowed)
        if not HELD_OUT_SEED <= first <= last:
            allowed = f"{HELD_OUT_SEED} to {last}: laws are tuned, and agents trained, on others"
            refuse("--first-seed", f"{first} for {seeds} x {each} episodes", allowed)
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

    def penalties(self, scene: Scene, episodes: Episodes) -> Array:
        """Return the penalties (seeds, episodes) of the episodes, those of a controller at once."""
        each, parts = episodes.each, [episodes]
        if self.trained:
            parts = [episodes.of(number) for number in range(episodes.seeds)]
        found = [
            evaluate(scene, one, seed=part.first, episodes=part.seeds * each, blocks=part.seeds)
            for one, part in zip(self.controllers, parts, strict=True)
        ]
        return np.concatenate([one.penalties for one in found]).reshape(episodes.seeds, each)


@dataclass(frozen=True)
class Trained:
    """Finished runs that were trained on one scene."""

    name: str  # the scene's: a task's id, or the path of a file
    scene: Scene  # the scene
    runs: tuple[Run, ...]  # their folders


def read_field(
    texts: Sequence[str],
    tasks: Sequence[str] = (),
    reward: str | None = None,
    *,
    trust: bool = False,
) -> Field:
    """Return what texts name: contestants, on the given tasks or else on the scenes of the runs.

    Without tasks and runs it is all tasks of mm_gym. On given tasks runs of one other scene are
    compared too; their label tells that scene. An own reward, FILE.py:NAME, scores all of them.
    Bases of runs in files of the user's are run only with trust.
    Raise `SceneError` if a name is unknown or given twice, or applies to none of the tasks;
    `RunError` if a run is missing or not over, or was trained for an own reward and none is given,
    runs of several scenes do not fit, or patterns of runs have different numbers of them;
    `PolicyError` if a file is no policy.
    """
    twice = [text for text in texts if list(texts).count(text) > 1]
    if twice:
        msg = f"{twice[0]}: given twice; allowed: once"
        raise SceneError(msg)
    named = (BASELINES, *(text for text in texts if is_path(text) or text.endswith(ENDINGS)))
    paths = [text for text in texts if "*" in text or "/" in text or Path(text).is_dir()]
    runs = {text: finished_runs(text) for text in paths if text not in named}
    trained = [one for of_text in runs.values() for one in of_text.values()]
    if reward is None:
        _require_objective(trained)
    scenes = {task: load_scene(task) for task in map(task_or_scene, tasks)}
    if not scenes:
        scenes = _scenes_of(trained) or {task: load_scene(task) for task in ids()}
    if reward is not None:
        own = OwnReward(reward)
        scenes = {task: rewarded(scene, own) for task, scene in scenes.items()}
    found = [
        _trained(text, runs[text], scenes, elsewhere=bool(tasks))
        if text in runs
        else _named(text, scenes)
        for text in texts
        if text != BASELINES
    ]
    counts = {one.text: {len(texts) for texts in one.texts.values()} for one in found}
    several = {text: count for text, (count, *_) in counts.items() if count > 1}
    if len(set(several.values())) > 1:
        told = ", ".join(f"{text} has {count}" for text, count in several.items())
        refuse("seeds", f"different numbers of runs ({told})", "the same for all, or one", RunError)
    labels = [one.label for one in found]
    distinct = tuple(
        replace(one, name=one.name if labels.count(one.label) == 1 else one.text, trust=trust)
        for one in found
    )
    return Field(scenes, distinct, baselines=BASELINES in texts)


def finished_runs(text: str) -> dict[str, Trained]:
    """Return the runs of a folder, or of a pattern of folders, by the digest of their scene.

    Raise `RunError` if there are none, or one is not over.
    """
    path = Path(text)
    folders = sorted(path.parent.glob(path.name)) if "*" in text else [path]
    folders = [folder for folder in folders if os.path.lexists(folder / "run.json")]
    if not folders:
        others = [record.parent.name for record in path.parent.glob("*/run.json")]
        near = suggest(path.name, others)
        msg = f"{text}: no finished run here{near}; train first: python -m agents train"
        raise RunError(msg)
    found: dict[str, Trained] = {}
    for folder in folders:
        run = Run(folder.name, folder.parent)
        run.require_finished()
        digest = run.read()["scene_digest"]
        earlier = found.get(digest) or Trained(*_scene_of(run), ())
        found[digest] = replace(earlier, runs=(*earlier.runs, run))
    return found


def _require_objective(trained: Sequence[Trained]) -> None:
    """Raise `RunError` if a run was trained for an own reward, which its score would not tell."""
    for run in [run for one in trained for run in one.runs]:
        own = run.read()["settings"].get("reward")
        if own is not None:
            msg = (
                f"{run.folder}: trained for the reward {own}; give --reward {own}, or another "
                "FILE.py:NAME, by which all that is compared is scored"
            )
            raise RunError(msg)


def _scene_of(run: Run) -> tuple[str, Scene]:
    """Return the scene of a run and its name: its task's, or its file's and what was changed."""
    record = run.read()
    settings, digest = record["settings"], record["scene_digest"]
    task = load_scene(settings["task"])
    if task.digest == digest:
        return settings["task"], task
    source, changes = settings.get("scene") or settings["task"], settings.get("changes") or {}
    name = ", ".join([source, *(f"{field} = {value}" for field, value in changes.items())])
    with suppress(SceneError):  # its file need not be there any more
        if load_scene(source).replace(**changes).digest != digest:
            name += ", as it was"
    return name, run.scene()


def _scenes_of(trained: Sequence[Trained]) -> dict[str, Scene]:
    """Return the scenes of all runs by name, tasks of mm_gym first; names must differ."""
    found: dict[str, Trained] = {}
    for one in trained:
        first = found.setdefault(one.name, one)
        if first.scene.digest != one.scene.digest:
            msg = (
                f"{first.runs[0].folder}: trained on another {one.name} than other runs; "
                "allowed: runs of the same scene, or --tasks with the scene to compare them on"
            )
            raise RunError(msg)
    return {name: found[name].scene for name in (*ids(), *found) if name in found}


def tasks_called(names: Iterable[str]) -> list[str]:
    """Return the ids of tasks by name, each once; raise `SceneError` for others and variants."""
    allowed = {short_name(task): task for task in ids()}
    found = [short_name(name) for name in names]
    for name in found:
        check_name("task", name, allowed)
    return [allowed[name] for name in dict.fromkeys(found)]


def agents_of(texts: Iterable[str]) -> dict[str, list[Controller]]:
    """Return the agents of finished runs by their task; raise `RunError` for another scene."""
    found: dict[str, list[Controller]] = {}
    for text in texts:
        for trained in finished_runs(text).values():
            if trained.name not in (*ids(), *robust_ids()):
                msg = (
                    f"{trained.runs[0].folder}: trained on {trained.name}; "
                    "allowed: a run of the scene of a task of mm_gym"
                )
                raise RunError(msg)
            for run in trained.runs:
                agent = law_of(str(run.folder), trained.scene, np.random.default_rng(0))
                agent.name = run.folder.name
                found.setdefault(trained.name, []).append(agent)
    return found


def _trained(
    text: str, runs: Mapping[str, Trained], scenes: Mapping[str, Scene], *, elsewhere: bool
) -> Contestant:
    """Return the contestant of a run or of several; refuse what cannot stand in one table.

    `elsewhere` is whether runs of one scene may stand on others.
    """
    name = Path(text).name.replace("*", "").strip("-_.") or Path(text).parent.name
    addition = ""
    names = [trained.name for trained in runs.values()]
    wanted = {scene.digest for scene in scenes.values()}
    if set(runs) != wanted:
        if not elsewhere or len(runs) > 1:
            also = "" if elsewhere else ", or --tasks that says on which to compare them"
            got, allowed = f"runs of {', '.join(names)}", f"of each of {', '.join(scenes)}{also}"
            refuse(text, got, allowed, RunError)
        (only,) = runs.values()
        other = only.name in scenes and scenes[only.name].digest != only.scene.digest
        addition = f", trained on {'another ' * other}{only.name}"
        runs = dict.fromkeys(wanted, only)
    counts = {trained.name: len(trained.runs) for trained in runs.values()}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{count} of {name}" for name, count in counts.items())
        refuse(text, told, "the same number of runs of each task", RunError)
    folders = {
        task: tuple(str(run.folder) for run in runs[scene.digest].runs)
        for task, scene in scenes.items()
    }
    return Contestant(name, text, folders, addition)


def _named(text: str, scenes: Mapping[str, Scene]) -> Contestant:
    """Return the contestant of a law's name, a policy's file or a file of the user's."""
    if text.endswith(ENDINGS):
        load_policy(text)
        return Contestant(Path(text).name, text, dict.fromkeys(scenes, (text,)))
    if is_path(text):
        return Contestant(text.rpartition(":")[2], text, dict.fromkeys(scenes, (text,)))
    applicable = {task: laws(scene) for task, scene in scenes.items()}
    found = {task: (text,) for task, names in applicable.items() if text in names}
    if not found:
        known = dict.fromkeys(name for names in applicable.values() for name in names)
        why = dict.fromkeys(filter(None, (obstacle(text, scene) for scene in scenes.values())))
        msg = (
            f"controller: got {text!r}{''.join(f', {reason}' for reason in why)}"
            f"{suggest(text, [BASELINES, *known])}; allowed for these "
            f"tasks: {BASELINES}, {', '.join(known)}, the folder of a run, a pattern of runs in "
            "quotes, a policy's file, or FILE.py:NAME"
        )
        raise SceneError(msg)
    return Contestant(text, text, found)


def law_of(
    name: str, scene: Scene, generator: np.random.Generator, *, trust: bool = False
) -> Controller:
    """Return a controller by its name, or that of FILE.py:NAME, a run's folder or a policy's file.

    FILE.py is run. The generator is where random actions are drawn from. Raise `SceneError` if the
    name is not one that applies to the scene, nor a path; `RunError` if the training of the run is
    not over; `PolicyError` if the policy cannot be read, or the run has a base in a file of the
    user's and there is no trust.
    """
    applicable, path = laws(scene), Path(name)
    if is_path(name):
        return user_defined(name, scene)[-1]
    if name == RANDOM:
        return RandomActions(scene, generator)
    if name in applicable:
        return applicable[name](scene)
    if path.suffix in ENDINGS:
        return Learned(load_policy(path), name)
    run = Run(path.name, path.parent)
    if not os.path.lexists(run.record):
        others = "FILE.py:NAME, the folder of a run, or a policy's file"
        raise not_a_law(name, scene, "controller", others)
    run.require_finished()
    return agent_of(run, trained_parts(run, trust=trust, asked=scene.own_reward), name)
