"""Figures of the paper's systems with springs: a cubic one (6), and a pair for the sphere (12)."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.drawing import panels
from mm_gym.paper.curves import MILLI, TWIN, dampings, draw_row, entitle, legend_of_all, run
from mm_gym.paper.scenes import scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_6() -> Figure:
    """Draw the cubic spring: displacements (A, D), paths of carriage (B, E) and sphere (C, F).

    The linear system, beta = 0, is drawn in grey behind.
    """
    figure, axes = panels(4.6, 2, 3, sharex="col", sharey="col")
    for row, name in enumerate(("fig6a", "fig6d")):
        system = scene(name)
        motion = run(system, 1.0, 5e-5)
        twin = run(system.replace(**{"carriage.cubic_coefficient": 0.0}), 1.0, 5e-4)
        history, *paths = axes[3 * row : 3 * row + 3]
        for mass, panel in enumerate(paths):
            look = TWIN | ({"label": "linear, $\\beta = 0$"} if mass == 0 else {})
            history.plot(twin.time, MILLI * twin.state[:, mass], **look)
            panel.plot(MILLI * twin.state[:, mass], twin.state[:, 2 + mass], **TWIN)
        draw_row([history, *paths], motion, "ABCDEF"[3 * row :], 0.5)
        entitle(history, "AD"[row], dampings(system))
    for panel in axes[:3]:
        panel.set_xlabel("")
    legend_of_all(figure, axes)
    return figure


def figure_12() -> Figure:
    """Draw the sphere on springs: displacements (A, D) and phase paths (B, C, E, F)."""
    figure, axes = panels(4.6, 2, 3, sharex="col", sharey="col")
    for row, name in enumerate(("fig12a", "fig12d")):
        draw_row(axes[3 * row : 3 * row + 3], run(scene(name), 2.0, 1e-3), "ABCDEF"[3 * row :])
        entitle(axes[3 * row], "AD"[row], dampings(scene(name)))
    for panel in axes[:3]:
        panel.set_xlabel("")
    legend_of_all(figure, axes)
    return figure
