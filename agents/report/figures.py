"""The figures of a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.studies import DELAY, NOISE, RECORD
from agents.scoring import Evaluation
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.drawing import ACTUATORS, COLOURS, STYLES, legend_below, panels, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


IN_A_BIN = 10  # episodes that each point of a line stands for
NARROW = 4.0  # ratio of an axis's ends below which round numbers are better ticks than 1, 2 and 5
WIDE = 1e4  # and from which powers of ten alone fit
*BASELINES, LEARNED = COLOURS  # colours: black is the learned controller's, the last of all results


def draw_costs(results: Sequence[Evaluation], scene: Scene, path: Path) -> None:
    """Draw the cost of each controller against frequency, or from easy to hard episodes.

    The frequency is that of the first harmonic, where the scene draws it. A line goes through bins
    of ten episodes; the dots are single episodes of the last controller.
    """
    position, label = _abscissa(results[0], scene)
    bins = np.array_split(np.argsort(position), max(position.size // IN_A_BIN, 1))
    centres = [position[members].mean() for members in bins]
    with style():
        figure, (axes,) = panels(4.4, 1, 1)
        for i, result in enumerate(results):
            learned = result is results[-1]
            drawn, colour = ("-", LEARNED) if learned else look_of(i)
            axes.plot(
                centres,
                [np.sqrt(result.penalties[members].mean()) for members in bins],
                drawn,
                color=colour,
                linewidth=1.8 if learned else 1.2,
                label=f"{result.cost:.3f}  {result.name}",
            )
        look = {"color": LEARNED, "markersize": 4.0, "alpha": 0.4, "markeredgewidth": 0.0}
        axes.plot(position, results[-1].episode_costs, ".", **look)
        if any(result.penalties.any() for result in results):
            logarithmic(axes)
        axes.margins(x=0.01)
        axes.set(xlabel=label, ylabel="cost: root of the mean of -reward [-]")
        axes.set_title(
            f"{position.size} held-out episodes: lines through bins of {IN_A_BIN}, "
            f"dots are single episodes of {results[-1].name}"
        )
        legend_below(figure, axes, 2)
        save(figure, path)


def look_of(i: int) -> tuple[str, str]:
    """Return the style and the colour of a baseline's line; those of the first 24 differ."""
    around = i // math.lcm(len(STYLES), len(BASELINES))
    return STYLES[(i + around) % len(STYLES)], BASELINES[i % len(BASELINES)]


def _abscissa(reference: Evaluation, scene: Scene) -> tuple[Array, str]:
    """Return where each episode lies on the axis, and the axis's label."""
    if reference.frequency is not None:
        return reference.frequency, f"frequency of the harmonic {_excited(scene)} [rad/s]"
    rank = np.argsort(np.argsort(reference.penalties)) + 1.0
    return rank, f"rank of the episode by the cost of {reference.name}"


def _excited(scene: Scene) -> str:
    """Return what the first harmonic excites."""
    return "ground motion" if scene.excitation[0].target == "ground" else "force"


def logarithmic(axes: Axes, which: str = "y") -> None:
    """Let an axis, x or y, be logarithmic with few ticks in plain digits; call it after drawing."""
    from matplotlib.ticker import (  # noqa: PLC0415 - optional
        LogLocator,
        MaxNLocator,
        NullFormatter,
        NullLocator,
    )

    axes.set(**{f"{which}scale": "log"})
    low, high = axes.get_ylim() if which == "y" else axes.get_xlim()
    axis = axes.yaxis if which == "y" else axes.xaxis
    if high < NARROW * low:
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < WIDE * low else (1.0,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def study_label(study: str) -> str:
    """Return the label of the axis over which a study of robustness is drawn."""
    part = study.removeprefix("carriage.")
    labels = {NOISE: "sensor noise over scale [-]", DELAY: "delay [control steps]"}
    labels[RECORD] = "recorded motion"
    return labels.get(study, f"carriage {part} over the scene's [-]")


def draw_response(reference: Evaluation, learned: Evaluation, scene: Scene, path: Path) -> None:
    """Draw displacement and actuators over time, in the reference's median episode."""
    episode = int(np.argsort(reference.penalties)[reference.penalties.size // 2])
    names = scene.actuation.names
    count = 1 + len(names)
    millimetres = 1e3 * scene.objective.displacement_scale
    with style():
        figure, axes = panels(1.8 * count + 0.6, count, 1, sharex="all")
        for result, colour in ((reference, BASELINES[0]), (learned, LEARNED)):
            look = {"color": colour, "linewidth": 1.0, "label": result.name}
            axes[0].plot(result.time, millimetres * result.displacement[:, episode], **look)
            for panel, values in zip(axes[1:], result.applied[:, episode].T, strict=True):
                # An actuator holds still over the control step that ends at each instant.
                panel.plot(result.time, values, drawstyle="steps-pre", **look)
        for panel, name in zip(axes[1:], names, strict=True):
            panel.set_ylabel(ACTUATORS[name])
        axes[0].set_ylabel("carriage $x_1$ [mm]")
        axes[-1].set(xlabel="time [s]", xlim=(0.0, reference.time[-1]))
        where = f"Held-out episode {episode}, of median cost for {reference.name}"
        if reference.frequency is not None:
            where += f": harmonic {_excited(scene)} at {reference.frequency[episode]:.1f} rad/s"
        axes[0].set_title(where)
        figure.align_ylabels(axes)
        legend_below(figure, axes[0], 2)
        save(figure, path)
