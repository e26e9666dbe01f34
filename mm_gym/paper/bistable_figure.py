"""A figure in the paper's style of a case that the paper names and leaves out: a bistable carriage.

Equation 7 of the paper has alpha = 1 and beta = 2e6 1/m^2. With alpha < 0 < beta the carriage has
two stable equilibria, at |x1| = sqrt(-alpha / beta), and an unstable one between them.
"""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis.wells import Spring
from mm_gym.drawing import COLOURS, panels
from mm_gym.paper.curves import (
    MILLI,
    dampings,
    draw_row,
    entitle,
    legend_of_all,
    remark,
    run,
)
from mm_gym.paper.scenes import scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mm_gym.scene.scene import Scene

PLACE = 5e-3
"""|x1| of the wells [m]: half of where the paper releases the carriage."""

DURATION = 1.0
"""[s], as in figure 6."""


def bistable(name: str) -> Scene:
    """Return a system of figure 6 with two wells, of the same stiffness k1, at |x1| = PLACE."""
    return scene(name).replace(
        **{"carriage.linear_coefficient": -1.0, "carriage.cubic_coefficient": PLACE**-2}
    )


def figure_bistable() -> Figure:
    """Draw displacements (A, D), paths of carriage (B, E) and sphere (C, F), and the wells.

    Without and with an interface, as figure 6. The carriage's path crosses the dashed curve of zero
    energy, the hill's, for the last time where it is caught by a well.
    """
    figure, axes = panels(5.0, 2, 3, sharex="col", sharey="col")
    for row, name in enumerate(("fig6a", "fig6d")):
        system = bistable(name)
        history, carriage, sphere = axes[3 * row : 3 * row + 3]
        draw_row([history, carriage, sphere], run(system, DURATION, 5e-4), "ABCDEF"[3 * row :], 0.9)
        entitle(history, "AD"[row], dampings(system))
        for sign in (-1.0, 1.0):
            label = "wells of the carriage" if sign > 0.0 else None
            look = {"color": "0.3", "linewidth": 0.8, "linestyle": ":"}
            history.axhline(sign * MILLI * PLACE, label=label, **look)
        _draw_energy(carriage, system)
    for panel in axes[:3]:
        panel.set_xlabel("")
    remark(
        figure,
        "not a figure of the paper: its fig. 6 with a bistable spring, "
        f"$\\alpha = -1$, $\\beta$ = {PLACE**-2:g} m$^{{-2}}$",
    )
    legend_of_all(figure, axes)
    return figure


def _draw_energy(axes: Axes, system: Scene) -> None:
    """Mark the wells and the hill between them in the carriage's phase plot."""
    carriage = system.carriage
    spring = Spring(carriage.stiffness, carriage.linear_coefficient, carriage.cubic_coefficient)
    # 0 = m1 v^2 / 2 + the energy of the spring, which ends at sqrt(2) times the wells.
    x1 = np.sqrt(2.0) * spring.place * np.sin(np.linspace(-0.5, 0.5, 401) * np.pi)
    v1 = np.sqrt(2.0 / carriage.mass * np.maximum(0.0, [-spring.energy(x) for x in x1]))
    look = {"color": COLOURS[3], "linewidth": 1.0, "linestyle": "--", "zorder": 2.5}
    for sign in (-1.0, 1.0):
        label = "energy of the hill, $x_1 = v_1 = 0$" if sign > 0.0 else None
        axes.plot(MILLI * x1, sign * v1, label=label, **look)
    wells = MILLI * spring.place * np.array([-1.0, 1.0])
    marker = {"marker": "+", "color": COLOURS[6], "markersize": 9.0, "markeredgewidth": 1.6}
    axes.plot(wells, [0.0, 0.0], linestyle="none", zorder=3.5, label="wells", **marker)
