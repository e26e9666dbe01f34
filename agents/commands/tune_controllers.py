"""Search the free numbers of classical controllers.

For example ``python -m agents tune-controllers CarriageForceFriction``. Every controller has the
same budget: ``--trials`` designs, each scored on the 100 validation episodes, and the best of each
tenth of them on 1,000 further ones, which decide; no other episode is used. The numbers are written
to ``configs/controllers.json``, from which all commands take them; those of other scenes and
controllers in it are kept. After a kill or Ctrl-C the same command continues, from
``runs/controllers``.

A search for a robust variant begins with the numbers of its task: ``python -m agents
tune-controllers PreStretchRobust --start PreStretch``.
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, cast

import tyro
from filelock import lock_descriptor
from pydantic import Field

from agents.controllers.registry import MOST_BYTES, NUMBERS, Tunable, entries, read_found
from agents.controllers.searched import REFUSED, finalists, further_cost, trials
from agents.errors import command
from agents.scoring import written
from agents.training.config import Count
from mm_gym import DesignError, Scene, SceneError, load_scene
from mm_gym.errors import check_name, refuse
from mm_gym.files import check_outputs, open_lock, read_json, write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids, task_or_scene

RUNS = Path("runs") / "controllers"  # where the costs of a search are kept until it ends
EVERY = 50  # trials after which they are written


class Arguments(Document):
    """What to tune."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """names such as Hybrid, or scene files; by default all tasks of mm_gym"""
    controllers: tuple[str, ...] = ()
    """names as inertial-drive; by default all that have free numbers and apply to the scene"""
    trials: Count = 1000
    """designs that are tried of each controller and scene"""
    start: str | None = None
    """task whose numbers a search begins with, in place of the first ones of a design"""
    seed: Annotated[int, Field(ge=0)] = 0
    """seed of the search"""
    out: Annotated[Path, tyro.conf.arg(help_behavior_hint=f"(default: configs/{NUMBERS.name})")] = (
        NUMBERS
    )
    """file that the numbers are written to"""


def tunables(scene: Scene) -> dict[str, Tunable]:
    """Return the controllers with free numbers that apply to a scene, by name."""
    return {
        one.name: one.tunable
        for one in entries(scene)
        if one.tunable is not None and one.refuses(scene) is None
    }


def tune(
    scene: Scene,
    tunable: Tunable,
    count: int,
    seed: int,
    file: Path,
    *,
    start: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Return what a search finds, as of `agents.controllers.registry.Found`; go on from a file."""
    head = {"scene_digest": scene.digest, "controller": tunable.name, "seed": seed}
    head["start"] = None if start is None else dict(start)
    known = _costs_so_far(file, head)[:count]
    costs: list[float] = []
    numbers: list[dict[str, float]] = []
    try:
        for coordinates, cost in trials(scene, tunable, count, seed, start=start, known=known):
            costs.append(cost)
            numbers.append(written(tunable.at(scene, coordinates, start)))
            if len(costs) % EVERY == 0 and len(costs) > len(known):
                _keep(file, head, costs)
    except KeyboardInterrupt:
        _keep(file, head, max(costs, known, key=len))
        msg = f"after {len(costs)} trials of {tunable.name}"
        raise KeyboardInterrupt(msg) from None
    _keep(file, head, costs)
    last = {k: further_cost(scene, tunable, numbers[k]) for k in finalists(costs)}
    best = min(last, key=lambda k: last[k])
    return {
        "numbers": numbers[best],
        **written({"cost": costs[best], "further_cost": last[best]}),
        "first_cost": None if costs[0] >= REFUSED else written({"": costs[0]})[""],
        "trials": count,
        "seed": seed,
    }


def _costs_so_far(file: Path, head: dict[str, Any]) -> list[float]:
    """Return the costs that an interrupted search kept; raise `SceneError` for another's file."""
    if not os.path.lexists(file):
        return []
    content = read_json(file, most=MOST_BYTES)
    if not isinstance(content, dict):
        content = {}
    content = cast("dict[str, Any]", content)
    costs = content.pop("costs", None)
    same = {"start": None, **content} == head  # earlier versions stated a start alone
    if not same or not isinstance(costs, list) or not all(isinstance(one, float) for one in costs):
        msg = f"{file}: of another search, or damaged; delete it to begin again"
        raise SceneError(msg)
    return costs


def _keep(file: Path, head: dict[str, Any], costs: list[float]) -> None:
    write_text(file, json.dumps({**head, "costs": costs}) + "\n")


def add(file: Path, task: str, scene: Scene, name: str, found: dict[str, Any]) -> None:
    """Write what was found to a file; what it has stays, also if others write to it meanwhile."""
    file = file.resolve()
    file.parent.mkdir(parents=True, exist_ok=True)
    with os.fdopen(open_lock(file.with_name(f".{file.name}.lock"))) as lock:
        lock_descriptor(lock.fileno())  # until it is closed
        write_text(file, json.dumps(_with(file, task, scene, name, found), indent=1) + "\n")


def _with(
    file: Path, task: str, scene: Scene, name: str, found: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return what a file has, if it is there, and what was found; sorted by task and name."""
    content = read_found(file) if os.path.lexists(file) else {}
    known = {key: one.model_dump() for key, one in content.items()}
    own = known.get(task, {})
    kept = own["controllers"] if own.get("scene_digest") == scene.digest else {}
    controllers = dict(sorted({**kept, name: found}.items()))
    known[task] = {"scene_digest": scene.digest, "controllers": controllers}
    return dict(sorted(known.items()))


def _check_names(named: Sequence[str], applicable: Mapping[str, Mapping[str, Tunable]]) -> None:
    """Raise `SceneError` if a name is none of those that apply to tasks, or none does."""
    every = sorted({name for names in applicable.values() for name in names})
    if not every:
        got = ", ".join(map(str, applicable))
        refuse("tasks", got, "those to which a controller with free numbers applies")
    for name in named:
        check_name("--controllers", name, every)


@command
def main(arguments: Arguments) -> None:
    """Tune from the command line."""
    out = arguments.out
    check_outputs([out])
    if os.path.lexists(out):
        read_found(out)  # what is wrong with it is told before the search
    scenes = {task: load_scene(task) for task in map(task_or_scene, arguments.tasks or ids())}
    begun = None if arguments.start is None else load_scene(task_or_scene(arguments.start))
    applicable = {task: tunables(scene) for task, scene in scenes.items()}
    _check_names(arguments.controllers, applicable)
    for task, scene in scenes.items():
        for name, tunable in applicable[task].items():
            if arguments.controllers and name not in arguments.controllers:
                continue
            try:
                tunable.first(scene)
            except DesignError as error:
                print(f"{task}: {name}: not tuned: {error}")
                continue
            start = None if begun is None else tunable.numbers(begun)
            file = RUNS / f"{scene.digest[:16]}-{name}-{arguments.seed}.json"
            found = tune(scene, tunable, arguments.trials, arguments.seed, file, start=start)
            add(out, str(task), scene, name, found)
            file.unlink(missing_ok=True)
            print(f"{task}: {name}: {found['first_cost']} -> {found['cost']}", flush=True)
