"""Charts of scores: what they show, for the web page and for figures alike, and the figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.evaluation.changed_scenes import DELAY, NOISE, NOMINAL, RECORD, Outcome
from agents.evaluation.closed_loop import ClosedLoop
from agents.report.pages import decimals
from agents.scoring import Evaluation
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.drawing import ACTUATORS, COLOURS, STYLES, legend_below, panels, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Panel:
    """Axes with a curve of each controller over common abscissas."""

    # x, curves: abscissas (n,), and ordinates (n,) of each controller, not finite where there is
    # nothing to draw; a controller without a curve has an empty one
    x: Array
    curves: Sequence[Array]
    # x_label, y_label: with units
    x_label: str
    y_label: str
    # x_log, y_log: whether an axis is logarithmic
    x_log: bool = False
    y_log: bool = False
    held: bool = False  # whether a value holds from the instant before to its own
    title: str = ""  # above the axes
    ticks: Sequence[str] = ()  # names of the abscissas, if they are few and no quantity


def robustness(outcomes: Sequence[Outcome]) -> list[Panel]:
    """Return each controller's cost over what is changed: a panel a study, the records in one."""
    designed = {one.label: one.cost for one in outcomes if one.study == NOMINAL}
    changed = [one for one in outcomes if one.study != NOMINAL]
    records = list(dict.fromkeys(one.study for one in changed if one.study.startswith(RECORD)))
    studies: dict[str, dict[tuple[float, str], float]] = {}
    for one in changed:
        study, level = one.study, one.level
        if study in records:
            study, level = RECORD, float(records.index(study))
        studies.setdefault(study, {})[level, one.label] = one.cost
    found: list[Panel] = []
    for study, costs in studies.items():
        if study not in {DELAY, RECORD}:  # a delay has the scene's own among its levels
            costs |= {
                (0.0 if study == NOISE else 1.0, name): cost for name, cost in designed.items()
            }
        levels = sorted({level for level, _ in costs})
        curves = [np.array([costs[level, name] for level in levels]) for name in designed]
        ticks = {
            RECORD: [name.partition(" ")[2] for name in records],
            DELAY: [f"{level:g}" for level in levels],
        }
        part = study.removeprefix("carriage.")
        label = LABELS.get(study, f"carriage {part} over the scene's [-]")
        found.append(
            Panel(
                np.array(levels), curves, label, "cost [-]", y_log=True, ticks=ticks.get(study, ())
            )
        )
    return found


LABELS = {
    NOISE: "sensor noise over scale [-]",
    DELAY: "delay [control steps]",
    RECORD: "recorded motion",
}
"""Of the axis over which a study of robustness is drawn; others are of the carriage's numbers."""


def frequency(loops: Sequence[ClosedLoop]) -> list[Panel]:
    """Return each controller's steady amplitude over frequency: a panel an amplitude."""
    return [
        Panel(
            loops[0].frequencies / (2.0 * np.pi),
            [loop.gain[k] for loop in loops],
            "frequency of the force [Hz]",
            "|x1| k1 / F [-]",
            x_log=True,
            y_log=True,
            title=f"harmonic force of {force:.3g} N",
        )
        for k, force in enumerate(loops[0].forces if loops else ())
    ]


LINE = 0.17  # height of a line of text [inch]
FEW = 20  # abscissas below which each point is marked


def look(k: int) -> dict[str, Any]:
    """Return colour and style of the k-th controller; those of the first 28 differ."""
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": STYLES[k % len(STYLES)]}


def draw(found: Sequence[Panel], labels: Sequence[str], path: Path, columns: int = 2) -> None:
    """Draw panels: in one column over the same abscissas, in several with the same ordinates."""
    rows = -(-len(found) // columns)
    share = {"sharex": "all"} if columns == 1 else {"sharey": "all"}
    with style():
        height = 2.2 * rows + LINE * len(labels) / 2 + 0.5
        figure, axes = panels(height, rows, columns, **share)
        for one in axes[len(found) :]:
            one.set_visible(False)
        for one, panel in zip(axes, found, strict=False):
            marks = {"drawstyle": "steps-pre"} if panel.held else {}
            if len(panel.x) < FEW:
                marks["marker"] = "."
                one.margins(x=0.04)
            for k, (label, curve) in enumerate(zip(labels, panel.curves, strict=True)):
                one.plot(panel.x, curve, **look(k), **marks, label=label)
            one.set(xlabel=panel.x_label, ylabel=panel.y_label, title=panel.title)
            if panel.x_log:
                logarithmic(one, "x")
            if panel.y_log:
                logarithmic(one)
            if panel.ticks:
                one.set_xticks(panel.x, panel.ticks)
            if columns == 1:
                one.label_outer()
        figure.align_ylabels(axes)
        legend_below(figure, axes[0], 2)
        save(figure, path)


IN_A_BIN = 10  # episodes that each point of a line stands for
NARROW = 4.0  # ratio of an axis's ends below which round numbers are better ticks than 1, 2 and 5
WIDE = 6e3  # and from which powers of ten alone fit
LEARNED = {"color": COLOURS[-1], "linestyle": "-"}  # the last of all results


def draw_costs(results: Sequence[Evaluation], scene: Scene, path: Path) -> None:
    """Draw the cost of each controller against frequency, or from easy to hard episodes.

    The frequency is that of the first harmonic, where the scene draws it. A line goes through bins
    of ten episodes; the dots are single episodes of the last controller.
    """
    position, label = _abscissa(results[0], scene)
    bins = np.array_split(np.argsort(position), max(position.size // IN_A_BIN, 1))
    centres = [position[members].mean() for members in bins]
    digits = decimals(one.cost for one in results)
    with style():
        figure, (axes,) = panels(4.4, 1, 1)
        for i, result in enumerate(results):
            own = LEARNED | {"linewidth": 1.8} if result is results[-1] else look(i)
            values = [np.sqrt(result.penalties[members].mean()) for members in bins]
            axes.plot(centres, values, **own, label=f"{result.cost:.{digits}f}  {result.name}")
        dots = {"markersize": 4.0, "alpha": 0.4, "markeredgewidth": 0.0}
        axes.plot(position, results[-1].episode_costs, ".", color=COLOURS[-1], **dots)
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
    from matplotlib import ticker  # noqa: PLC0415 - optional

    axes.set(**{f"{which}scale": "log"})
    low, high = axes.get_ylim() if which == "y" else axes.get_xlim()
    axis = axes.yaxis if which == "y" else axes.xaxis
    if high < NARROW * low:
        axis.set_major_locator(ticker.MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
        axis.set_minor_locator(ticker.NullLocator())
    else:
        subs = (1.0, 2.0, 5.0) if high < WIDE * low else (1.0,)
        axis.set_major_locator(ticker.LogLocator(subs=subs))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(ticker.NullFormatter())


def draw_response(reference: Evaluation, learned: Evaluation, scene: Scene, path: Path) -> None:
    """Draw displacement and actuators over time, in the reference's median episode."""
    episode = int(np.argsort(reference.penalties)[reference.penalties.size // 2])
    both, millimetres = (reference, learned), 1e3 * scene.objective.displacement_scale
    title = f"Held-out episode {episode}, of median cost for {reference.name}"
    if reference.frequency is not None:
        title += f": harmonic {_excited(scene)} at {reference.frequency[episode]:.1f} rad/s"
    x1 = [millimetres * one.displacement[:, episode] for one in both]
    found = [Panel(reference.time, x1, "time [s]", "carriage $x_1$ [mm]", title=title)]
    for k, name in enumerate(scene.actuation.names):
        applied = [one.applied[:, episode, k] for one in both]
        found.append(Panel(reference.time, applied, "time [s]", ACTUATORS[name], held=True))
    draw(found, [one.name for one in both], path, columns=1)
