"""The page of the sealed episodes, ``docs/sealed.md``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.evaluation.scores import SCORES
from agents.evaluation.sealed import EPISODES, first_seed
from agents.report.pages import render

Row = Mapping[str, Any]

PAGE = SCORES.with_name("sealed.md")


def page(data: Mapping[str, Any]) -> str:
    """Return the page of the scores of a release, as of ``docs/sealed_scores.json``."""
    tasks = data["tasks"]
    compared = {task: one for task, of_task in tasks.items() for one in of_task["compared"]}
    return render(
        "sealed",
        release=data["release"],
        episodes=EPISODES,
        seed=first_seed(data["release"]),
        compared=[
            [task, one["agent"], one["over"], _span(one, "value")] for task, one in compared.items()
        ],
        cheaper=sum(one["value"] < 1.0 for one in compared.values()),
        surely=sum(one.get("high", 1.0) < 1.0 for one in compared.values()),
        sections=[(task, [_cells(row) for row in tasks[task]["rows"]]) for task in tasks],
    )


def _cells(row: Row) -> list[str]:
    return [
        *(row["controller"], row["role"], str(row["seeds"]), _span(row, "cost")),
        f"{row['worst']:.4g}",
    ]


def _span(row: Row, what: str) -> str:
    ends = f" [{row['low']:.4g}, {row['high']:.4g}]" if "low" in row else ""
    return f"{row[what]:.4g}{ends}"
