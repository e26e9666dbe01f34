"""Tables of a report: files of numbers, the printed ranking, and Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from mm_gym.files import write_csv

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from agents.evaluation.episodes import Evaluation
    from mm_gym import Scene


def write_scores(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per controller; ratios are those of the costs to the first controller's."""
    write_csv(
        path,
        [
            "controller",
            "reads",
            "cost [-]",
            "ratio to reference [-]",
            "rms of x1 / scale [-]",
            "mean return [-]",
            "mean energy injected [J]",
        ],
        [
            [result.name for result in results],
            [result.reads for result in results],
            [result.cost for result in results],
            [result.cost / results[0].cost for result in results],
            [result.rms for result in results],
            [result.returns.mean() for result in results],
            ["" if r.injected is None else r.injected.mean() for r in results],
        ],
    )


def write_episodes(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per episode: its frequency, or else its number, and each controller's figures."""
    frequency, names = results[0].frequency, [result.name for result in results]
    write_csv(
        path,
        [
            "episode" if frequency is None else "frequency [rad/s]",
            *(f"cost of {name} [-]" for name in names),
            *(f"rms of x1 / scale of {name} [-]" for name in names),
        ],
        [
            np.arange(results[0].returns.size) if frequency is None else frequency,
            *(result.episode_costs for result in results),
            *(result.episode_rms for result in results),
        ],
    )


def print_ranking(
    results: Sequence[Evaluation], scene: Scene, not_scored: Mapping[str, str]
) -> None:
    """Print the controllers by their cost, the least first, and why others have none."""
    count, reference = results[0].returns.size, results[0]
    table = Table(title=f"cost: root of the mean of -reward per step, {count} held-out episodes")
    table.add_column("controller")
    table.add_column("reads", no_wrap=True)
    for heading in ("cost", "ratio", "rms x1", "return"):
        table.add_column(heading, justify="right", no_wrap=True)
    for result in sorted(results, key=lambda result: result.cost):
        table.add_row(
            result.name,
            result.reads,
            f"{result.cost:.3f}",
            f"{result.cost / reference.cost:.2f}",
            f"{result.rms:.3f}",
            f"{result.returns.mean():.2f}",
        )
    for text in not_scored_cells(not_scored):
        table.add_row(text)
    Console().print(
        table,
        f"ratio: cost / cost of {reference.name}",
        f"rms x1: over {scene.objective.displacement_scale * 1e3:g} mm",
        "return: mean over the episodes",
        sep="\n",
        highlight=False,
    )


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def not_scored_cells(not_scored: Mapping[str, str]) -> list[str]:
    """Return the cell of each controller that is not scored, in one line with the reason."""
    return [
        f"{name}: not scored: {'; '.join(reason.splitlines())}"
        for name, reason in not_scored.items()
    ]


def percent(value: float) -> str:
    """Return a ratio in whole per cent; nothing rounds to -0."""
    return f"{round(100.0 * value)} %"
