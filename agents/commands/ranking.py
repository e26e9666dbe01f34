"""Rank all that is known on each task.

Scores the runs on the hundred episodes of ``docs/task_scores.json``, adds them to it, and writes
``docs/ranking.md`` from it. A run that is scored again takes the place of its earlier score.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated

import tyro

from agents.errors import command, leave
from agents.evaluation.contestants import agents_of
from agents.evaluation.headroom import LEARNED, scored
from agents.evaluation.scores import SCORES, read_scores
from agents.report.ranking_page import PAGE, page
from agents.training.runs import RunError
from mm_gym import load_scene
from mm_gym.files import write_text


@dataclass(frozen=True)
class Arguments:
    """What to add."""

    runs: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """folders of finished runs, or patterns of folders in quotes"""


def add_runs(scores: dict[str, dict[str, list[dict[str, str | float]]]], text: str) -> None:
    """Score runs, and put them among the scores of their tasks."""
    for task, agents in agents_of((text,)).items():
        scene = load_scene(task)
        if task not in scores or scores[task]["scene_digest"] != scene.digest:
            msg = f"{text}: {task} has no scores to add to; run: python -m agents headroom {task}"
            raise RunError(msg)
        for agent in agents:
            rows = scores[task]["rows"]
            rows[:] = [row for row in rows if row["controller"] != agent.name]
            rows.append(scored(LEARNED, scene, agent))


@command
def main() -> None:
    """Rank from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    scores = read_scores(SCORES)
    for text in arguments.runs:
        add_runs(scores, text)
    write_text(SCORES, json.dumps(scores, indent=1) + "\n")
    write_text(PAGE, page(scores))
    print(f"written: {PAGE}")


if __name__ == "__main__":
    leave(main())
