"""The figures of a comparison."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.conclusions import THRESHOLDS, Comparison
from agents.evaluation.measure import TaskResult
from agents.evaluation.studies import DELAY, NOISE, NOMINAL, RECORD
from agents.report.figures import logarithmic, study_label
from mm_gym.drawing import COLOURS, STYLES, legend_below, panels, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LINE = 0.17  # height of a line of text [inch]
COLUMNS = 2  # panels side by side


def draw_comparison(comparison: Comparison, folder: Path) -> None:
    """Draw all figures of a comparison into a folder."""
    draw_intervals(comparison, folder / "costs.png")
    if comparison.overall:
        draw_aggregates(comparison, folder / "scores.png")
    for result in comparison.results:
        name = _file_name(result.task, [one.task for one in comparison.results])
        if result.outcomes:
            draw_robustness(result, folder / f"robustness_{name}.png")
        if result.loops:
            draw_closed_loops(result, folder / f"frequency_{name}.png")


def names_of_some(tasks: Sequence[str]) -> list[str]:
    """Return the names of the figures that not every comparison of these tasks has."""
    kinds = ("robustness", "frequency")
    return ["scores.png", *(f"{k}_{_file_name(task, tasks)}.png" for task in tasks for k in kinds)]


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
            panel.set_yticks(places, [row.label for row in table])
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
            look = {"color": COLOURS[k % len(COLOURS)], "label": one.label}
            left.plot((one.mean.low, one.mean.high), (-k, -k), color=look["color"], linewidth=4.0)
            left.plot(one.mean.value, -k, "|", color=COLOURS[-1], markersize=9.0)
            part, low, high = one.profile.T
            right.plot(THRESHOLDS, part, STYLES[k // len(COLOURS) % len(STYLES)], **look)
            right.fill_between(THRESHOLDS, low, high, color=look["color"], alpha=0.15, linewidth=0)
        left.set_yticks(-np.arange(len(overall)), [one.label for one in overall])
        left.grid(visible=False, axis="y")
        left.margins(x=0.05, y=0.1)
        left.set_xlabel("interquartile mean of s [-], 95 % intervals")
        right.set(
            xlabel="score s (0: best constant, 1: best found)", ylabel="fraction of scores above s"
        )
        right.set_ylim(-0.02, 1.02)
        legend_below(figure, right, 3)
        save(figure, path)


def draw_robustness(result: TaskResult, path: Path) -> None:
    """Draw each controller's cost over what is changed, a panel a study, the records in one."""
    studies = list(dict.fromkeys(one.study for one in result.outcomes if one.study != NOMINAL))
    records = [study for study in studies if study.startswith(RECORD)]
    titles = [study for study in studies if study not in records] + [RECORD] * bool(records)
    rows = -(-len(titles) // COLUMNS)
    height = 2.2 * rows + LINE * len(result.labels) / COLUMNS + 0.5
    with style():
        figure, axes = panels(height, rows, COLUMNS, sharey="all")
        for panel in axes[len(titles) :]:
            panel.set_visible(False)
        for panel, title in zip(axes, titles, strict=False):
            for k, label in enumerate(result.labels):
                points = _points(result, label, title)
                panel.plot(*np.array(points).T, **_look(k), marker=".", label=label)
            panel.set_xlabel(study_label(title))
            panel.margins(x=0.04)
            logarithmic(panel)
            if title == RECORD:
                panel.set_xticks(range(len(records)), [name.partition(" ")[2] for name in records])
                panel.margins(x=0.5)
            elif title == DELAY:
                panel.set_xticks(range(len(_points(result, result.labels[0], title))))
        for panel in axes[::COLUMNS]:
            panel.set_ylabel("cost [-]")
        legend_below(figure, axes[0], COLUMNS)
        save(figure, path)


def _points(result: TaskResult, label: str, study: str) -> list[tuple[float, float]]:
    """Return levels and costs of a controller in a study, with the scene as designed among them."""
    own = [one for one in result.outcomes if one.label == label]
    as_designed = next(one.cost for one in own if one.study == NOMINAL)
    if study == RECORD:
        costs = [one.cost for one in own if one.study.startswith(RECORD)]
        return [(float(k), cost) for k, cost in enumerate(costs)]
    points = [(one.level, one.cost) for one in own if one.study == study]
    if study.startswith("carriage."):
        points.append((1.0, as_designed))
    elif study == NOISE:
        points.append((0.0, as_designed))
    return sorted(points)


def draw_closed_loops(result: TaskResult, path: Path) -> None:
    """Draw each controller's steady amplitude over frequency, a panel an amplitude of the force."""
    forces = result.loops[0].forces
    with style():
        figure, axes = panels(
            2.1 * len(forces) + LINE * len(result.loops) / 2 + 0.4, len(forces), 1, sharex="all"
        )
        for k, loop in enumerate(result.loops):
            for panel, gain in zip(axes, loop.gain, strict=True):
                panel.plot(loop.frequencies, gain, **_look(k), label=loop.label)
        for panel, force in zip(axes, forces, strict=True):
            panel.set_xscale("log")
            logarithmic(panel)
            panel.set_title(f"harmonic force of {force:.3g} N")
            panel.set_ylabel("|x1| k1 / F [-]")
        axes[-1].set_xlabel("frequency of the force [rad/s]")
        _plain_digits(axes[-1])
        legend_below(figure, axes[0], 2)
        save(figure, path)


def _look(k: int) -> dict[str, str]:
    """Return colour and style of the k-th controller, so that equal lines can be told apart."""
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": STYLES[k % len(STYLES)]}


def _plain_digits(axes: Axes) -> None:
    """Write frequencies in plain digits."""
    from matplotlib.ticker import (  # noqa: PLC0415 - optional
        LogLocator,
        NullFormatter,
        ScalarFormatter,
    )

    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)))
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
