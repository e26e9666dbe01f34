"""The page on the tasks, ``docs/tasks.md``, made from scenes and committed scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.headroom import CLASSICAL, LEARNED, best_controller
from agents.evaluation.scores import SCORES
from agents.report.description import describe
from agents.report.pages import percent, render
from mm_gym import load_scene
from mm_gym.files import read_text
from mm_gym.tasks import ids, path_of

Row = Mapping[str, str | float]

PAGE = SCORES.with_name("tasks.md")

OBSERVING = (*CLASSICAL, LEARNED)  # roles of what reads no more than an agent does


def page(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page of all tasks with these scores, as of ``docs/task_scores.json``."""
    names = ids()
    return render(
        "tasks",
        limited=[f"`{name}`" for name in names if _ends_early(name)],
        summary=[_summary(name, scores[name]["rows"]) for name in names],
        preview=[_preview(name, scores[name]) for name in names if "preview" in scores[name]],
        tasks=[_task(name, scores[name]["rows"]) for name in names],
    )


def _ends_early(name: str) -> bool:
    """Tell whether a task has a limit at which an episode terminates."""
    goal = load_scene(name).objective
    return goal.displacement_limit is not None or goal.rail_half_length is not None


def _summary(name: str, rows: Sequence[Row]) -> list[str]:
    constant, planner = (_least(rows, role) for role in ("constant", "planner"))
    best = best_controller(rows)
    return [
        f"[`{name}`](#{_anchor(name)})",
        f"{constant:.3g}",
        f"{best:.3g}",
        percent(1 - best / constant),
        f"{planner:.3g}",
        percent(1 - planner / constant),
    ]


def _preview(name: str, scores: Mapping[str, Any]) -> list[str]:
    expected, foreseen = (scores["preview"][key] for key in ("expected", "foreseen"))
    known = _least(scores["rows"], "planner")
    observing = min(row["cost"] for row in scores["rows"] if row["role"] in OBSERVING)
    part = percent((expected - foreseen) / (expected - known))
    return [f"`{name}`", *(f"{cost:.3g}" for cost in (known, foreseen, expected, observing)), part]


def _least(rows: Sequence[Row], role: str) -> float:
    return min(float(row["cost"]) for row in rows if row["role"] == role)


def _anchor(name: str) -> str:
    """Return what GitHub makes of the heading."""
    return name.replace("/", "").lower()


def about(file: Path) -> str:
    """Return what the scene file's comment says after the task's id, and a space; else nothing."""
    lines = [line for line in read_text(file).splitlines() if line.startswith("# ")]
    text = lines[0].partition(": ")[2] if lines else ""
    return text and f"{text[0].upper()}{text[1:]} "


def _task(name: str, rows: Sequence[Row]) -> dict[str, object]:
    """Return what the template says of a task."""
    file, constant, springs = path_of(name), _least(rows, "constant"), "injected" in rows[0]
    cells = [
        [
            str(row["controller"]),
            str(row["reads"]),
            f"{row['cost']:.4g}",
            f"{row['low']:.4g} to {row['high']:.4g}",
            percent(1 - float(row["cost"]) / constant),
            f"{row['displacement']:.4g}",
            *([f"{1e3 * float(row['injected']):.3g}"] if springs else []),
        ]
        for row in rows
    ]
    told = {"name": name, "about": about(file), "file": file.name}
    return {**told, "scene": describe(load_scene(file)), "springs": springs, "rows": cells}
