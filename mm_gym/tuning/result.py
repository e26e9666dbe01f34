"""The results of tunings: numbers, tables and figures."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.analysis.linear import linear_values
from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, STYLES, drawn, hertz_above, legend_below, panels
from mm_gym.files import aligned, write_text
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_file import toml_of
from mm_gym.step.channels import CHANNELS
from mm_gym.tuning.closed_forms import Absorber
from mm_gym.tuning.reach import springs_with
from mm_gym.tuning.transfer import (
    DAMPING_RATIOS,
    FREQUENCY_RATIOS,
    amplitude,
    si_factor,
    si_unit,
    transfer,
    without_dimension,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
Row = tuple[str, ...]

NAMES = {
    "h_infinity": "the largest amplitude",
    "h2": "the variance under white noise",
    "stability": "the largest real part of the eigenvalues",
}

HEADER = ("", "k2 [N/m]", "c [N s/m]", "stretch", "f", "zeta", "criterion", "peak", "at [rad/s]")
FRICTION_HEADER = (
    *("", "k2 [N/m]", "stretch", "normal force [N]", "friction [N]", "peak", "at [rad/s]"),
)
POINTS = 2000
SPAN = (0.25, 2.0)  # frequencies drawn, over the least and the largest natural frequency


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

    def ends(self) -> list[str]:
        """Return what an optimum has at an end of the range that is searched: it is none."""
        found = self.frequency_ratio, self.damping_ratio * (self.frequency_ratio or 1.0)
        named = ("f", "c / (2 m2 w1)"), found, (FREQUENCY_RATIOS, DAMPING_RATIOS)
        return [
            f"{name} is at an end of what is searched, {low:g} to {high:g}: no optimum is inside"
            for name, value, (low, high) in zip(*named, strict=True)
            if value and not 1.001 * low < value < 0.999 * high
        ]

    def row(self, name: str, stretch: float | None) -> Row:
        """Return its row of a table."""
        return (
            *(name, f"{self.stiffness:.6g}", f"{self.damping:.6g}", _stretch_text(stretch)),
            *(f"{self.frequency_ratio:.6f}", f"{self.damping_ratio:.6f}", f"{self.value:.7g}"),
            *(f"{self.peak:.7g}", f"{self.peak_frequency:.6g}"),
        )


class Reference(NamedTuple):
    """A closed form for the scene's mass ratio, on a carriage without damping."""

    name: str
    absorber: Absorber
    source: str

    def row(self, m2: float, w1: float) -> Row:
        """Return its row of a table, for a sphere [kg] on a carriage of a frequency [rad/s]."""
        a = self.absorber
        k2, c = f"{a.stiffness(m2, w1):.6g}", f"{a.damping(m2, w1):.6g}"
        ratios = f"{a.frequency_ratio:.6f}", f"{a.damping_ratio:.6f}"
        return self.name, k2, c, "", *ratios, f"{a.value:.7g}", "", ""


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
    curve: Array

    def row(self, name: str, stretch: float | None) -> Row:
        """Return its row of a table."""
        numbers = self.normal_force, self.friction_force, self.peak, self.peak_frequency
        own = name, f"{self.stiffness:.6g}", _stretch_text(stretch)
        return *own, *(f"{number:.5g}" for number in numbers)


def _stretch_text(stretch: float | None) -> str:
    return "" if stretch is None else f"{stretch:.6g}"


@dataclass(frozen=True, eq=False)
class Tuned:
    """A scene and the same tuned, with arguments of the tuning."""

    scene: Scene
    tuned: Scene
    excitation: str
    channel: str

    def to_toml(self, path: str | PathLike[str]) -> None:
        """Write the tuned scene as a TOML file, whole or not at all.

        Files of records are named relative to the file's folder.
        """
        write_text(path, toml_of(self.tuned, Path(path).resolve().parent))


@dataclass(frozen=True, eq=False)
class Tuning(Tuned):
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

    criterion: str
    before: Design
    free: Design
    after: Design
    stretch: float | None
    closed_forms: tuple[Reference, ...]
    out_of_reach: str | None

    def table(self) -> str:
        """Return the scene's design, the optima and the closed forms as text."""
        values = linear_values(self.scene)
        w1 = float(np.sqrt(values.k1 / values.m1))
        _, stretch = springs_with(self.scene, self.before.stiffness)
        rows = [HEADER, self.before.row("scene", stretch)]
        if self.out_of_reach is not None:
            rows.append(self.free.row("best springs", None))
        rows.append(self.after.row("tuned", self.stretch))
        rows += [reference.row(values.m2, w1) for reference in self.closed_forms]
        notes = [f"{reference.name}: {reference.source}" for reference in self.closed_forms]
        if self.closed_forms and values.d > 0.0:
            notes.append("closed forms are for a carriage without damping; this one has some")
        if self.out_of_reach is not None:
            worse = abs(self.after.value / self.free.value - 1.0)
            notes.append(f"{self.out_of_reach}. The best that they do is {worse:.2%} worse")
        notes += self.free.ends()
        entering = "excitation of the ground"
        if self.excitation == "force":
            entering = "a force on the carriage"
        path = "over w1" if self.criterion == "stability" else f"of {self.channel} under {entering}"
        title = f"tuned: {NAMES[self.criterion]} {path}; amplitudes without dimension"
        return "\n".join([title, "", *aligned(rows), "", *notes])

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the response before and after, into a PNG if a path is given (extra: plot)."""
        return drawn(_draw, self, path)


@dataclass(frozen=True, eq=False)
class FrictionTuning(Tuned):
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

    amplitude: float
    frequencies: Array
    before: FrictionDesign
    after: FrictionDesign
    stretch: float | None
    out_of_reach: str | None

    def table(self) -> str:
        """Return the scene's design and the best one as text."""
        _, stretch = springs_with(self.scene, self.before.stiffness)
        rows = [self.before.row("scene", stretch), self.after.row("tuned", self.stretch)]
        unit = "N on the carriage" if self.excitation == "force" else "m/s^2 of the ground"
        title = (
            f"tuned: the largest amplitude of {self.channel} [{CHANNELS[self.channel].unit}] under "
            f"a harmonic of {self.amplitude:g} {unit}, simulated"
        )
        notes = [] if self.out_of_reach is None else ["", self.out_of_reach]
        return "\n".join([title, "", *aligned([FRICTION_HEADER, *rows]), *notes])

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the amplitudes before and after, into a PNG if a path is given (extra: plot)."""
        return drawn(_draw_friction, self, path)


def _draw(tuning: Tuning) -> Figure:
    """Return the frequency response before and after; call it within `drawing.style`."""
    values = linear_values(tuning.scene)
    scaled, w1 = without_dimension(values), float(np.sqrt(values.k1 / values.m1))
    designs = [("scene", tuning.before), ("tuned", tuning.after)]
    if tuning.out_of_reach is not None:
        designs.append(("springs of any stiffness", tuning.free))
    frequencies = _frequencies([design for _, design in designs], w1)
    factor = si_factor(values, tuning.excitation, tuning.channel)

    def curve(design: Design) -> Array:
        own = scaled._replace(
            k2=design.stiffness / values.k1,
            c=design.damping / float(np.sqrt(values.k1 * values.m1)),
        )
        path = transfer(own, tuning.excitation, tuning.channel)
        return factor * amplitude(path, frequencies / w1)

    curves = [(name, curve(design)) for name, design in designs]
    return _over_frequency(
        frequencies, curves, tuning.channel, si_unit(tuning.excitation, tuning.channel)
    )


def _draw_friction(tuning: FrictionTuning) -> Figure:
    """Return the amplitudes before and after over frequency."""
    curves = [("scene", tuning.before.curve), ("tuned", tuning.after.curve)]
    unit = CHANNELS[tuning.channel].unit
    return _over_frequency(tuning.frequencies, curves, tuning.channel, unit)


def _over_frequency(
    frequencies: Array, curves: Iterable[tuple[str, Array]], channel: str, unit: str
) -> Figure:
    """Return amplitudes of a channel over frequencies (n,) [rad/s], by name."""
    figure, (axes,) = panels(3.0, 1, 1)
    for k, (name, curve) in enumerate(curves):
        axes.semilogy(frequencies, curve, STYLES[k], color=COLOURS[k], label=name)
    axes.set(xlabel="frequency [rad/s]", ylabel=f"{channel.replace('_', ' ')} [{unit}]")
    hertz_above(axes)
    legend_below(figure, axes, 3)
    return figure


def _frequencies(designs: list[Design], w1: float) -> Array:
    """Return the frequencies [rad/s] to draw, with all peaks among them."""
    natural = [w1]  # and those of the absorbers that have springs
    natural += [design.frequency_ratio * w1 for design in designs if design.frequency_ratio > 0.0]
    low, high = SPAN[0] * min(natural), SPAN[1] * max(natural)
    peaks = [d.peak_frequency for d in designs if low < d.peak_frequency < high]
    return np.sort(np.append(np.linspace(low, high, POINTS), peaks))
