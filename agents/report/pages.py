"""Pages in Markdown and HTML: templates of prose, which data fill; tables and figures of scores."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from rich.console import Console
from rich.table import Table

from agents.evaluation.aggregates import Estimate
from agents.evaluation.studies import DELAY, NOISE, RECORD
from agents.scoring import Evaluation
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.drawing import ACTUATORS, COLOURS, STYLES, legend_below, panels, save, style
from mm_gym.files import write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER = Path(__file__).with_name("templates")


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(value: float) -> str:
    """Return a ratio in whole per cent; nothing rounds to -0."""
    return f"{round(100.0 * value)} %"


def printed(cost: float) -> str:
    """Return a cost as pages have it."""
    return f"{cost:.4f}"


def cost_range(least: float, most: float) -> str:
    """Return a range of costs as pages have it."""
    return f"{printed(least)} to {printed(most)}"


def span(found: Estimate, digits: int = 4) -> str:
    """Return a value as pages have it, with its interval if it has one."""
    value = f"{found.value:.{digits}f}"
    ends = f" [{found.low:.{digits}f}, {found.high:.{digits}f}]"
    return value if isnan(found.low) else value + ends


def not_scored_cells(not_scored: Mapping[str, str]) -> list[str]:
    """Return the cell of each controller that is not scored, in one line with the reason."""
    return [
        f"{name}: not scored: {'; '.join(reason.splitlines())}"
        for name, reason in not_scored.items()
    ]


TEMPLATES = Environment(
    loader=FileSystemLoader(FOLDER),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701 - it is Markdown
)
TEMPLATES.globals |= {"table": markdown, "percent": percent}


def render(name: str, **data: object) -> str:
    """Return a page: the template of a name with data, and one empty line between paragraphs."""
    text = TEMPLATES.get_template(f"{name}.md.jinja").render(data)
    return re.sub(r"\n{3,}", "\n\n", text).strip("\n") + "\n"


WEB = TEMPLATES.overlay(autoescape=True)  # the same for HTML, where a name may hold any character


def web_page(name: str, **data: object) -> str:
    """Return a page in HTML: the template of a name with data."""
    return WEB.get_template(f"{name}.html.jinja").render(data)


def write_rows(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows as CSV under the names of the first; no file without rows, NaN for what lacks."""
    found = list(rows)
    if found:
        names = list(found[0])
        write_csv(path, names, [[row.get(name, nan) for row in found] for name in names])  # pyright: ignore[reportArgumentType]


def print_table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[str] = ()
) -> None:
    """Print a table; the first column and those named as words are set to the left."""
    table = Table(title=title)
    table.add_column(header[0])
    for heading in header[1:]:
        justify = "left" if heading in words else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def write_scores(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per controller; ratios are of costs over the first one's, NaN where that is 0."""
    reference = results[0].cost
    write_rows(
        path,
        (
            {
                "controller": result.name,
                "reads": result.reads,
                "cost [-]": result.cost,
                "ratio to reference [-]": result.cost / reference if reference else nan,
                "rms of x1 / scale [-]": result.rms,
                "mean return [-]": result.returns.mean(),
                "mean energy injected [J]": ""
                if result.injected is None
                else result.injected.mean(),
            }
            for result in results
        ),
    )


def write_episodes(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per episode: its frequency, or else its number, and each controller's figures."""
    frequency = results[0].frequency
    columns: dict[str, Iterable[float]] = {"episode": range(results[0].returns.size)}
    if frequency is not None:
        columns = {"frequency [rad/s]": frequency}
    columns |= {f"cost of {one.name} [-]": one.episode_costs for one in results}
    columns |= {f"rms of x1 / scale of {one.name} [-]": one.episode_rms for one in results}
    write_csv(path, list(columns), list(columns.values()))  # pyright: ignore[reportArgumentType]


def print_ranking(
    results: Sequence[Evaluation], scene: Scene, not_scored: Mapping[str, str]
) -> None:
    """Print the controllers by their cost, the least first, and why others have none."""
    count, reference = results[0].returns.size, results[0]
    rows = [
        (
            result.name,
            result.reads,
            f"{result.cost:.3f}",
            f"{result.cost / reference.cost:.2f}" if reference.cost else "-",
            f"{result.rms:.3f}",
            f"{result.returns.mean():.2f}",
        )
        for result in sorted(results, key=lambda result: result.cost)
    ]
    print_table(
        f"cost: root of the mean of -reward per step, {count} held-out episodes",
        ("controller", "reads", "cost", "ratio", "rms x1", "return"),
        [*rows, *((text,) for text in not_scored_cells(not_scored))],
        words=("reads",),
    )
    Console().print(
        f"ratio: cost / cost of {reference.name}",
        f"rms x1: over {scene.objective.displacement_scale * 1e3:g} mm",
        "return: mean over the episodes",
        sep="\n",
        highlight=False,
    )


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
