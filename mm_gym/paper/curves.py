"""Curves that several of the paper's figures have: histories, phase paths, and their labels."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.drawing import COLOURS, STYLES
from mm_gym.simulation.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.trajectory import Trajectory

MILLI = 1e3
TIME = "time [s]"
MASSES = ("carriage", "sphere")
TWIN = {"color": "0.55", "linewidth": 0.8}
"""Look of the linear system that a nonlinear one is compared with."""

MOST_COLUMNS = 5
"""Entries of a legend that fit next to each other."""


def run(system: Scene, duration: float, time_step: float) -> Trajectory:
    """Return the motion, with a step [s] short enough to draw the fastest oscillation round."""
    return simulate(system.replace(**{"control.time_step": time_step}), duration=duration)


def dampings(system: Scene, mark: str = "") -> str:
    """Return the dampings of a linear interface and of the carriage, for a panel's title.

    `mark` follows the carriage's.
    """
    damping = system.interface.damping if system.interface.kind == "viscous" else 0.0
    return f"$c$ = {damping:g}, $d$ = {system.carriage.damping:g}{mark} N s/m"


def entitle(axes: Axes, letter: str, text: str) -> None:
    """Write a panel's letter and what it shows above its left end."""
    axes.set_title(f"{letter}: {text}", loc="left")


def remark(figure: Figure, text: str) -> None:
    """Write above all panels what a reader has to know of the figure."""
    figure.suptitle(text, fontsize=8.0, style="italic")


def draw_displacements(axes: Axes, motion: Trajectory, width: float = 1.2) -> None:
    """Draw x1 and x2 over time."""
    axes.set(xlabel=TIME, ylabel="$x_1$, $x_2$ [mm]")
    for mass in range(2):
        axes.plot(
            motion.time,
            MILLI * motion.state[:, mass],
            STYLES[mass],
            color=COLOURS[mass],
            linewidth=width,
            label=MASSES[mass],
        )


def draw_velocities(axes: Axes, motion: Trajectory) -> None:
    """Draw v1 and v2 over time."""
    axes.set(xlabel=TIME, ylabel="$v_1$, $v_2$ [m/s]")
    for mass in range(2):
        axes.plot(
            motion.time,
            motion.state[:, 2 + mass],
            STYLES[mass],
            color=COLOURS[mass],
            label=MASSES[mass],
        )


def draw_rest(axes: Axes, place: float, label: str) -> None:
    """Draw the place [m] where something comes to rest, across all times and behind its curve."""
    axes.axhline(MILLI * place, color="0.8", linewidth=3.0, zorder=1.5, label=label)


def _label_path(axes: Axes, mass: int) -> None:
    """Label the axes of a phase plot and leave room around its path."""
    axes.set(xlabel=f"$x_{mass + 1}$ [mm]", ylabel=f"$v_{mass + 1}$ [m/s]")
    axes.margins(x=0.06, y=0.08)


def draw_path(axes: Axes, motion: Trajectory, mass: int, width: float = 1.0) -> None:
    """Draw velocity over displacement of the carriage (0) or the sphere (1), its start and end."""
    _label_path(axes, mass)
    x, v = MILLI * motion.state[:, mass], motion.state[:, 2 + mass]
    axes.plot(x, v, color=COLOURS[mass], linewidth=width)
    # The end is drawn smaller, so that both are seen where they coincide.
    ends = (("start", 0, "white", 6.0), ("end", -1, "black", 3.0))
    for label, row, face, size in ends:
        axes.plot(
            x[row],
            v[row],
            "o",
            color="black",
            markerfacecolor=face,
            markersize=size,
            zorder=3.0,
            label=label,
        )


def draw_row(axes: list[Axes], motion: Trajectory, letters: str, width: float = 1.0) -> None:
    """Draw a row of three panels: displacements over time, and the paths of both masses."""
    draw_displacements(axes[0], motion, width)
    for mass, panel in enumerate(axes[1:]):
        draw_path(panel, motion, mass, width)
        entitle(panel, letters[1 + mass], MASSES[mass])


def legend_of_all(figure: Figure, axes: list[Axes]) -> None:
    """Put one legend with what the panels' legends say below all panels."""
    entries = {
        label: handle
        for panel in axes
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    rows = -(-len(entries) // MOST_COLUMNS)
    columns = -(-len(entries) // rows)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
