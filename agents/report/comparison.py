"""The files and the printed tables of a comparison."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from agents.comparison.conclusions import THRESHOLDS
from agents.report.tables import markdown, not_scored_cells
from mm_gym.files import write_csv, write_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from agents.comparison.conclusions import Comparison, Overall, Row
    from agents.evaluation.aggregates import Estimate

HEADER = ("controller", "reads", "seeds", "cost", "95 % interval", "score", "95 % interval")
TAIL = ("worst episode", "worst tenth")
PRINTED = ("controller", "cost", "95 % interval", "score", "95 % interval")
OVERALL = ("controller", "interquartile mean", "95 % interval")


def print_comparison(comparison: Comparison) -> None:
    """Print the ranking of each task, then that over all tasks."""
    console = Console()
    for result in comparison.results:
        rows = [_printed_cells(row) for row in comparison.tables[result.task]]
        without = [(cell,) for cell in not_scored_cells(result.not_scored)]
        _print(console, result.task, PRINTED, [*rows, *without])
    if comparison.overall:
        _print(console, "all tasks", OVERALL, [_overall_cells(one) for one in comparison.overall])
    console.print(_episodes(comparison), highlight=False)


def _print(
    console: Console, title: str, header: Sequence[str], rows: Iterable[Sequence[str]]
) -> None:
    table = Table(title=title)
    table.add_column(header[0])
    for heading in header[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _printed_cells(row: Row) -> tuple[str, ...]:
    label = row.label + (f", {row.trainings} seeds" if row.trainings > 1 else "")
    label += "" if row.reads == "observation" else f" ({row.reads})"
    score = ("", "") if row.score is None else _two(row.score, 2)
    return (label, *_two(row.cost, 3), *score)


def _cells(row: Row) -> tuple[str, ...]:
    score = ("", "") if row.score is None else _two(row.score)
    seeds = str(row.trainings) if row.trainings > 1 else ""
    return (
        row.label,
        row.reads,
        seeds,
        *_two(row.cost),
        *score,
        f"{row.worst:.4g}",
        f"{row.tail:.4g}",
    )


def _overall_cells(one: Overall) -> tuple[str, ...]:
    return (one.label, *_two(one.mean))


def _two(found: Estimate, digits: int = 4) -> tuple[str, str]:
    """Return a value and its interval with so many digits behind the point."""
    value, low, high = (f"{number:.{digits}f}" for number in found)
    return value, f"{low} to {high}"


def _episodes(comparison: Comparison) -> str:
    episodes = comparison.episodes
    last = episodes.first + episodes.seeds * episodes.each - 1
    return (
        f"{episodes.seeds} x {episodes.each} episodes, of seeds {episodes.first} to {last}, the "
        "same for all controllers; cost: root of the mean of -reward per step; score: 0 for the "
        "best constant action, 1 for the clairvoyant optimum (best found)"
    )


def write_comparison(comparison: Comparison, folder: Path) -> None:
    """Write tables as CSV, JSON and Markdown, and the penalty of every episode as CSV."""
    flat = [(task, row) for task, rows in comparison.tables.items() for row in rows]
    rows = [row for _, row in flat]
    none = [float("nan")] * 3
    scores = np.array([row.score or none for row in rows])
    costs = np.array([row.cost for row in rows])
    without = [(r.task, *one) for r in comparison.results for one in r.not_scored.items()]
    blank, nan = [""] * len(without), [none[0]] * len(without)
    write_csv(
        folder / "comparison.csv",
        [
            "task",
            "controller",
            "reads",
            "trainings",
            *("cost [-]", "cost, low [-]", "cost, high [-]"),
            *("score [-]", "score, low [-]", "score, high [-]"),
            *("worst episode [-]", "worst tenth [-]", "not scored"),
        ],
        [
            [*(task for task, _ in flat), *(task for task, _, _ in without)],
            [*(row.label for row in rows), *(label for _, label, _ in without)],
            [*(row.reads for row in rows), *blank],
            [*(row.trainings for row in rows), *blank],
            *([*column, *nan] for column in (*costs.T, *scores.T)),
            [*(row.worst for row in rows), *nan],
            [*(row.tail for row in rows), *nan],
            [*([""] * len(rows)), *(reason for _, _, reason in without)],
        ],
    )
    _write_episodes(comparison, folder / "episodes.csv")
    _write_studies(comparison, folder)
    _write_efforts(comparison, folder)
    write_text(folder / "comparison.json", json.dumps(as_data(comparison), indent=1) + "\n")
    write_text(folder / "comparison.md", page(comparison))


def _write_episodes(comparison: Comparison, path: Path) -> None:
    columns: list[list[object]] = [[], [], [], [], []]
    for result in comparison.results:
        for label, penalties in zip(result.labels, result.sample.penalties, strict=True):
            for (seed, episode), value in np.ndenumerate(penalties):
                cells = (result.task, label, seed, episode, value)
                for column, cell in zip(columns, cells, strict=True):
                    column.append(cell)
    header = ["task", "controller", "seed", "episode", "mean of -reward per step [-]"]
    write_csv(path, header, columns)


def _write_studies(comparison: Comparison, folder: Path) -> None:
    """Write what the studies gave, if there were any."""
    changed = [(r.task, one) for r in comparison.results for one in r.outcomes]
    if changed:
        names = ("study", "level", "label", "cost", "ratio", "worst", "tail")
        write_csv(
            folder / "robustness.csv",
            [
                *("task", "changed", "to", "controller", "cost [-]", "over cost as designed [-]"),
                *("worst episode [-]", "worst tenth [-]"),
            ],
            [
                [task for task, _ in changed],
                *([getattr(one, name) for _, one in changed] for name in names),
            ],
        )
    loops = [(r.task, loop) for r in comparison.results for loop in r.loops]
    if loops:
        cells = [
            (task, loop.label, force, w, gain, rest)
            for task, loop in loops
            for force, gains, rests in zip(loop.forces, loop.gain, loop.distortion, strict=True)
            for w, gain, rest in zip(loop.frequencies, gains, rests, strict=True)
        ]
        write_csv(
            folder / "frequency.csv",
            [
                *("task", "controller", "force [N]", "frequency [rad/s]"),
                *("amplitude of x1 over F / k1 [-]", "rest of x1 over all [-]"),
            ],
            list(zip(*cells, strict=True)),
        )


def _write_efforts(comparison: Comparison, folder: Path) -> None:
    """Write the indices of response and effort, if there are any."""
    found = [(r.task, one) for r in comparison.results for one in r.efforts]
    if found:
        names = list(found[0][1].indices)
        write_csv(
            folder / "effort.csv",
            ["task", "controller", "over", *(f"{name} [-]" for name in names)],
            [
                [task for task, _ in found],
                [one.label for _, one in found],
                [one.reference for _, one in found],
                *([one.indices[name] for _, one in found] for name in names),
            ],
        )


def as_data(comparison: Comparison) -> dict[str, object]:
    """Return all conclusions as what JSON can hold."""
    episodes = comparison.episodes
    return {
        "seeds": episodes.seeds,
        "episodes": episodes.each,
        "first_seed": episodes.first,
        "tasks": {
            task: [
                {
                    "controller": row.label,
                    "reads": row.reads,
                    "trainings": row.trainings,
                    "cost": row.cost._asdict(),
                    "score": None if row.score is None else row.score._asdict(),
                    "worst_episode": row.worst,
                    "worst_tenth": row.tail,
                }
                for row in rows
            ]
            for task, rows in comparison.tables.items()
        },
        "not_scored": {result.task: dict(result.not_scored) for result in comparison.results},
        "overall": [
            {
                "controller": one.label,
                "interquartile_mean": one.mean._asdict(),
                "probability_of_improvement": dict(one.improvement),
                "profile": one.profile.tolist(),
            }
            for one in comparison.overall
        ],
        "thresholds": THRESHOLDS.tolist(),
    }


def page(comparison: Comparison) -> str:
    """Return the tables in Markdown."""
    return "\n\n".join(_sections(comparison)) + "\n"


def _sections(comparison: Comparison) -> Iterator[str]:
    yield "# Comparison"
    yield f"{_episodes(comparison)}."
    header = (*HEADER, *TAIL)
    for result in comparison.results:
        rows = [_cells(row) for row in comparison.tables[result.task]]
        texts = [cell.replace("|", r"\|") for cell in not_scored_cells(result.not_scored)]
        without = [(text, *[""] * (len(header) - 1)) for text in texts]
        yield f"## {result.task}"
        yield markdown(header, [*rows, *without])
    if not comparison.overall:
        return
    yield "## All tasks"
    yield markdown(OVERALL, [_overall_cells(one) for one in comparison.overall])
    names = [one.label for one in comparison.overall]
    yield "Probability that the controller of a row does better than that of a column:"
    yield markdown(
        ["", *names],
        [
            [
                one.label,
                *(f"{one.improvement[n]:.2f}" if n in one.improvement else "" for n in names),
            ]
            for one in comparison.overall
        ],
    )
