"""Figures of the paper's systems with dry friction: 7 to 10."""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis import asymptotic_offset, bifurcation, critical_reference_velocity
from mm_gym.drawing import COLOURS, panels
from mm_gym.paper.curves import (
    MASSES,
    MILLI,
    draw_displacements,
    draw_path,
    draw_velocities,
    entitle,
    legend_of_all,
    remark,
    run,
)
from mm_gym.paper.printed import friction_force, friction_of, normal_force, stick_slope
from mm_gym.paper.scenes import CHI, RATIOS, STATIC, scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.trajectory import Trajectory

FRICTION_VELOCITIES = np.arange(1000) * 1e-3 + 1e-6
"""v_r of figure 10 [m/s]."""


MARKS, SPACING = ("o", "s", "^", "D", "v", "P", "X"), 40
"""Marks of figure 10's curves, and how many points are between two of them."""


def figure_7() -> Figure:
    """Draw the friction force of equation 9 over the slip velocity, for mu1 > mu2 and chi > 0.

    A filled circle is the value at |w| = v_r, where this project sticks; an open one is a limit.
    """
    figure, (axes,) = panels(3.2, 1, 1)
    law = friction_of(scene("fig8"))
    vr = law.reference_velocity
    normal = normal_force(law)
    highest, lowest = law.static_coefficient * normal, law.kinetic_coefficient * normal
    axes.plot([-vr, vr], [-highest, highest], color=COLOURS[0], label="stick, $|w| \\leq v_r$")
    for sign in (-1.0, 1.0):
        slip = sign * np.linspace(vr, 3.0 * vr, 50)
        label = "slip, $|w| > v_r$" if sign > 0.0 else None
        axes.plot(slip, friction_force(law, slip), "--", color=COLOURS[1], label=label)
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
    velocities.plot(
        motion.time,
        motion.state[:, 3] - motion.state[:, 2],
        "-.",
        color=COLOURS[2],
        label="sphere relative to carriage",
    )
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


def _diagram(axes: Axes, curves: dict[str, Scene], velocities: NDArray[np.float64]) -> None:
    for i, (label, system) in enumerate(curves.items()):
        offsets = bifurcation(system, "interface.reference_velocity", velocities)
        # A mark at every fortieth point tells the curves apart without their colours.
        look = {"color": COLOURS[i], "marker": MARKS[i], "markersize": 4.0, "label": label}
        axes.plot(velocities, MILLI * offsets, ".", color=COLOURS[i], markersize=1.5)
        first = SPACING * i // len(MARKS)
        axes.plot(velocities, MILLI * offsets, ls="none", markevery=(first, SPACING), **look)
    critical = critical_reference_velocity(next(iter(curves.values())))
    axes.axvline(critical, color="0.4", linewidth=0.8, linestyle=":")
    axes.text(
        critical,
        0.02,
        f" $v_{{r,crit}}$ = {critical:.4f} m/s",
        transform=axes.get_xaxis_transform(),
        va="bottom",
        color="0.3",
    )
    axes.legend(handletextpad=0.2, loc="upper right")
    axes.set_xlim(0.0, 1.0)
    axes.set(xlabel="reference velocity $v_r$ [m/s]", ylabel="$x_2 - x_1$ at rest [mm]")
