"""The figures of the page of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.evaluation.aggregates import performance_profile
from agents.evaluation.studies import NOMINAL
from agents.report.figures import logarithmic, study_label
from agents.scoring import Evaluation
from agents.sweeps.on_task import STUDIES, OnTask, algorithms_of
from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, STYLES, legend_below, panels, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


THRESHOLDS = np.linspace(-0.2, 1.05, 126)  # scores at which the performance profile is taken
WINDOW = 60  # control steps of an episode that are shown

MOST, MARGIN = 2.0, 1.01
"""Most cost on a learning curve, over the reference's; and its least, below all costs."""

BEST = "best on each task"  # label of the line that has the best algorithm's trainings of each task

LAW = {"color": "0.4", "linestyle": (0, (6, 2, 1, 2, 1, 2)), "label": "reference controller"}
"""How the reference controller's line looks."""


def draw_results(known: Sequence[OnTask], folder: Path) -> list[Path]:
    """Draw all figures into a folder, which is made if need be; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    found = [folder / f"{name}.png" for name in ("curves", "profile", "robustness", "episodes")]
    with style():
        for draw, path in zip((_curves, _profile, _robustness, _episodes), found, strict=True):
            draw(known, path)
    return found


def _curves(known: Sequence[OnTask], path: Path) -> None:
    """Draw the least cost so far over time, a panel a task: the median of the seeds, and all."""
    rows = -(-len(known) // 2)
    figure, axes = panels(1.7 * rows + 0.4, rows, 2)
    for panel in axes[len(known) :]:
        panel.set_visible(False)
    for one, panel in zip(known, axes, strict=False):
        panel.axhline(one.law_validation, **LAW)
        for trainings in one.trainings:
            seconds, (least, median, most) = trainings.middle_curve()
            look = _look(known, trainings.algorithm)
            panel.fill_between(seconds, least, most, color=look["color"], alpha=0.2, linewidth=0)
            panel.plot(seconds, median, **look)
        panel.set(title=one.name, ylabel="cost [-]")
        low = min(curve.costs.min() for of in one.trainings for curve in of.curves)
        panel.set_ylim(low / MARGIN, min(panel.get_ylim()[1], MOST * one.law_validation))
        logarithmic(panel)
        logarithmic(panel, "x")
    for panel in axes[max(len(known) - 2, 0) : len(known)]:
        panel.set_xlabel("time [s]")
    legend_below(figure, max(axes, key=_entries), len(STYLES) + 1)
    save(figure, path)


def _entries(panel: Axes) -> int:
    """Return the number of entries of a panel's legend: some tasks lack an algorithm."""
    return len(panel.get_legend_handles_labels()[1])


def _look(known: Sequence[OnTask], algorithm: str) -> dict[str, Any]:
    """Return how the line of an algorithm or of the reference looks, the same on all figures."""
    if algorithm == LAW["label"]:
        return LAW
    number = [*algorithms_of(known), BEST].index(algorithm)
    style = STYLES[number % len(STYLES)]
    return {"color": COLOURS[number], "linestyle": style, "label": algorithm}


def _profile(known: Sequence[OnTask], path: Path) -> None:
    """Draw which fraction of all trainings and tasks has more than a score."""
    figure, (panel,) = panels(2.6, 1, 1)
    everywhere = [name for name in algorithms_of(known) if all(_has(one, name) for one in known)]
    rows = {name: [one.scores(_costs(one, name)) for one in known] for name in everywhere}
    rows[BEST] = [one.scores(one.best.costs) for one in known]
    rows[LAW["label"]] = [one.scores(np.array([one.law.cost])) for one in known]
    for name, scores in rows.items():
        parts = np.mean([performance_profile(own[None], THRESHOLDS) for own in scores], axis=0)
        panel.plot(THRESHOLDS, parts, **_look(known, name))
    panel.set(
        xlabel="score s (0: best constant, 1: clairvoyant optimum)",
        ylabel="fraction of trainings above s",
    )
    panel.set_ylim(-0.02, 1.02)
    legend_below(figure, panel, len(rows))
    save(figure, path)


def _has(one: OnTask, name: str) -> bool:
    return any(of.algorithm == name for of in one.trainings)


def _costs(one: OnTask, name: str) -> Array:
    return next(of.costs for of in one.trainings if of.algorithm == name)


def _robustness(known: Sequence[OnTask], path: Path) -> None:
    """Draw costs on changed scenes, a row a task and a column for what is changed."""
    figure, axes = panels(1.15 * len(known) + 0.5, len(known), len(STUDIES))
    for row, one in enumerate(known):
        own = axes[row * len(STUDIES) : (row + 1) * len(STUDIES)]
        for panel, study in zip(own, STUDIES, strict=True):
            _study(panel, one, study, known)
        own[0].set_title(one.name, loc="left")
    for panel, study in zip(axes[-len(STUDIES) :], STUDIES, strict=True):
        panel.set_xlabel(study_label(study))
    for panel in axes[:: len(STUDIES)]:
        panel.set_ylabel("cost [-]")
    legend_below(figure, max(axes, key=_entries), len(STYLES) + 1)
    save(figure, path)


def _study(panel: Axes, one: OnTask, study: str, known: Sequence[OnTask]) -> None:
    for label in dict.fromkeys(outcome.label for outcome in one.outcomes):
        own = [outcome for outcome in one.outcomes if outcome.label == label]
        points = [(outcome.level, outcome.cost) for outcome in own if outcome.study == study]
        designed = STUDIES[study]
        if designed is not None:
            cost = next(outcome.cost for outcome in own if outcome.study == NOMINAL)
            points.append((designed, cost))
        panel.plot(*np.array(sorted(points)).T, marker=".", **_look(known, label))
    panel.margins(x=0.05)
    logarithmic(panel)


def _episodes(known: Sequence[OnTask], path: Path) -> None:
    """Draw displacement and stretch around the largest displacement, a column a task."""
    shown = {one.name: one.examples for one in known if one.examples}
    if shown:
        with_strips(shown, path)


def with_strips(shown: Mapping[str, Sequence[Evaluation]], path: Path) -> None:
    """Draw the displacements of an episode in one panel, and each stretch in a strip of its own.

    Each task has the episode under the reference controller, the best agent and the plan.
    """
    labels = ("reference controller", "best agent", "plan")
    figure, axes = panels(
        4.4, 1 + len(labels), len(shown), sharex="col", heights=(2.2, *(1.0 for _ in labels))
    )
    for column, (name, examples) in enumerate(shown.items()):
        upper, *strips = axes[column :: len(shown)]
        peak = int(np.abs(examples[1].displacement[:, 0]).argmax())
        first = min(max(peak - WINDOW // 3, 0), len(examples[1].time) - WINDOW)
        part = slice(first, first + WINDOW)
        for k, (label, result) in enumerate(zip(labels, examples, strict=True)):
            look = {"color": COLOURS[k], "label": label, "linewidth": 0.9}
            upper.plot(result.time[part], result.displacement[part, 0], STYLES[k], **look)
            # An actuator holds still over the control step that ends at each instant.
            stretch = result.applied[part, 0, -1]
            strips[k].plot(result.time[part], stretch, STYLES[k], drawstyle="steps-pre", **look)
        limits = np.array([strip.get_ylim() for strip in strips])
        for strip in strips:
            strip.set_ylim(limits.min(), limits.max())
        upper.set_title(name)
        strips[-1].set_xlabel("time [s]")
    axes[0].set_ylabel("x1 / scale [-]")
    for strip in axes[len(shown) :: len(shown)]:
        strip.set_ylabel("λ [-]")
    legend_below(figure, axes[0], 3)
    save(figure, path)
