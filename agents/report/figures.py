"""The figures of a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from agents.controllers.controller import columns

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from agents.evaluation.episodes import Evaluation
    from mm_gym import Scene

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
"""Okabe and Ito's palette, which colour-blind readers tell apart."""

STYLES = ("-", "--", "-.", ":")
LABELS = {"force": "control force [N]", "stretch": "stretch [-]"}


def draw_scores(results: list[Evaluation], scene: Scene, path: Path) -> None:
    """Draw the score of each controller against frequency.

    The lines are of bins of ten episodes; the dots are the learned agent's episodes.
    """
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    for i, result in enumerate(results):
        frequency, score = _binned(result)
        axes.plot(
            frequency,
            score,
            STYLES[i % len(STYLES)],
            color=COLOURS[i % len(COLOURS)],
            linewidth=2.4 if result is results[-1] else 1.4,
            label=f"{result.name}: {result.score:.3f}",
        )
    last = results[-1]
    colour = COLOURS[(len(results) - 1) % len(COLOURS)]
    axes.plot(last.frequency, last.episode_scores, ".", color=colour, markersize=3, alpha=0.6)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("frequency of the force [rad/s]" if scene.excitation else "held-out episode")
    axes.set_ylabel(f"rms of x1 / {scene.objective.displacement_scale * 1e3:g} mm [-]")
    axes.set_title(
        "Each point pools ten held-out episodes; dots are single ones of the learned agent",
        fontsize=10,
    )
    figure.legend(loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    axes.grid(visible=True, which="major", alpha=0.25)
    _save(figure, path)


def _binned(result: Evaluation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean frequency and pooled score of each bin of ten episodes, by frequency."""
    order = np.argsort(result.frequency)
    bins = np.array_split(order, max(order.size // 10, 1))
    frequency = np.array([result.frequency[members].mean() for members in bins])
    return frequency, np.array(
        [np.sqrt(np.mean(result.episode_scores[members] ** 2)) for members in bins]
    )


def draw_response(reference: Evaluation, learned: Evaluation, scene: Scene, path: Path) -> None:
    """Draw displacement and actuators over time, in the reference's median episode."""
    episode = int(np.argsort(reference.episode_scores)[reference.episode_scores.size // 2])
    names = columns(scene)
    figure = Figure(figsize=(6.4, 2.4 + 1.6 * len(names)), layout="constrained")
    grid = figure.subplots(1 + len(names), 1, sharex=True, height_ratios=[2] + [1] * len(names))
    for i, result in enumerate((reference, learned)):
        look = {"color": COLOURS[i], "linewidth": 1.1, "linestyle": STYLES[0], "zorder": 2 + i}
        grid[0].plot(result.time, result.displacement[:, episode], label=result.name, **look)
        for k, name in enumerate(names):
            grid[1 + k].plot(result.time, result.applied[:, episode, k], **look)
            grid[1 + k].set_ylabel(LABELS[name])
    grid[0].set_ylabel(f"x1 / {scene.objective.displacement_scale * 1e3:g} mm [-]")
    grid[-1].set_xlabel("time [s]")
    where = f" at {reference.frequency[episode]:.1f} rad/s" if scene.excitation else ""
    grid[0].set_title(f"The reference's median held-out episode{where}", fontsize=10)
    figure.legend(
        *grid[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        fontsize=8,
        frameon=False,
    )
    for axes in grid:
        axes.grid(visible=True, alpha=0.25)
        axes.margins(x=0.01)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    """Write the picture whole: beside its path, then renamed."""
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    FigureCanvasAgg(figure).print_figure(temporary, dpi=200)
    temporary.replace(path)
