"""Figures of the paper's linear systems with a free sphere: 2, 3 and 5."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.analysis import asymptotic_offset
from mm_gym.drawing import panels
from mm_gym.paper.curves import (
    MASSES,
    dampings,
    draw_displacements,
    draw_path,
    draw_rest,
    entitle,
    legend_of_all,
    remark,
    run,
)
from mm_gym.paper.scenes import ASSUMED, CAPTION, FIGURE_2, scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LIGHT = 1e-6
"""Carriages [kg] below this are labelled as of vanishing mass."""

TEXT, PRINTED = "that the text needs", "of fig. 2's caption"
"""Where the masses of figures 2 and 3 are from."""

UNPUBLISHED = "theory only: the paper shows measured points here, but publishes no data"


def _displacement_panels(
    names: tuple[str, ...], duration: float, rows: int, height: float
) -> Figure:
    """Draw x1 and x2 of each system over time, and where the sphere comes to rest."""
    figure, axes = panels(height, rows, len(names) // rows, sharex="all", sharey="all")
    for letter, panel, name in zip("ABCDEF", axes, names, strict=False):
        system = scene(name)
        draw_displacements(panel, run(system, duration, 1e-3))
        draw_rest(panel, asymptotic_offset(system), "sphere at rest, $t \\to \\infty$")
        light = ", $m_1 \\to 0$" if system.carriage.mass < LIGHT else ""
        entitle(panel, letter, dampings(system, "*" if name in ASSUMED else "") + light)
        panel.label_outer()
    legend_of_all(figure, axes)
    return figure


def _masses(name: str, source: str) -> str:
    """Return the masses of a system, and where they are from."""
    system = scene(name)
    masses = f"$m_1$ = {system.carriage.mass:g} kg, $m_2$ = {system.sphere.mass:g} kg"
    return f"masses {source}: {masses}"


def _figure_2(names: tuple[str, ...], source: str) -> Figure:
    figure = _displacement_panels(names, 0.5, 2, 4.4)
    remark(figure, f"{_masses(names[0], source)}; * assumed, 1 or 10 in the caption")
    return figure


def figure_2() -> Figure:
    """Draw the linear systems A to F with the masses that the text needs."""
    return _figure_2(tuple(FIGURE_2), TEXT)


def figure_2_caption() -> Figure:
    """Draw the linear systems A to F with the masses of the caption."""
    return _figure_2(CAPTION, PRINTED)


def _figure_3(undamped: str, damped: str, source: str) -> Figure:
    """Draw the phase paths of a system without (A, B) and with interface damping (C, D)."""
    figure, axes = panels(4.8, 2, 2, sharex="col", sharey="col")
    for row, name in enumerate((undamped, damped)):
        system = scene(name)
        motion = run(system, 2.0, 5e-4)
        for mass, kind in enumerate(MASSES):
            panel = axes[2 * row + mass]
            draw_path(panel, motion, mass)
            entitle(panel, "ABCD"[2 * row + mass], f"{kind}, {dampings(system)}")
    for panel in axes[:2]:
        panel.set_xlabel("")
    remark(figure, _masses(damped, source))
    legend_of_all(figure, axes)
    return figure


def figure_3() -> Figure:
    """Draw the phase paths of carriage and sphere: A and B of system 2E, C and D of 2A."""
    return _figure_3("fig2e", "fig2a", TEXT)


def figure_3_caption() -> Figure:
    """Draw figure 3 with the masses of figure 2's caption."""
    return _figure_3("fig2e_caption", "fig2a_caption", PRINTED)


def figure_5() -> Figure:
    """Draw the systems with the experiment's parameters."""
    figure = _displacement_panels(("fig5a", "fig5b"), 15.0, 1, 2.9)
    remark(figure, UNPUBLISHED)
    return figure
