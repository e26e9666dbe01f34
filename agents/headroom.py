"""Measure what there is to gain on each task: ``python -m agents.headroom [TASK ...]``.

Scores fixed, classical and best known control on the same hundred episodes, and writes
``docs/task_scores.json``, from which ``docs/tasks.md`` takes its numbers.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 - tyro reads the annotation
from typing import Annotated

import tyro

from agents.evaluation.headroom import EPISODES, LEARNED, SCORES, headroom
from mm_gym import SceneError, load_scene
from mm_gym.files import write_text
from mm_gym.tasks import ids, path_of


@dataclass(frozen=True)
class Arguments:
    """What to score."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """registered ids; all of mm_gym by default"""
    out: Path = SCORES
    """file that the scores are written to; those of other tasks in it are kept"""


def print_scores(name: str, rows: list[dict[str, str | float]], seconds: float) -> None:
    """Print the rows of a task."""
    print(f"{name}: {seconds:.0f} s")
    for row in rows:
        print(f"  {row['controller']:60} {row['cost']:.4f} [{row['low']:.4f}, {row['high']:.4f}]")


def main() -> str | None:
    """Score from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    scores = json.loads(arguments.out.read_text("utf-8")) if arguments.out.exists() else {}
    try:
        for name in arguments.tasks or ids():
            scene = load_scene(path_of(name))
            began = time.perf_counter()
            rows = headroom(scene)
            rows += [row for row in scores.get(name, {}).get("rows", []) if row["role"] == LEARNED]
            print_scores(name, rows, time.perf_counter() - began)
            scores[name] = {"scene_digest": scene.digest, "episodes": EPISODES, "rows": rows}
            ordered = {task: scores[task] for task in ids() if task in scores}
            write_text(arguments.out, json.dumps(ordered, indent=1) + "\n")
    except SceneError as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    sys.exit(main())
