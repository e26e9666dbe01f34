"""Rank all controllers and agents that have been scored on each task.

Scores the runs on the hundred episodes of ``docs/task_scores.json``, adds them to it, and writes
``docs/ranking.md`` and ``docs/tasks.md`` from it. A new score replaces an earlier one.
``--controllers`` also scores the named classical controllers, on all tasks that they apply to or on
those of ``--tasks``. ``--published`` also scores new published policies.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

import tyro

from agents.controllers.registry import Entry, entries, every_entry
from agents.controllers.tuned import NOT_SCORED
from agents.errors import command
from agents.evaluation.contestants import agents_of
from agents.evaluation.headroom import LEARNED, SCORES, Row, read_scores, scored
from agents.report.published import Row as PublishedRow
from agents.report.published import published_agents, read_published
from agents.report.score_pages import RANKING, TASKS, ranking_page, tasks_page
from agents.scoring import written
from agents.training.runs import RunError
from mm_gym import load_scene
from mm_gym.errors import check_name, refuse
from mm_gym.files import write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids, task_called


class Arguments(Document):
    """What to add."""

    runs: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """folders of finished runs, or patterns of folders in quotes"""
    controllers: tuple[str, ...] = ()
    """names of classical controllers to score again, as inertial-drive"""
    tasks: tuple[str, ...] = ()
    """names such as Hybrid, on which these are scored; by default all of mm_gym"""
    published: bool = False
    """also score the published policies whose cost in docs/published.md the scores do not have"""


def of_controllers(names: Sequence[str], tasks: Sequence[str]) -> Iterator[tuple[str, Row]]:
    """Yield the tasks and rows of classical controllers."""
    known = sorted({entry.name for entry in every_entry()})
    for name in names:
        check_name("--controllers", name, known)
    scenes = {task: load_scene(task) for task in map(task_called, tasks or ids())}
    suited = [
        (task, scene, entry)
        for task, scene in scenes.items()
        for entry in entries(scene)
        if entry.name in names and entry.refuses(scene) is None
    ]
    for name in names:
        if all(entry.name != name for *_, entry in suited):
            refuse("--controllers", f"{name!r}", f"those that apply to {', '.join(scenes)}")
    for task, scene, entry in suited:
        role = _role(entry)
        try:
            row = scored(role, scene, entry.make(scene))
        except NOT_SCORED as error:
            print(f"{task}: {entry.name}: not scored: {error}")
            continue
        print(f"{task}: {row['controller']}: {row['cost']:.4f}", flush=True)
        yield task, row


def put(rows: list[Row], row: Row) -> None:
    """Put a row in the place of its earlier score."""
    if row["role"] == LEARNED:
        rows[:] = [one for one in rows if one["controller"] != row["controller"]]
        rows.append(row)
        return
    kept = _without_numbers(row["controller"])
    rows[:] = [one for one in rows if _without_numbers(one["controller"]) != kept]
    before = {"constant", "passive", "law", row["role"]}
    after = [k for k, one in enumerate(rows) if one["role"] in before]
    rows.insert(after[-1] + 1, row)


def _without_numbers(name: str) -> str:
    """Return the name of a controller without what was tuned, which another search may change."""
    return re.sub(r"-?\d[\d.]*(e[+-]\d+)?", "", name)


def _role(entry: Entry) -> str:
    if entry.name == "predictive-control":
        return "predictive"
    if entry.role == "any":
        refuse("--controllers", f"{entry.name!r}", "a controller of some actuators")
    return "informed" if entry.role == "informed" else "law"


def of_runs(scores: dict[str, dict[str, Any]], text: str) -> Iterator[tuple[str, Row]]:
    """Yield the tasks and rows of runs; raise `RunError` if the scores lack the scene of one."""
    for task, agents in agents_of((text,)).items():
        scene = load_scene(task)
        if task not in scores or scores[task]["scene_digest"] != scene.digest:
            msg = f"{text}: {task} has no scores to add to; run: python -m agents headroom {task}"
            raise RunError(msg)
        for agent in agents:
            yield task, scored(LEARNED, scene, agent)


def of_published(scores: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, Row]]:
    """Yield the tasks and rows of the published policies whose costs the scores do not have.

    If a cost differs from the published one by rounding alone, the row has the published one.
    """
    known = [row for row in read_published().rows if row.task in scores]
    new = [row for row in known if not _has(scores[row.task], row)]
    for row, scene, agent in published_agents(new):
        agent.name = row.agent
        found = scored(LEARNED, scene, agent)
        yield row.task, found | _cost(row) if row.has(found["cost"]) else found


def _has(of_task: Mapping[str, Any], row: PublishedRow) -> bool:
    return of_task["scene_digest"] == row.scene_digest and any(
        one["controller"] == row.agent and _cost(row).items() <= one.items()
        for one in of_task["rows"]
    )


def _cost(row: PublishedRow) -> Row:
    return written({"cost": row.cost})


@command
def main(arguments: Arguments) -> None:
    """Rank from the command line."""
    scores = read_scores(SCORES, ids())
    found = [one for text in arguments.runs for one in of_runs(scores, text)]
    if arguments.published:
        found += of_published(scores)
    found += of_controllers(arguments.controllers, arguments.tasks)
    # Others may have written to it.
    scores = read_scores(SCORES, [*ids(), *(task for task, _ in found)])
    for task, row in found:
        put(scores[task]["rows"], row)
    write_text(SCORES, json.dumps(scores, indent=1) + "\n")
    for page, text in ((RANKING, ranking_page(scores)), (TASKS, tasks_page(scores))):
        write_text(page, text)
        print(f"written: {page}")
