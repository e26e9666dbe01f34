"""Measure what there is to gain on each task.

Scores fixed, classical and clairvoyant control on the same hundred episodes, and writes
``docs/task_scores.json``, from which ``docs/tasks.md`` takes its numbers. The search for the
clairvoyant optima also starts from the actions of finished runs: ``--runs runs/NAME ...``.

With ``--preview`` it measures how much a controller gains from knowing the random excitation in
advance. With ``--check`` it writes nothing: it compares the runs, or all classical controllers if
there are none, with the clairvoyant optimum of every episode, and names those that are better.
"""

import io
import json
import os
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from pydantic import Field

from agents.control.controller import Controller
from agents.errors import command
from agents.evaluation.contestants import agents_of, tasks_called
from agents.evaluation.headroom import (
    EPISODES,
    KEPT,
    LEARNED,
    ROUNDING,
    SCORES,
    Row,
    controllers_of,
    headroom,
    interval,
    over_plans,
    preview,
    read_scores,
)
from agents.network.files import array_in, numbers
from agents.scoring import written
from mm_gym import Scene, SceneError, compile_scene, load_scene
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.files import check_outputs, read_bytes, write_bytes, write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids, path_of, short_name

MOST_BYTES = 2**28  # largest file of plans


class Arguments(Document):
    """What to score."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """names such as Hybrid; by default those of the runs, or all of mm_gym"""
    runs: tuple[str, ...] = ()
    """folders of finished runs, or patterns of folders in quotes"""
    check: bool = False
    """compare with the clairvoyant optima, and write nothing"""
    preview: bool = False
    """measure the worth of preview of random excitation, and nothing else"""
    seed: Annotated[int, Field(ge=0)] = 0
    """seed of the search"""
    plans: Path | None = None
    """folder where the plans are kept, a file a task, and from which the next search begins"""
    out: Annotated[Path, tyro.conf.arg(help_behavior_hint=f"(default: docs/{SCORES.name})")] = (
        SCORES
    )
    """file that the scores are written to; those of other tasks in it are kept"""


def score(
    name: str, agents: list[Controller], earlier: list[Row], file: Path | None, seed: int
) -> list[Row]:
    """Return the rows of a task, and print them; plans are read from a file and kept there."""
    began, scene, kept = time.perf_counter(), load_scene(name), None
    if file is not None and os.path.lexists(file):
        kept = _kept_plans(file, (scene.control.steps, EPISODES, len(scene.actuation.names)))
    found = headroom(scene, agents, kept, seed)
    if file is not None:
        content = io.BytesIO()
        np.save(content, found.plans)
        write_bytes(file, content.getvalue())
    rows = found.rows
    _keep_better(rows[-1], earlier)
    rows += [row for row in earlier if row["role"] == LEARNED]
    print(f"{name}: {time.perf_counter() - began:.0f} s")
    for row in rows:
        print(f"  {row['controller']:60} {row['cost']:.4f} [{row['low']:.4f}, {row['high']:.4f}]")
    return rows


def _kept_plans(file: Path, shape: tuple[int, ...]) -> Array:
    """Return the plans of an earlier search; raise `SceneError` if they are not of the scene."""
    content = read_bytes(file, most=MOST_BYTES)
    try:
        return numbers({"plans": array_in(content, str(file))}, "plans", shape)
    except ValueError as error:
        msg = f"{file}: {error}"
        raise SceneError(msg) from None


def _keep_better(planner: Row, earlier: list[Row]) -> None:
    """Let the cost of an earlier plan stand where it is less, and say where kept plans were from.

    Earlier plans themselves may be lost: their costs are what is known to be possible.
    """
    before = next((row["plans"] for row in earlier if row["role"] == "planner"), None)
    if before is None:
        return
    for k, (known, plan) in enumerate(zip(before, planner["plans"], strict=True)):
        if plan["start"].startswith(KEPT):
            plan["start"] = known["start"] + plan["start"].removeprefix(KEPT)
        if known["cost"] < plan["cost"]:
            planner["plans"][k] = known
    penalties = np.array([plan["cost"] ** 2 for plan in planner["plans"]])
    values = np.sqrt(penalties.mean()), *interval(penalties)
    told = dict(zip(("cost", "low", "high"), values, strict=True))
    if planner["displacement"] == planner["cost"]:  # nothing else is rewarded
        told["displacement"] = told["cost"]
    planner |= written(told)


def check(name: str, scene: Scene, agents: list[Controller], scores: dict[str, Any]) -> str | None:
    """Compare with the clairvoyant optima, and print how close; return which are better, if any.

    Raise `SceneError` if the scores of the task are missing or of another scene.
    """
    if scores.get(name, {}).get("scene_digest") != scene.digest:
        msg = f"{name}: no scores of the present scene; run: python -m agents headroom {name}"
        raise SceneError(msg)
    rows = scores[name]["rows"]
    controllers = agents or [controller for _, controller in controllers_of(scene)]
    worse: list[str] = []
    for label, ratios in over_plans(scene, controllers, rows).items():
        ahead = np.flatnonzero(ratios < 1.0 - ROUNDING)
        print(f"{name}: {label}: {ratios.min():.5f} times the clairvoyant optimum's cost at least")
        if ahead.size:
            told = ", ".join(str(k) for k in ahead)
            worse.append(
                f"{label} is better than the clairvoyant optimum of {name} in episodes {told}"
            )
    return "; ".join(worse) or None


@command
def main(arguments: Arguments) -> str | None:
    """Score or check from the command line."""
    out, plans = arguments.out, arguments.plans
    better: list[str] = []
    scores = read_scores(out) if os.path.lexists(out) else {}
    agents = agents_of(arguments.runs)
    tasks = tasks_called(arguments.tasks or list(agents) or ids())
    files: dict[str, Path] = {}
    if plans is not None:
        files = {name: plans / f"{path_of(name).stem}.npy" for name in tasks}
    if not arguments.check:
        check_outputs([out, *files.values()])
    if others := ", ".join(short_name(task) for task in agents if task not in tasks):
        refuse("--runs", f"runs of {others}", f"runs of {', '.join(map(short_name, tasks))}")
    for name in tasks:
        scene = load_scene(name)
        own = agents.get(name, [])
        if arguments.check:
            better += filter(None, [check(name, scene, own, scores)])
            continue
        earlier = scores.get(name, {})
        if arguments.preview:
            if not earlier or not compile_scene(scene).support.sampled:
                continue
            new = {"scene_digest": earlier["scene_digest"], "preview": preview(scene)}
            print(f"{name}: {new['preview']}")
        else:
            known = earlier["rows"] if earlier.get("scene_digest") == scene.digest else []
            rows = score(name, own, known, files.get(name), arguments.seed)
            new = {"scene_digest": scene.digest, "episodes": EPISODES, "rows": rows}
        scores = read_scores(out) if os.path.lexists(out) else {}  # others may have written to it
        before = scores.get(name, {})
        same = before.get("scene_digest") == new["scene_digest"]  # the rest of its scene stays
        scores[name] = (before if same else {}) | new
        scores = {task: scores[task] for task in ids() if task in scores}
        write_text(out, json.dumps(scores, indent=1) + "\n")
    if better:
        return "\n".join([*better, "make their plans starts: python -m agents headroom --runs RUN"])
    return None
