"""The results of tunings: numbers, tables and figures."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.analysis.linear import linear_values
from mm_gym.analysis.springs import stretch_for_stiffness
from mm_gym.drawing import COLOURS, STYLES, drawn, legend_below, panels
from mm_gym.files import write_text
from mm_gym.scene.mechanics import LinearSprings, NoSprings
from mm_gym.scene.toml_file import toml_of
from mm_gym.step.channels import CHANNELS
from mm_gym.tuning.transfer import amplitude, si_factor, si_unit, transfer, without_dimension

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene
    from mm_gym.tuning.closed_forms import Absorber


NAMES = {
    "h_infinity": "the largest amplitude",
    "h2": "the variance under white noise",
    "stability": "the largest real part of the eigenvalues",
}

HEADER = ("", "k2 [N/m]", "c [N s/m]", "stretch", "f", "zeta", "criterion", "peak", "at [rad/s]")
POINTS = 2000
SPAN = (0.25, 2.0)
"""Frequencies drawn, over the least and the largest natural frequency."""


class Design(NamedTuple):
    """A stiffness and a damping, with the values of the criterion.

    Attributes
    ----------
    stiffness, damping
        k2 [N/m] and c [N s/m].
    frequency_ratio, damping_ratio
        f = w2 / w1, and zeta = c / (2 m2 w2); without springs 0, and zeta = c / (2 m2 w1).
    value
        The criterion, dimensionless as in `Absorber`.
    peak_frequency
        Frequency of the largest amplitude [rad/s].
    peak
        The largest amplitude, dimensionless.
    """

    stiffness: float
    damping: float
    frequency_ratio: float
    damping_ratio: float
    value: float
    peak_frequency: float
    peak: float


class Reference(NamedTuple):
    """A closed form for the scene's mass ratio, on a carriage without damping."""

    name: str
    absorber: Absorber
    source: str


@dataclass(frozen=True, eq=False)
class Tuning:
    """The result of `tune`.

    Attributes
    ----------
    scene, tuned
        The scene, and the same with the optimal stretch and damping.
    excitation, channel, criterion
        Arguments of the tuning, see `tune`.
    before, free, after
        The scene's own design; the optimum of springs of any stiffness; the optimum that the
        scene's springs reach, which is that of `tuned`.
    stretch
        Stretch of the springs in `tuned` [-], or None without springs.
    closed_forms
        The closed forms for this excitation, channel and criterion.
    out_of_reach
        Text that says why the springs do not reach `free`, or None if they do.
    """

    scene: Scene
    tuned: Scene
    excitation: str
    channel: str
    criterion: str
    before: Design
    free: Design
    after: Design
    stretch: float | None
    closed_forms: tuple[Reference, ...]
    out_of_reach: str | None

    def table(self) -> str:
        """Return the scene's design, the optima and the closed forms as text."""
        return _table(self)

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the frequency response before and after, and write it as a PNG if a path is given.

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            Without matplotlib (extra: plot).
        """
        return drawn(_draw, self, path)

    def to_toml(self, path: str | PathLike[str]) -> None:
        """Write the tuned scene as a TOML file, whole or not at all.

        Files of records are named relative to the file's folder.
        """
        write_text(path, toml_of(self.tuned, Path(path).resolve().parent))


def _table(tuning: Tuning) -> str:
    """Return the scene's design, the optima and the closed forms as a table, and what it means."""
    values = linear_values(tuning.scene)
    w1 = float(np.sqrt(values.k1 / values.m1))
    stretch = own_stretch(tuning.scene, tuning.before.stiffness)
    rows = [HEADER, _row("scene", tuning.before, stretch)]
    if tuning.out_of_reach is not None:
        rows.append(_row("best springs", tuning.free, None))
    rows.append(_row("tuned", tuning.after, tuning.stretch))
    for reference in tuning.closed_forms:
        a = reference.absorber
        k2, c = a.stiffness(values.m2, w1), a.damping(values.m2, w1)
        numbers = (f"{k2:.6g}", f"{c:.6g}", "", f"{a.frequency_ratio:.6f}")
        rows.append((reference.name, *numbers, f"{a.damping_ratio:.6f}", f"{a.value:.7g}", "", ""))
    return "\n".join([*_title(tuning), "", *columns_of(rows), "", *_notes(tuning, values.d)])


def columns_of(rows: list[tuple[str, ...]]) -> list[str]:
    """Return the lines of a table: names to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _title(tuning: Tuning) -> list[str]:
    path = f"of {tuning.channel} under excitation of the {tuning.excitation}"
    if tuning.excitation == "force":
        path = f"of {tuning.channel} under a force on the carriage"
    if tuning.criterion == "stability":
        path = "over w1"
    return [f"tuned: {NAMES[tuning.criterion]} {path}; amplitudes without dimension"]


def _row(name: str, design: Design, stretch: float | None) -> tuple[str, ...]:
    return (
        name,
        f"{design.stiffness:.6g}",
        f"{design.damping:.6g}",
        "" if stretch is None else f"{stretch:.6g}",
        f"{design.frequency_ratio:.6f}",
        f"{design.damping_ratio:.6f}",
        f"{design.value:.7g}",
        f"{design.peak:.7g}",
        f"{design.peak_frequency:.6g}",
    )


def _notes(tuning: Tuning, damping: float) -> list[str]:
    notes = [f"{reference.name}: {reference.source}" for reference in tuning.closed_forms]
    if tuning.closed_forms and damping > 0.0:
        notes.append("closed forms are for a carriage without damping; this one has some")
    if tuning.out_of_reach is not None:
        worse = abs(tuning.after.value / tuning.free.value - 1.0)
        notes.append(f"{tuning.out_of_reach}. The best that they do is {worse:.2%} worse")
    return notes


def own_stretch(scene: Scene, stiffness: float) -> float | None:
    """Return the stretch of the scene's own design, given its k2: of the middle of its range."""
    springs = scene.springs
    if isinstance(springs, NoSprings | LinearSprings):
        return None
    return float(stretch_for_stiffness(stiffness, springs.stiffness))


def _draw(tuning: Tuning) -> Figure:
    """Return the frequency response before and after; call it within `drawing.style`."""
    values = linear_values(tuning.scene)
    scaled, w1 = without_dimension(values), float(np.sqrt(values.k1 / values.m1))
    designs = [("scene", tuning.before), ("tuned", tuning.after)]
    if tuning.out_of_reach is not None:
        designs.append(("springs of any stiffness", tuning.free))
    frequencies = _frequencies([design for _, design in designs], w1)
    figure, (axes,) = panels(3.0, 1, 1)
    factor = si_factor(values, tuning.excitation, tuning.channel)
    for k, (name, design) in enumerate(designs):
        own = scaled._replace(
            k2=design.stiffness / values.k1,
            c=design.damping / float(np.sqrt(values.k1 * values.m1)),
        )
        curve = amplitude(transfer(own, tuning.excitation, tuning.channel), frequencies / w1)
        axes.semilogy(frequencies, factor * curve, STYLES[k], color=COLOURS[k], label=name)
    name = tuning.channel.replace("_", " ")
    unit = si_unit(tuning.excitation, tuning.channel)
    axes.set(xlabel="frequency [rad/s]", ylabel=f"{name} [{unit}]")
    legend_below(figure, axes, 3)
    return figure


def _frequencies(designs: list[Design], w1: float) -> NDArray[np.float64]:
    """Return the frequencies [rad/s] to draw, with all peaks among them."""
    own = [design.frequency_ratio * w1 for design in designs if design.frequency_ratio > 0.0]
    low, high = SPAN[0] * min(w1, *own), SPAN[1] * max(w1, *own)
    peaks = [d.peak_frequency for d in designs if low < d.peak_frequency < high]
    return np.sort(np.append(np.linspace(low, high, POINTS), peaks))


HEADER = ("", "k2 [N/m]", "stretch", "normal force [N]", "friction [N]", "peak", "at [rad/s]")


class FrictionDesign(NamedTuple):
    """A stiffness and a normal force, with the resulting motion.

    Attributes
    ----------
    stiffness, normal_force, friction_force
        k2 [N/m], F_N [N] and mu2 F_N [N].
    peak, peak_frequency
        The largest amplitude of the simulated steady motion [m or m/s], and its frequency [rad/s].
    curve
        (n,) amplitudes [m or m/s] at `FrictionTuning.frequencies`.
    """

    stiffness: float
    normal_force: float
    friction_force: float
    peak: float
    peak_frequency: float
    curve: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrictionTuning:
    """The result of `friction_absorber`.

    Attributes
    ----------
    scene, tuned
        The scene, and the same with the best normal force and stretch.
    excitation, channel, amplitude
        Arguments of the tuning, see `mm_gym.tuning.friction_absorber`.
    frequencies
        (n,) [rad/s] of the curves.
    before, after
        The scene's own design, and that of `tuned`.
    stretch
        Stretch of the springs in `tuned` [-], or None without springs.
    out_of_reach
        Text that says why the springs do not reach the best stiffness, or None if they do.
    """

    scene: Scene
    tuned: Scene
    excitation: str
    channel: str
    amplitude: float
    frequencies: NDArray[np.float64]
    before: FrictionDesign
    after: FrictionDesign
    stretch: float | None
    out_of_reach: str | None

    def table(self) -> str:
        """Return the scene's design and the best one as text."""
        own = own_stretch(self.scene, self.before.stiffness)
        rows = [HEADER, _row("scene", self.before, own), _row("tuned", self.after, self.stretch)]
        unit = "N on the carriage" if self.excitation == "force" else "m/s^2 of the ground"
        title = (
            f"tuned: the largest amplitude of {self.channel} [{CHANNELS[self.channel].unit}] under "
            f"a harmonic of {self.amplitude:g} {unit}, simulated"
        )
        notes = [] if self.out_of_reach is None else [self.out_of_reach]
        return "\n".join([title, "", *columns_of(rows), *([""] if notes else []), *notes])

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the amplitudes before and after, and write them as a PNG if a path is given.

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            Without matplotlib (extra: plot).
        """
        return drawn(_draw, self, path)

    def to_toml(self, path: str | PathLike[str]) -> None:
        """Write the tuned scene as a TOML file, whole or not at all.

        Files of records are named relative to the file's folder.
        """
        write_text(path, toml_of(self.tuned, Path(path).resolve().parent))


def _draw(result: FrictionTuning) -> Figure:
    """Return the amplitudes before and after over frequency."""
    figure, (axes,) = panels(3.0, 1, 1)
    for k, (name, design) in enumerate((("scene", result.before), ("tuned", result.after))):
        axes.semilogy(result.frequencies, design.curve, STYLES[k], color=COLOURS[k], label=name)
    name = result.channel.replace("_", " ")
    axes.set(xlabel="frequency [rad/s]", ylabel=f"{name} [{CHANNELS[result.channel].unit}]")
    legend_below(figure, axes, 2)
    return figure


def _row(name: str, design: FrictionDesign, stretch: float | None) -> tuple[str, ...]:
    return (
        name,
        f"{design.stiffness:.6g}",
        "" if stretch is None else f"{stretch:.6g}",
        f"{design.normal_force:.5g}",
        f"{design.friction_force:.5g}",
        f"{design.peak:.5g}",
        f"{design.peak_frequency:.5g}",
    )
