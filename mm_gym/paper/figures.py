"""The paper's figures 2, 3, 5 to 10 and 12, drawn from the library.

The paper's text says what the panels of each figure show, but not how. Figures 3 and 7 are
reconstructions, and their titles say so.
"""

# pyright: basic, reportArgumentType=false, reportCallIssue=false
# matplotlib's signatures are typed in part only, and not for a dictionary of options

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis import (
    asymptotic_offset,
    bifurcation,
    critical_reference_velocity,
    frequency_response,
    modes,
)
from mm_gym.drawing import COLOURS, STYLES, legend_below, panels, save, style
from mm_gym.paper.scenes import CHI, RATIOS, REFERENCE_VELOCITY, STATIC, scene
from mm_gym.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

MILLI = 1e3
TIME, DISPLACEMENT = "time [s]", "displacement [mm]"
OFFSET, SLIP = "offset $x_2 - x_1$ [mm]", "slip velocity [m/s]"
FASTEST = 1e6
"""Largest eigenvalue drawn [1/s]; those of the carriages of D and F are beyond it."""

FRICTION_VELOCITIES = np.arange(1000) * 1e-3 + 1e-6
"""v_r of figure 10 [m/s]."""


def _label(system: Scene) -> str:
    """Return the dampings of a system, for a panel's title."""
    damping = system.interface.damping if system.interface.kind == "viscous" else 0.0
    return f"$c$ = {damping:g}, $d$ = {system.carriage.damping:g} N s/m"


def _histories(axes: Axes, system: Scene, duration: float) -> None:
    """Draw x1, x2 and the offset over time, and the offset at rest."""
    trajectory = simulate(system, duration=duration)
    x1, x2 = MILLI * trajectory.state[:, :2].T
    axes.plot(trajectory.time, x1, STYLES[0], color=COLOURS[0], label="carriage $x_1$")
    axes.plot(trajectory.time, x2, STYLES[1], color=COLOURS[1], label="sphere $x_2$")
    axes.plot(trajectory.time, x2 - x1, STYLES[2], color=COLOURS[2], label="offset $x_2 - x_1$")
    rest = MILLI * asymptotic_offset(system)
    axes.axhline(rest, color="0.4", linewidth=0.8, linestyle=":", label="offset at rest")


def _time_panels(names: dict[str, str], duration: float, rows: int, height: float) -> Figure:
    figure, axes = panels(height, rows, len(names) // rows, sharex="all", sharey="all")
    for panel, (name, title) in zip(axes, names.items(), strict=True):
        _histories(panel, scene(name), duration)
        panel.set_title(title, loc="left")
    columns = len(names) // rows
    for panel in axes[-columns:]:
        panel.set_xlabel(TIME)
    for panel in axes[::columns]:
        panel.set_ylabel(DISPLACEMENT)
    legend_below(figure, axes[0], 4)
    return figure


def figure_2() -> Figure:
    """Draw the linear systems A to F."""
    names = {
        f"fig2{letter}": f"{letter.upper()}: {_label(scene(f'fig2{letter}'))}"
        for letter in "abcdef"
    }
    for name in ("fig2d", "fig2f"):
        names[name] += ", $m_1 \\to 0$"
    return _time_panels(names, 0.5, 2, 4.2)


def figure_3() -> Figure:
    """Draw eigenvalues and receptances of the same systems (reconstructed)."""
    figure, (plane, response) = panels(3.2, 1, 2)
    frequencies = np.geomspace(1.0, 1e3, 600)
    for i, letter in enumerate("abcdef"):
        system, colour = scene(f"fig2{letter}"), COLOURS[i]
        values = modes(system).eigenvalues
        values = values[np.abs(values) < FASTEST]
        plane.plot(
            values.real,
            values.imag,
            "osD^vP"[i],
            color=colour,
            markersize=5,
            alpha=0.75,
            label=letter.upper(),
        )
        receptance = np.abs(frequency_response(system, frequencies).force[:, 0])
        response.loglog(frequencies, MILLI * receptance, STYLES[i // 3], color=colour)
    plane.margins(x=0.05)
    plane.set(xlabel="real part [1/s]", ylabel="imaginary part [rad/s]")
    plane.set_title("eigenvalues (reconstructed)", loc="left")
    response.set(xlabel="frequency [rad/s]", ylabel="$|x_1 / F|$ [mm/N]")
    response.set_title("receptance of the carriage (reconstructed)", loc="left")
    legend_below(figure, plane, 6)
    return figure


def figure_5() -> Figure:
    """Draw the systems with the experiment's parameters."""
    names = {
        f"fig5{letter}": f"{letter.upper()}: {_label(scene(f'fig5{letter}'))}" for letter in "ab"
    }
    return _time_panels(names, 10.0, 1, 2.6)


def _linear_twin(system: Scene) -> Scene:
    return system.replace(**{"carriage.cubic_coefficient": 0.0})


def _fine(system: Scene) -> Scene:
    """Return the scene with control steps short enough for smooth curves."""
    return system.replace(**{"control.time_step": 5e-5})


def figure_6() -> Figure:
    """Draw the cubic carriage spring beside the linear one."""
    figure, axes = panels(4.2, 2, 2, sharex="all", sharey="row")
    for column, name in enumerate(("fig6a", "fig6d")):
        system = scene(name)
        for i, (variant, label) in enumerate(
            (
                (system, "cubic, $\\beta = 2 \\times 10^6$ m$^{-2}$"),
                (_linear_twin(system), "linear, $\\beta = 0$"),
            )
        ):
            trajectory = simulate(_fine(variant), duration=0.4)
            x1, x2 = MILLI * trajectory.state[:, :2].T
            look = {"color": COLOURS[i], "linestyle": STYLES[i], "linewidth": 1.0, "label": label}
            axes[column].plot(trajectory.time, x1, **look)
            axes[2 + column].plot(trajectory.time, x2 - x1, **look)
        axes[column].set_title(f"{name[-1].upper()}: {_label(system)}", loc="left")
        axes[2 + column].set_xlabel(TIME)
    axes[0].set_ylabel("carriage $x_1$ [mm]")
    axes[2].set_ylabel(OFFSET)
    legend_below(figure, axes[0], 2)
    return figure


def figure_7() -> Figure:
    """Draw phase portraits of the systems of figure 6 (reconstructed)."""
    figure, axes = panels(5.2, 2, 2)
    for column, name in enumerate(("fig6a", "fig6d")):
        system = scene(name)
        for i, (variant, label) in enumerate(((system, "cubic"), (_linear_twin(system), "linear"))):
            x1, x2, v1, v2 = simulate(_fine(variant), duration=1.0).state.T
            look = {"color": COLOURS[i], "linewidth": (0.6, 1.4)[i], "label": label}
            axes[column].plot(MILLI * x1, v1, **look)
            axes[2 + column].plot(MILLI * (x2 - x1), v2 - v1, **look)
        axes[column].set(xlabel="carriage $x_1$ [mm]", ylabel="$v_1$ [m/s]")
        axes[2 + column].set(xlabel=OFFSET, ylabel="$v_2 - v_1$ [m/s]")
        axes[column].set_title(f"{name[-1].upper()}: {_label(system)} (reconstructed)", loc="left")
    for panel in axes:
        panel.margins(x=0.04)
    legend_below(figure, axes[0], 2)
    return figure


def _slip_panels(systems: dict[str, Scene], duration: float) -> Figure:
    """Draw offset and slip velocity over time, the offset at rest and the reference velocity."""
    figure, (offset, slip) = panels(4.2, 2, 1, sharex="all")
    for i, (label, system) in enumerate(systems.items()):
        trajectory = simulate(system, duration=duration)
        x1, x2, v1, v2 = trajectory.state.T
        look = {"color": COLOURS[i], "linestyle": STYLES[i % len(STYLES)]}
        rest = MILLI * asymptotic_offset(system)
        offset.plot(
            trajectory.time, MILLI * (x2 - x1), label=f"{label}: {rest:.3f} mm at rest", **look
        )
        offset.axhline(rest, color=COLOURS[i], linewidth=0.7, linestyle=":")
        slip.plot(trajectory.time, v2 - v1, **look)
    for sign in (-1.0, 1.0):
        slip.axhline(sign * REFERENCE_VELOCITY, color="0.4", linewidth=0.8, linestyle=":")
    slip.text(duration, REFERENCE_VELOCITY, "$v_r$ ", ha="right", va="bottom", color="0.3")
    offset.set_ylabel(OFFSET)
    slip.set(xlabel=TIME, ylabel=SLIP)
    legend_below(figure, offset, len(systems))
    return figure


def figure_8() -> Figure:
    """Draw dry friction: the sphere does not return to its offset of 20 mm, for any chi."""
    systems = {
        f"$\\chi$ = {chi:g} N s/m": scene("fig8").replace(**{"interface.slip_damping": chi})
        for chi in (0.0, 0.1, 1.0)
    }
    return _slip_panels(systems, 0.6)


def figure_9() -> Figure:
    """Draw dry friction that keeps the offset's memory: a smaller release never reaches v_r."""
    memory = scene("fig9")
    lost = memory.replace(**{"initial.carriage_displacement": 0.01})
    return _slip_panels({"$x_1(0)$ = 5 mm": memory, "$x_1(0)$ = 10 mm": lost}, 0.6)


def _diagram(axes: Axes, curves: dict[str, Scene], velocities: NDArray[np.float64]) -> None:
    for i, (label, system) in enumerate(curves.items()):
        offsets = bifurcation(system, "interface.reference_velocity", velocities)
        axes.plot(velocities, MILLI * offsets, ".", color=COLOURS[i], markersize=1.8, label=label)
    critical = critical_reference_velocity(next(iter(curves.values())))
    axes.axvline(critical, color="0.4", linewidth=0.8, linestyle=":")
    axes.text(
        critical,
        0.02,
        f" {critical:.4f} m/s",
        transform=axes.get_xaxis_transform(),
        va="bottom",
        color="0.3",
    )
    axes.legend(markerscale=5.0, handletextpad=0.2, loc="upper right")
    axes.set_xlim(0.0, 1.0)
    axes.set(xlabel="reference velocity $v_r$ [m/s]", ylabel="offset at rest [mm]")


def figure_10() -> Figure:
    """Draw the offset at rest against v_r, for several chi and ratios of the coefficients."""
    figure, (by_chi, by_ratio) = panels(3.4, 1, 2, sharey="all")
    system = scene("fig10")
    chi = {
        f"$\\chi$ = {value:g}": system.replace(**{"interface.slip_damping": value}) for value in CHI
    }
    ratio = {
        f"$\\mu_2 / \\mu_1$ = {value:g}": system.replace(
            **{"interface.kinetic_coefficient": STATIC * value}
        )
        for value in RATIOS
    }
    _diagram(by_chi, chi, FRICTION_VELOCITIES)
    _diagram(by_ratio, ratio, FRICTION_VELOCITIES)
    by_chi.set_title("$\\mu_2 / \\mu_1$ = 0.5, $\\chi$ [N s/m]", loc="left")
    by_ratio.set_title("$\\chi$ = 0.1 N s/m", loc="left")
    by_ratio.set_ylabel("")
    return figure


def figure_12() -> Figure:
    """Draw the sphere on springs."""
    names = {
        f"fig12{letter}": f"{letter.upper()}: {_label(scene(f'fig12{letter}'))}" for letter in "ad"
    }
    return _time_panels(names, 1.0, 1, 2.6)


def draw(name: str, path: str | PathLike[str]) -> None:
    """Draw one figure, such as "fig2", and write it as PNG."""
    with style():
        save(FIGURES[name](), path)


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig2": figure_2,
    "fig3": figure_3,
    "fig5": figure_5,
    "fig6": figure_6,
    "fig7": figure_7,
    "fig8": figure_8,
    "fig9": figure_9,
    "fig10": figure_10,
    "fig12": figure_12,
}
"""The function that draws each figure."""
