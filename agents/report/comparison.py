"""The files, the printed tables and the figures of a comparison."""

import json
import re
from collections.abc import Iterator, Sequence
from math import nan
from pathlib import Path

import numpy as np
from rich.console import Console

from agents.evaluation.aggregates import Estimate
from agents.evaluation.conclusions import THRESHOLDS, Comparison, Overall, Row
from agents.report.charts import LINE, draw, frequency, robustness
from agents.report.pages import (
    decimals,
    not_scored_cells,
    percent,
    print_table,
    render,
    write_rows,
)
from mm_gym import SceneError
from mm_gym.drawing import COLOURS, STYLES, legend_below, panels, save, style
from mm_gym.files import read_text, write_text

COST, SCORE = ("cost", "95 % interval"), ("score", "95 % interval")
PAIRED = ("controller", "change of cost", "95 % interval", "episodes won")
MOST_BYTES = 2**24  # largest ``comparison.json`` of an earlier comparison
OVERALL = ("controller", "interquartile mean", "95 % interval")


def report_comparison(comparison: Comparison, folder: Path | None = None) -> None:
    """Print the tables, and write them with figures to a folder.

    Raise `SceneError` if nothing but the reference could be scored on any task.
    """
    results = comparison.results
    nothing = [
        f"{one.task}: {text}" for one in results for text in not_scored_cells(one.not_scored)
    ]
    if nothing and all(len(one.labels) == 1 for one in results):
        raise SceneError("\n".join(nothing))
    print_comparison(comparison)
    if folder is not None:
        write_comparison(comparison, folder)
        draw_comparison(comparison, folder)
        print(f"written: {folder}/")


def print_comparison(comparison: Comparison) -> None:
    """Print the ranking of each task, then that over all tasks, or differences on a single one."""
    for result in comparison.results:
        table = comparison.tables[result.task]
        header = ("controller", *COST, *(SCORE if _have_scores(table) else ()))
        digits = decimals(row.cost.value for row in table)
        rows = [_printed_cells(row, digits) for row in table]
        without = [(cell,) for cell in not_scored_cells(result.not_scored)]
        print_table(result.task, header, [*rows, *without])
    if comparison.overall:
        means = [(one.controller, *_two(one.interquartile_mean, 4)) for one in comparison.overall]
        print_table("all tasks", OVERALL, means)
    if len(comparison.results) == 1 and len(comparison.results[0].labels) > 1:
        (result,) = comparison.results
        rows = comparison.tables[result.task]
        paired = [(row.controller, *paired_cells(row)) for row in rows if row.change is not None]
        print_table(f"in the same episodes as {result.against}", PAIRED, paired)
    Console().print(episodes_in_words(comparison), highlight=False)


def _have_scores(rows: Sequence[Row]) -> bool:
    """Tell whether the rows of a task have scores, as only tasks with committed costs do."""
    return any(row.score is not None for row in rows)


def _printed_cells(row: Row, digits: int) -> tuple[str, ...]:
    label = row.controller + (f", {row.trainings} seeds" if row.trainings > 1 else "")
    label += "" if row.reads == "observation" else f" ({row.reads})"
    score = () if row.score is None else _two(row.score, 2)
    return (label, *_two(row.cost, digits), *score)


def paired_cells(row: Row) -> tuple[str, str, str]:
    """Return how a row compares with the reference in the same episodes, with the interval."""
    if row.change is None:
        return "", "", ""
    # Adding 0 makes -0 a 0.
    value, low, high = (f"{round(100.0 * number, 1) + 0.0:+.1f} %" for number in row.change)
    return value, f"{low} to {high}", percent(row.episodes_won)


def _two(found: Estimate, digits: int) -> tuple[str, str]:
    """Return a value and its interval with so many digits behind the point."""
    value, low, high = (f"{number:.{digits}f}" for number in found)
    return value, f"{low} to {high}"


def episodes_in_words(comparison: Comparison) -> str:
    """Return which episodes were run, what cost is, and what score is if there is any."""
    episodes = comparison.episodes
    last = episodes.first + episodes.seeds * episodes.each - 1
    told = (
        f"{episodes.seeds} x {episodes.each} episodes, of seeds {episodes.first} to {last}, the "
        "same for all controllers; cost: root of the mean of -reward per step"
    )
    if any(map(_have_scores, comparison.tables.values())):
        told += (
            "; score: 0 for the best constant action, 1 for the clairvoyant optimum (best found)"
        )
    return told


def write_comparison(comparison: Comparison, folder: Path) -> None:
    """Write tables as CSV, JSON and Markdown, and the penalty of every episode as CSV.

    Files that only some comparisons have are deleted first, where the folder has an earlier one.
    """
    _delete_earlier(folder)
    results = comparison.results
    write_rows(folder / "comparison.csv", _scores(comparison))
    write_rows(
        folder / "episodes.csv",
        (
            {
                "task": result.task,
                "controller": label,
                "seed": seed,
                "episode": episode,
                "mean of -reward per step [-]": value,
            }
            for result in results
            for label, penalties in zip(result.labels, result.sample.penalties, strict=True)
            for (seed, episode), value in np.ndenumerate(penalties)
        ),
    )
    write_rows(
        folder / "robustness.csv",
        (
            {
                "task": result.task,
                "changed": one.study,
                "to": one.level,
                "controller": one.label,
                "cost [-]": one.cost,
                "over cost as designed [-]": one.ratio,
                "worst episode [-]": one.worst,
                "worst tenth [-]": one.tail,
            }
            for result in results
            for one in result.outcomes
        ),
    )
    write_rows(
        folder / "frequency.csv",
        (
            {
                "task": result.task,
                "controller": loop.label,
                "force [N]": force,
                "frequency [rad/s]": w,
                "amplitude of x1 over F / k1 [-]": gain,
                "rest of x1 over all [-]": rest,
            }
            for result in results
            for loop in result.loops
            for force, gains, rests in zip(loop.forces, loop.gain, loop.distortion, strict=True)
            for w, gain, rest in zip(loop.frequencies, gains, rests, strict=True)
        ),
    )
    write_rows(
        folder / "effort.csv",
        ({"task": result.task} | dict(one) for result in results for one in result.efforts),
    )
    write_text(folder / "comparison.json", json.dumps(as_data(comparison), indent=1) + "\n")
    write_text(folder / "comparison.md", page(comparison))


def _delete_earlier(folder: Path) -> None:
    """Delete the files of an earlier comparison in a folder that the next need not have."""
    try:
        tasks = json.loads(read_text(folder / "comparison.json", most=MOST_BYTES))["tasks"]
        names = [_file_name(task, list(tasks)) for task in tasks]
    except (OSError, ValueError, LookupError, TypeError):  # none, or none of a comparison
        return
    figures = [f"{kind}_{name}.png" for name in names for kind in ("robustness", "frequency")]
    for name in ("robustness.csv", "frequency.csv", "effort.csv", "scores.png", *figures):
        (folder / name).unlink(missing_ok=True)


def _scores(comparison: Comparison) -> Iterator[dict[str, object]]:
    """Yield a row for every controller, those last that have no score."""
    none = Estimate(nan, nan, nan)
    names = ("", ", low", ", high")
    for task, rows in comparison.tables.items():
        for row in rows:
            score = row.score or none
            yield {
                "task": task,
                "controller": row.controller,
                "reads": row.reads,
                "trainings": row.trainings,
                **{f"cost{name} [-]": end for name, end in zip(names, row.cost, strict=True)},
                **{f"score{name} [-]": end for name, end in zip(names, score, strict=True)},
                "worst episode [-]": row.worst_episode,
                "worst tenth [-]": row.worst_tenth,
                **{
                    f"change of cost{name} [-]": end
                    for name, end in zip(names, row.change or none, strict=True)
                },
                "episodes won [-]": row.episodes_won,
                "not scored": "",
            }
    for result in comparison.results:
        for label, reason in result.not_scored.items():
            unknown = {"task": result.task, "controller": label, "not scored": reason}
            yield dict.fromkeys(("reads", "trainings"), "") | unknown


def as_data(comparison: Comparison) -> dict[str, object]:
    """Return all conclusions as what JSON can hold."""
    episodes = comparison.episodes
    return {
        "seeds": episodes.seeds,
        "episodes": episodes.each,
        "first_seed": episodes.first,
        "tasks": {
            task: [_as_data(row) for row in rows] for task, rows in comparison.tables.items()
        },
        "compared_with": {result.task: result.against for result in comparison.results},
        "not_scored": {result.task: dict(result.not_scored) for result in comparison.results},
        "overall": [_as_data(one) for one in comparison.overall],
        "thresholds": THRESHOLDS.tolist(),
    }


def _as_data(one: Row | Overall) -> dict[str, object]:
    """Return the fields of a row as what JSON can hold."""
    found: dict[str, object] = dict(vars(one))
    for name, value in found.items():
        if isinstance(value, Estimate):
            found[name] = value._asdict()
        elif isinstance(value, np.ndarray):
            found[name] = value.tolist()
    return found


def page(comparison: Comparison) -> str:
    """Return the tables in Markdown."""
    return render(
        "comparison",
        **vars(comparison) | {"episodes": episodes_in_words(comparison)},
        paired=paired_cells,
        not_scored=not_scored_cells,
    )


def draw_comparison(comparison: Comparison, folder: Path) -> None:
    """Draw all figures of a comparison into a folder."""
    draw_intervals(comparison, folder / "costs.png")
    if comparison.overall:
        draw_aggregates(comparison, folder / "scores.png")
    for result in comparison.results:
        name = _file_name(result.task, [one.task for one in comparison.results])
        if result.outcomes:
            draw(robustness(result.outcomes), result.labels, folder / f"robustness_{name}.png")
        if result.loops:
            draw(frequency(result.loops), result.labels, folder / f"frequency_{name}.png", 1)


def _file_name(task: str, tasks: Sequence[str]) -> str:
    """Return the part of a file's name that tells a task's figure from those of the others."""
    stem = Path(task).stem.lower()
    if [Path(one).stem.lower() for one in tasks].count(stem) > 1:
        stem = task
    return re.sub(r"[^\w.-]+", "_", stem)


def draw_intervals(comparison: Comparison, path: Path) -> None:
    """Draw the cost of every controller with its interval, a panel a task, the best on top."""
    tables = list(comparison.tables.items())
    rows = [len(table) for _, table in tables]
    height = LINE * sum(rows) + 0.75 * len(rows)
    with style():
        figure, axes = panels(height, len(rows), 1, heights=rows)
        for panel, (task, table) in zip(axes, tables, strict=True):
            places = -np.arange(len(table))
            values = [row.cost.value for row in table]
            for place, row in zip(places, table, strict=True):
                informed = row.reads != "observation"
                ends = row.cost.low, row.cost.high
                panel.plot(ends, (place, place), color=COLOURS[informed], linewidth=2.0)
            panel.plot(values, places, ".", color=COLOURS[-1], markersize=5.0)
            panel.set_yticks(places, [row.controller for row in table])
            panel.grid(visible=False, axis="y")
            panel.margins(x=0.03)
            panel.set_ylim(0.7 - len(table), 0.7)
            panel.set_title(task)
        more = any(row.reads != "observation" for _, table in tables for row in table)
        told = "; orange: reads more than an agent" if more else ""
        axes[-1].set_xlabel(f"cost [-] with 95 % intervals{told}")
        save(figure, path)


def draw_aggregates(comparison: Comparison, path: Path) -> None:
    """Draw interquartile means with intervals, and the performance profiles."""
    overall = comparison.overall
    with style():
        figure, (left, right) = panels(3.2, 1, 2)
        for k, one in enumerate(overall):
            look = {"color": COLOURS[k % len(COLOURS)], "label": one.controller}
            left.plot(
                (one.interquartile_mean.low, one.interquartile_mean.high),
                (-k, -k),
                color=look["color"],
                linewidth=4.0,
            )
            left.plot(one.interquartile_mean.value, -k, "|", color=COLOURS[-1], markersize=9.0)
            part, low, high = one.profile.T
            right.plot(THRESHOLDS, part, STYLES[k // len(COLOURS) % len(STYLES)], **look)
            right.fill_between(THRESHOLDS, low, high, color=look["color"], alpha=0.15, linewidth=0)
        left.set_yticks(-np.arange(len(overall)), [one.controller for one in overall])
        left.grid(visible=False, axis="y")
        left.margins(x=0.05, y=0.1)
        left.set_xlabel("interquartile mean of s [-], 95 % intervals")
        right.set(
            xlabel="score s (0: best constant, 1: best found)", ylabel="fraction of scores above s"
        )
        right.set_ylim(-0.02, 1.02)
        legend_below(figure, right, 3)
        save(figure, path)
