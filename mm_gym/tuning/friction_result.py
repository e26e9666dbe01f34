"""The result of tuning an absorber with dry friction: numbers, a table and a figure."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mm_gym.drawing import COLOURS, STYLES, drawn, legend_below, panels
from mm_gym.files import write_text
from mm_gym.scene.toml_text import toml_of
from mm_gym.step.channels import CHANNELS
from mm_gym.tuning.result import columns_of, own_stretch

if TYPE_CHECKING:
    from os import PathLike

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

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
