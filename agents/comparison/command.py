"""The comparison of several, from measurement to files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from agents.comparison.conclusions import conclude
from agents.comparison.measure import measure
from agents.comparison.robustness import check_records
from agents.report.comparison import print_comparison, write_comparison
from agents.report.comparison_figures import (
    draw_aggregates,
    draw_closed_loops,
    draw_intervals,
    draw_robustness,
)
from agents.report.tables import not_scored_cells
from mm_gym import SceneError
from mm_gym.files import check_outputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from agents.comparison.conclusions import Comparison
    from agents.comparison.contestants import Field
    from agents.comparison.entries import Episodes
    from agents.comparison.measure import Studies


def compare(
    compared: Field,
    episodes: Episodes,
    studies: Studies,
    folder: Path | None = None,
    processes: int = 1,
) -> Comparison:
    """Measure, print the tables, and write them with figures to a folder."""
    if folder is not None:
        check_outputs([folder / "comparison.csv"])
    check_records(compared.scenes.values(), studies.records)
    results = measure(compared, episodes, studies, processes)
    nothing = [
        f"{one.task}: {text}" for one in results for text in not_scored_cells(one.not_scored)
    ]
    if nothing and all(len(one.labels) == 1 for one in results):
        raise SceneError("\n".join(nothing))
    comparison = conclude(results, compared.scenes, episodes)
    print_comparison(comparison)
    if folder is not None:
        write_comparison(comparison, folder)
        draw_intervals(comparison, folder / "costs.png")
        if comparison.overall:
            draw_aggregates(comparison, folder / "scores.png")
        for result in results:
            name = _file_name(result.task, [one.task for one in results])
            if result.outcomes:
                draw_robustness(result, folder / f"robustness_{name}.png")
            if result.loops:
                draw_closed_loops(result, folder / f"frequency_{name}.png")
        print(f"written: {folder}/")
    return comparison


def _file_name(task: str, tasks: Sequence[str]) -> str:
    """Return the part of a file's name that tells a task's figure from those of the others."""
    stem = Path(task).stem.lower()
    if [Path(one).stem.lower() for one in tasks].count(stem) > 1:
        stem = task
    return re.sub(r"[^\w.-]+", "_", stem)
