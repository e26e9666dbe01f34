"""The style of all figures, and their files; matplotlib is imported when the first is drawn."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from io import BytesIO
from os import PathLike
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mm_gym.extras import optional
from mm_gym.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Result = TypeVar("Result")

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, which colour-blind readers tell apart."""

STYLES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v")
WIDTH = 7.0  # width of a figure across both columns [inch]; with it 8 pt text stays 8 pt in print

LETTER, KEY, LINE = 0.056, 0.5, 0.17
"""Width of a letter, and of a key with its margins, in a legend; height of a line [inch]."""

ACTUATORS = {
    "force": "force [N]",
    "stretch": "stretch [-]",
    "damping": "damping [N s/m]",
    "voltage": "voltage [V]",
}
"""Label of an actuator's axis."""

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
    matplotlib = optional("matplotlib", "drawing needs matplotlib; install the extra `plot`")
    with matplotlib.rc_context(LOOK):
        yield


def drawn(
    draw: Callable[[Result], Figure], result: Result, path: str | PathLike[str] | None
) -> Figure:
    """Draw a result in this look, write it as a PNG if a path is given, and return the figure."""
    with style():
        figure = draw(result)
        if path is not None:
            save(figure, path)
    return figure


def panels(
    height: float,
    rows: int,
    columns: int,
    *,
    sharex: str = "none",
    sharey: str = "none",
    heights: Sequence[float] | None = None,
) -> tuple[Figure, list[Axes]]:
    """Return a figure of a height [inch] and its panels, row by row; call it within `style`.

    The rows have the same height, or heights in the ratio of those given.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - optional

    figure = Figure(figsize=(WIDTH, height))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.06)
    grid = figure.subplots(
        rows, columns, squeeze=False, sharex=sharex, sharey=sharey, height_ratios=heights
    )
    for axes in grid.flat:
        axes.margins(x=0.0)
    return figure, list(grid.flat)


def hertz_above(axes: Axes) -> None:
    """Show frequencies [rad/s] of the axis below in Hz above the panel, too."""
    turn = 2.0 * np.pi
    both = (lambda w: np.divide(w, turn), lambda hertz: np.multiply(hertz, turn))
    above = axes.secondary_xaxis("top", functions=both)
    above.set_xlabel("frequency [Hz]")


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of one panel below all panels, where it hides nothing.

    Long labels take fewer columns than asked for, and make the figure higher.
    """
    handles, labels = axes.get_legend_handles_labels()
    fitting = next((n for n in range(columns, 1, -1) if _fits(labels, n)), 1)
    more = -(-len(labels) // fitting) + -len(labels) // columns
    figure.set_figheight(figure.get_figheight() + LINE * more)
    figure.legend(handles, labels, loc="outside lower center", ncols=fitting)


def _fits(labels: list[str], columns: int) -> bool:
    """Return whether a legend of so many columns is as wide as a figure at most."""
    widest = [max(map(len, part), default=0) for part in np.array_split(labels, columns)]
    return sum(LETTER * letters + KEY for letters in widest) <= WIDTH


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Write the figure as PNG at 200 dots per inch, whole or not at all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - optional

    picture = BytesIO()
    FigureCanvasAgg(figure).print_figure(picture, dpi=200, format="png")
    write_bytes(path, picture.getvalue())
