"""The paper's figures 2, 3, 5 to 10 and 12; "bistable" is none of the paper's."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis import asymptotic_offset, bifurcation, critical_reference_velocity
from mm_gym.analysis.asymptotes import Spring
from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, STYLES, panels, save, style
from mm_gym.paper.scenes import (
    ASSUMED,
    CAPTION,
    CHI,
    FIGURE_2,
    NORMAL_FORCE,
    RATIOS,
    STATIC,
    friction_of,
    scene,
    stick_slope,
)
from mm_gym.scene.scene import Scene
from mm_gym.simulation.simulate import simulate
from mm_gym.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MILLI = 1e3
TIME = "time [s]"
MASSES = ("carriage", "sphere")
TWIN = {"color": "0.55", "linewidth": 0.8}
"""Look of the linear system that a nonlinear one is compared with."""

MOST_COLUMNS = 5  # entries of a legend that fit next to each other


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
    _draw_masses(axes, motion.time, MILLI * motion.state[:, :2], width)


def draw_velocities(axes: Axes, motion: Trajectory) -> None:
    """Draw v1 and v2 over time."""
    axes.set(xlabel=TIME, ylabel="$v_1$, $v_2$ [m/s]")
    _draw_masses(axes, motion.time, motion.state[:, 2:], 1.2)


def _draw_masses(axes: Axes, time: Array, values: Array, width: float) -> None:
    for mass in range(2):
        look = {"color": COLOURS[mass], "linewidth": width, "label": MASSES[mass]}
        axes.plot(time, values[:, mass], STYLES[mass], **look)


def draw_path(axes: Axes, motion: Trajectory, mass: int, width: float = 1.0) -> None:
    """Draw velocity over displacement of the carriage (0) or the sphere (1), its start and end."""
    axes.set(xlabel=f"$x_{mass + 1}$ [mm]", ylabel=f"$v_{mass + 1}$ [m/s]")
    axes.margins(x=0.06, y=0.08)
    x, v = MILLI * motion.state[:, mass], motion.state[:, 2 + mass]
    axes.plot(x, v, color=COLOURS[mass], linewidth=width)
    # The end is drawn smaller, so that both are seen where they coincide.
    for label, row, face, size in (("start", 0, "white", 6.0), ("end", -1, "black", 3.0)):
        look = {"color": "black", "markerfacecolor": face, "markersize": size, "zorder": 3.0}
        axes.plot(x[row], v[row], "o", label=label, **look)


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


LIGHT = 1e-6  # carriages [kg] below this are labelled as of vanishing mass

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
        # where the sphere comes to rest, across all times and behind its curve
        look = {"color": "0.8", "linewidth": 3.0, "zorder": 1.5}
        label = "sphere at rest, $t \\to \\infty$"
        panel.axhline(MILLI * asymptotic_offset(system), label=label, **look)
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


def figure_2(names: tuple[str, ...] = tuple(FIGURE_2), source: str = TEXT) -> Figure:
    """Draw the linear systems A to F, by default with the masses that the text needs."""
    figure = _displacement_panels(names, 0.5, 2, 4.4)
    remark(figure, f"{_masses(names[0], source)}; * assumed, 1 or 10 in the caption")
    return figure


def figure_3(undamped: str = "fig2e", damped: str = "fig2a", source: str = TEXT) -> Figure:
    """Draw the phase paths without (A, B) and with interface damping (C, D)."""
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


def figure_5() -> Figure:
    """Draw the systems with the experiment's parameters."""
    figure = _displacement_panels(("fig5a", "fig5b"), 15.0, 1, 2.9)
    remark(figure, UNPUBLISHED)
    return figure


def figure_6() -> Figure:
    """Draw the cubic spring: displacements (A, D), paths of carriage (B, E) and sphere (C, F).

    The linear system, beta = 0, is drawn in grey behind.
    """

    def draw(name: str, row: list[Axes], letters: str) -> None:
        system = scene(name)
        twin = run(system.replace(**{"carriage.cubic_coefficient": 0.0}), 1.0, 5e-4)
        for mass, panel in enumerate(row[1:]):
            look = TWIN | ({"label": "linear, $\\beta = 0$"} if mass == 0 else {})
            row[0].plot(twin.time, MILLI * twin.state[:, mass], **look)
            panel.plot(MILLI * twin.state[:, mass], twin.state[:, 2 + mass], **TWIN)
        draw_row(row, run(system, 1.0, 5e-5), letters, 0.5)

    return _in_two_rows(4.6, ("fig6a", "fig6d"), draw)


def figure_12() -> Figure:
    """Draw the sphere on springs: displacements (A, D) and phase paths (B, C, E, F)."""
    return _in_two_rows(
        4.6,
        ("fig12a", "fig12d"),
        lambda name, row, letters: draw_row(row, run(scene(name), 2.0, 1e-3), letters),
    )


def _in_two_rows(
    height: float, names: tuple[str, str], draw: Callable[[str, list[Axes], str], None]
) -> Figure:
    """Return a figure with a row of three panels for each system, which `draw` fills."""
    figure, axes = panels(height, 2, 3, sharex="col", sharey="col")
    for k, name in enumerate(names):
        row = axes[3 * k : 3 * k + 3]
        draw(name, row, "ABCDEF"[3 * k :])
        entitle(row[0], "AD"[k], dampings(scene(name)))
    for panel in axes[:3]:
        panel.set_xlabel("")
    legend_of_all(figure, axes)
    return figure


FRICTION_VELOCITIES = np.arange(1000) * 1e-3 + 1e-6  # v_r of figure 10 [m/s]

MARKS, SPACING = ("o", "s", "^", "D", "v", "P", "X"), 40
"""Marks of figure 10's curves, and how many points are between two of them."""


def figure_7() -> Figure:
    """Draw the friction force of equation 9 over the slip velocity, for mu1 > mu2 and chi > 0.

    A filled circle is the value at |w| = v_r, where this project sticks; an open one is a limit.
    """
    figure, (axes,) = panels(3.2, 1, 1)
    law = friction_of(scene("fig8"))
    vr = law.reference_velocity
    highest, lowest = (
        mu * NORMAL_FORCE for mu in (law.static_coefficient, law.kinetic_coefficient)
    )
    axes.plot([-vr, vr], [-highest, highest], color=COLOURS[0], label="stick, $|w| \\leq v_r$")
    for sign in (-1.0, 1.0):
        speed = np.linspace(vr, 3.0 * vr, 50)
        force = sign * (lowest + law.slip_damping * (speed - vr))
        label = "slip, $|w| > v_r$" if sign > 0.0 else None
        axes.plot(sign * speed, force, "--", color=COLOURS[1], label=label)
        point = {"marker": "o", "markersize": 5.0}
        axes.plot(sign * vr, sign * highest, color=COLOURS[0], **point)
        axes.plot(sign * vr, sign * lowest, color=COLOURS[1], markerfacecolor="white", **point)
        _mark(axes, sign, vr, {"\\mu_1 F_N": highest, "\\mu_2 F_N": lowest})
    axes.text(2.2 * vr, 1.4 * lowest, "slope $\\chi$", color="0.3", va="bottom")
    axes.text(0.2 * vr, 0.1 * highest, "slope $\\mu_1 F_N / v_r$", color="0.3")
    axes.set(
        xlabel="slip velocity $w = v_2 - v_1$ [m/s]",
        ylabel="friction force $f$ [N]",
        ylim=(-1.25 * highest, 1.25 * highest),
    )
    remark(
        figure,
        f"parameters of fig. 8, $\\chi$ = {law.slip_damping:g} N s/m assumed; "
        "at $|w| = v_r$ eq. 9 has the open circle, this project the filled one",
    )
    legend_of_all(figure, [axes])
    return figure


def _mark(axes: Axes, sign: float, vr: float, levels: dict[str, float]) -> None:
    """Mark v_r [m/s] on the horizontal axis and forces [N] on the vertical one, on one side."""
    axes.axhline(0.0, color="0.4", linewidth=0.6)
    axes.axvline(0.0, color="0.4", linewidth=0.6)
    minus, side, below = ("", "right", "top") if sign > 0.0 else ("-", "left", "bottom")
    dots = {"linestyle": ":", "color": "0.4", "linewidth": 0.8}
    for text, level in levels.items():
        axes.plot([0.0, sign * vr], [sign * level] * 2, **dots)
        axes.text(0.0, sign * level, f" ${minus}{text}$ ", color="0.3", ha=side, va="center")
    axes.plot([sign * vr] * 2, [0.0, sign * max(levels.values())], **dots)
    axes.text(sign * vr, 0.0, f" ${minus}v_r$ ", color="0.3", va=below)


def figure_8() -> Figure:
    """Draw dry friction: displacements (A), velocities (B), paths of carriage (C) and sphere (D).

    The sphere does not return to where the linear system would bring it, 20 mm.
    """
    figure, (displacements, velocities, carriage, sphere) = panels(5.2, 2, 2)
    system = scene("fig8")
    motion, linear = run(system, 0.6, 1e-4), asymptotic_offset(linear_twin(system))
    look = {"color": COLOURS[3], "linestyle": "--"}
    draw_displacements(displacements, motion)
    displacements.axhline(MILLI * linear, label="linear system at rest", **look)
    draw_velocities(velocities, motion)
    for panel in (displacements, velocities):
        _shade_slip(panel, motion, friction_of(system).reference_velocity)
    draw_path(carriage, motion, 0)
    draw_path(sphere, motion, 1)
    circle = {"facecolors": "none", "edgecolors": COLOURS[3], "linestyles": "--", "zorder": 4.0}
    sphere.scatter([MILLI * linear], [0.0], s=130.0, label="linear attractor", **circle)
    titles = ("displacements", "velocities", *MASSES)
    for letter, panel, title in zip("ABCD", figure.axes, titles, strict=True):
        entitle(panel, letter, title)
    remark(
        figure,
        f"$\\chi$ = {friction_of(system).slip_damping:g} N s/m assumed; the paper states no value",
    )
    legend_of_all(figure, [displacements, sphere])
    return figure


def linear_twin(system: Scene) -> Scene:
    """Return the system with the viscous interface that its dry friction is in stick."""
    slope = stick_slope(friction_of(system))
    return system.replace(interface={"kind": "viscous", "damping": slope})


def _shade_slip(axes: Axes, motion: Trajectory, reference_velocity: float) -> None:
    """Shade the times in which the sphere slips."""
    slips = np.abs(motion.state[:, 3] - motion.state[:, 2]) > reference_velocity
    changes = np.flatnonzero(np.diff(slips.astype(int)))
    for number, (first, last) in enumerate(zip(changes[::2], changes[1::2], strict=True)):
        label = "slip, $|v_2 - v_1| > v_r$" if number == 0 else None
        axes.axvspan(motion.time[first], motion.time[last], color="0.88", label=label)


def figure_9() -> Figure:
    """Draw dry friction that never slips: displacements (A) and velocities (B), and its twin's."""
    figure, (displacements, velocities) = panels(4.6, 2, 1, sharex="all")
    system = scene("fig9")
    motion, twin = run(system, 0.5, 5e-4), run(linear_twin(system), 0.5, 5e-4)
    draw_displacements(displacements, motion, 1.8)
    draw_velocities(velocities, motion)
    slip = {"color": COLOURS[2], "label": "sphere relative to carriage"}
    velocities.plot(motion.time, motion.state[:, 3] - motion.state[:, 2], "-.", **slip)
    for mass in range(2):
        look = {"color": "black", "linestyle": ":", "linewidth": 1.0}
        label = "linear system, $c = \\mu_1 F_N / v_r$" if mass == 0 else None
        displacements.plot(twin.time, MILLI * twin.state[:, mass], label=label, **look)
        velocities.plot(twin.time, twin.state[:, 2 + mass], **look)
    for sign, side in ((-1.0, "bottom"), (1.0, "top")):
        vr = sign * friction_of(system).reference_velocity
        velocities.axhline(vr, color="0.4", linewidth=0.8, linestyle="--")
        text = f"${'-' if sign < 0.0 else ''}v_r$ "
        velocities.text(motion.time[-1], 0.97 * vr, text, ha="right", va=side, color="0.3")
    displacements.set_xlabel("")
    velocities.set_ylabel("$v_1$, $v_2$, $v_2 - v_1$ [m/s]")
    entitle(displacements, "A", "displacements")
    entitle(velocities, "B", "velocities")
    legend_of_all(figure, [displacements, velocities])
    return figure


def figure_10() -> Figure:
    """Draw the offset at rest over v_r, for several chi (A) and ratios of the coefficients (B)."""
    figure, (by_chi, by_ratio) = panels(6.2, 2, 1, sharex="all")
    system = scene("fig10")
    chi = {
        f"$\\chi$ = {value:g} N s/m": system.replace(**{"interface.slip_damping": value})
        for value in CHI
    }
    ratio = {
        f"$\\mu_2 / \\mu_1$ = {value:g}": system.replace(
            **{"interface.kinetic_coefficient": STATIC * value}
        )
        for value in RATIOS
    }
    _diagram(by_chi, chi, FRICTION_VELOCITIES)
    _diagram(by_ratio, ratio, FRICTION_VELOCITIES)
    by_chi.set_xlabel("")
    entitle(by_chi, "A", "$\\mu_2 / \\mu_1$ = 0.5")
    entitle(by_ratio, "B", "$\\chi$ = 0.1 N s/m")
    remark(
        figure,
        "$\\chi$ of A and $\\mu_2 / \\mu_1$ of B assumed; "
        "the paper's text states how many, not which",
    )
    return figure


def _diagram(axes: Axes, curves: dict[str, Scene], velocities: Array) -> None:
    for i, (label, system) in enumerate(curves.items()):
        offsets = bifurcation(system, "interface.reference_velocity", velocities)
        # A mark at every fortieth point tells the curves apart without their colours.
        look = {"color": COLOURS[i], "marker": MARKS[i], "markersize": 4.0, "label": label}
        axes.plot(velocities, MILLI * offsets, ".", color=COLOURS[i], markersize=1.5)
        first = SPACING * i // len(MARKS)
        axes.plot(velocities, MILLI * offsets, ls="none", markevery=(first, SPACING), **look)
    critical = critical_reference_velocity(next(iter(curves.values())))
    axes.axvline(critical, color="0.4", linewidth=0.8, linestyle=":")
    place = {"transform": axes.get_xaxis_transform(), "va": "bottom", "color": "0.3"}
    axes.text(critical, 0.02, f" $v_{{r,crit}}$ = {critical:.4f} m/s", **place)
    axes.legend(handletextpad=0.2, loc="upper right")
    axes.set_xlim(0.0, 1.0)
    axes.set(xlabel="reference velocity $v_r$ [m/s]", ylabel="$x_2 - x_1$ at rest [mm]")


PLACE = 5e-3  # |x1| of the wells [m]: half of where the paper releases the carriage
DURATION = 1.0  # [s], as in figure 6


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

    def draw(name: str, row: list[Axes], letters: str) -> None:
        draw_row(row, run(bistable(name), DURATION, 5e-4), letters, 0.9)
        for sign in (-1.0, 1.0):
            label = "wells of the carriage" if sign > 0.0 else None
            look = {"color": "0.3", "linewidth": 0.8, "linestyle": ":"}
            row[0].axhline(sign * MILLI * PLACE, label=label, **look)
        _draw_energy(row[1], bistable(name))

    figure = _in_two_rows(5.0, ("fig6a", "fig6d"), draw)
    remark(
        figure,
        "not a figure of the paper: its fig. 6 with a bistable spring, "
        f"$\\alpha = -1$, $\\beta$ = {PLACE**-2:g} m$^{{-2}}$",
    )
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


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig2": figure_2,
    "fig2_caption": partial(figure_2, CAPTION, PRINTED),
    "fig3": figure_3,
    "fig3_caption": partial(figure_3, "fig2e_caption", "fig2a_caption", PRINTED),
    "fig5": figure_5,
    "fig6": figure_6,
    "fig7": figure_7,
    "fig8": figure_8,
    "fig9": figure_9,
    "fig10": figure_10,
    "fig12": figure_12,
    "bistable": figure_bistable,
}
"""The function that draws each figure. Of figures 2 and 3 there are two, with the masses of the
text and with those of figure 2's caption. The last is no figure of the paper."""


def draw(name: str, path: str | PathLike[str]) -> None:
    """Draw one figure, such as "fig2", and write it as PNG."""
    with style():
        save(FIGURES[name](), path)
