"""How figures look and are written; matplotlib is imported when the first one is drawn."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from contextlib import contextmanager
from io import BytesIO
from math import isfinite
from typing import TYPE_CHECKING

from gymnasium.error import DependencyNotInstalled

from mm_gym.files import write_bytes

if TYPE_CHECKING:
    from collections.abc import Generator
    from os import PathLike

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mm_gym.precision import WorkPrecision
    from mm_gym.simulation.trajectory import Trajectory

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, which colour-blind readers tell apart."""

STYLES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v")
WIDTH = 7.0
"""Width of a figure across both columns [inch]; with it 8 pt text stays 8 pt in print."""

EXCITATION = ("disturbance [N]", "ground [m/s²]")
"""What the excitation's columns are called on an axis."""

ACTUATORS = {"force": "force [N]", "stretch": "stretch [-]"}

LOOK = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "lines.linewidth": 1.2,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
}


@contextmanager
def style() -> Generator[None]:
    """Draw and save in this look; raise `DependencyNotInstalled` without matplotlib."""
    try:
        from matplotlib import rc_context  # noqa: PLC0415 - optional
    except ImportError as error:
        msg = 'drawing needs matplotlib; install it with: pip install "mm-gym[plot]"'
        raise DependencyNotInstalled(msg) from error
    with rc_context(LOOK):
        yield


def panels(
    height: float, rows: int, columns: int, *, sharex: str = "none", sharey: str = "none"
) -> tuple[Figure, list[Axes]]:
    """Return a figure of a height [inch] and its panels, row by row; call it within `style`."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - optional

    figure = Figure(figsize=(WIDTH, height))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.06)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    for axes in grid.flat:
        axes.margins(x=0.0)
    return figure, list(grid.flat)


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of one panel below all panels, where it hides nothing."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Write the figure as PNG at 200 dots per inch, whole or not at all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - optional

    picture = BytesIO()
    FigureCanvasAgg(figure).print_figure(picture, dpi=200, format="png")
    write_bytes(path, picture.getvalue())


def draw_trajectory(trajectory: Trajectory) -> Figure:
    """Return displacements, velocities, excitation, what was applied and the energy over time."""
    excited = [k for k in range(2) if trajectory.excitation[:, k].any()]
    count = 3 + len(excited) + len(trajectory.actuators)
    figure, axes = panels(1.2 * count + 0.6, count, 1, sharex="all")
    time, (x1, x2, v1, v2) = trajectory.time, trajectory.state.T
    rows = (
        ("displacement [mm]", 1e3, (x1, x2, x2 - x1)),
        ("velocity [m/s]", 1.0, (v1, v2, v2 - v1)),
    )
    names = ("carriage", "sphere", "sphere relative to carriage")
    for panel, (label, factor, curves) in zip(axes, rows, strict=False):
        for i, curve in enumerate(curves):
            panel.plot(time, factor * curve, STYLES[i], color=COLOURS[i], label=names[i])
        panel.set_ylabel(label)
    for panel, k in zip(axes[2:], excited, strict=False):
        panel.plot(time, trajectory.excitation[:, k], color=COLOURS[6])
        panel.set_ylabel(EXCITATION[k])
    for k, name in enumerate(trajectory.actuators):
        panel = axes[2 + len(excited) + k]
        panel.plot(time, trajectory.action[:, k], color=COLOURS[6], drawstyle="steps-post")
        panel.set_ylabel(ACTUATORS[name])
    axes[-1].plot(time, 1e3 * trajectory.energy, color=COLOURS[6])
    axes[-1].set(xlabel="time [s]", ylabel="energy [mJ]")
    figure.align_ylabels(axes)
    legend_below(figure, axes[0], 3)
    return figure


def draw_work_precision(result: WorkPrecision) -> Figure:
    """Return the cost of a control step over its error, a curve per method."""
    figure, (axes,) = panels(3.6, 1, 1)
    methods = list(dict.fromkeys(one.method for one in result.settings))
    for k, method in enumerate(methods):
        own = [one for one in result.settings if one.method == method and isfinite(one.error)]
        # What is below the oracle's own error lies on its edge.
        errors = [max(one.error, result.resolution) for one in own]
        look = {"color": COLOURS[k], "marker": MARKERS[k], "linestyle": STYLES[k % len(STYLES)]}
        look |= {"label": method, "markersize": 4.0}
        if method == result.auto:
            look |= {"label": f"{method} (auto)", "markersize": 7.0, "zorder": 3.0, "color": "k"}
        axes.plot(errors, [1e6 * one.seconds for one in own], **look)
    axes.axvspan(0.1 * result.resolution, result.resolution, color="0.9", label="oracle's error")
    axes.set(xscale="log", yscale="log", xlim=(1.0, 0.3 * result.resolution))
    axes.set(xlabel="error of a control step [-]", ylabel="cost of a control step [µs]")
    legend_below(figure, axes, len(methods) + 1)
    return figure
