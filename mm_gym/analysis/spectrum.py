"""Response spectra of recorded ground motions, as numbers and as a figure."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, STYLES, drawn, legend_below, panels
from mm_gym.errors import finite_numbers, refuse
from mm_gym.files import aligned, write_csv
from mm_gym.records import Record
from mm_gym.records.spectrum import peak_responses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERIODS = np.geomspace(0.01, 10.0, 241)  # periods by default [s], 80 a decade

COLUMNS = {
    "displacement": "m",
    "pseudo_velocity": "m/s",
    "pseudo_acceleration": "m/s^2",
    "absolute_acceleration": "m/s^2",
}
"""Quantity -> its unit, in the order of tables and panels."""

ROWS = 13  # periods in a table, at most


@dataclass(frozen=True)
class ResponseSpectrum:
    """Largest responses of damped oscillators to a ground motion.

    With w = 2 pi / period, x the displacement relative to the ground and x'' + a the absolute
    acceleration:

    Attributes
    ----------
    periods, damping
        (k,) natural periods without damping [s], and (d,) damping ratios [-].
    displacement
        (d, k) max |x| [m].
    pseudo_velocity, pseudo_acceleration
        (d, k) w max |x| [m/s], and w^2 max |x| [m/s^2].
    absolute_acceleration
        (d, k) max |x'' + a| [m/s^2]; without damping the pseudo-acceleration.
    peak_acceleration
        max |a| of the ground [m/s^2].
    """

    periods: Array
    damping: Array
    displacement: Array
    pseudo_velocity: Array
    pseudo_acceleration: Array
    absolute_acceleration: Array
    peak_acceleration: float

    def table(self) -> str:
        """Return the numbers as text, for at most 13 of the periods."""
        last = len(self.periods) - 1
        shown = np.unique(np.linspace(0, last, min(ROWS, last + 1)).round().astype(int))
        head = [f"{'period [s]':>12}", *(f"{name} [{unit}]" for name, unit in COLUMNS.items())]
        lines = [f"peak acceleration of the ground: {self.peak_acceleration:.6g} m/s^2"]
        for d, ratio in enumerate(self.damping.tolist()):
            columns = [getattr(self, name)[d] for name in COLUMNS]
            rows = [[f"{self.periods[k]:.5g}", *(f"{c[k]:.6g}" for c in columns)] for k in shown]
            lines += ["", f"damping ratio {ratio:g}", *aligned([head, *rows], names=0)]
        return "\n".join(lines)

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write a row for each damping ratio and period, with all digits."""
        grid = np.meshgrid(self.damping, self.periods, indexing="ij")
        header = ["damping", "period [s]", *(f"{name} [{unit}]" for name, unit in COLUMNS.items())]
        columns = [*grid, *(getattr(self, name) for name in COLUMNS)]
        write_csv(path, header, [column.ravel() for column in columns])

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the spectra over the period, into a PNG if a path is given (extra: plot)."""
        return drawn(_draw, self, path)


def response_spectrum(
    record: Record, periods: ArrayLike | None = None, damping: ArrayLike = 0.05
) -> ResponseSpectrum:
    """Return the response spectrum of a ground motion.

    The motion is linear between the samples of the record, and zero before the first and after the
    last one, as in a scene. The responses follow the exact recurrence of Nigam and Jennings (1969).
    They include maxima between samples, and one period of free vibration after the last sample.

    Parameters
    ----------
    record
        A ground acceleration, from `mm_gym.records.read_record`.
    periods
        (k,) natural periods [s]; by default 241 from 0.01 to 10 s.
    damping
        Damping ratio [-], or (d,) of them, from 0 to 10.

    Raises
    ------
    SceneError
        If a period or damping ratio is not allowed.
    """
    if not isinstance(record, Record):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
        refuse("record", type(record).__name__, "a Record, as read_record returns it")
    own = np.atleast_1d(finite_numbers("periods", PERIODS if periods is None else periods))
    ratios = np.atleast_1d(finite_numbers("damping", damping))
    pseudo, absolute = peak_responses(record.times, record.values, own, ratios)
    w = 2.0 * np.pi / own
    return ResponseSpectrum(
        periods=own,
        damping=ratios,
        displacement=pseudo / w**2,
        pseudo_velocity=pseudo / w,
        pseudo_acceleration=pseudo,
        absolute_acceleration=absolute,
        peak_acceleration=float(np.max(np.abs(record.values))),
    )


def _draw(spectrum: ResponseSpectrum) -> Figure:
    figure, axes = panels(4.6, 2, 2, sharex="all")
    order = np.argsort(spectrum.periods)
    for one, (name, unit) in zip(axes, COLUMNS.items(), strict=True):
        for d, ratio in enumerate(spectrum.damping.tolist()):
            look = {"color": COLOURS[d % len(COLOURS)], "linestyle": STYLES[d % len(STYLES)]}
            values = getattr(spectrum, name)[d, order]
            label = f"damping ratio {ratio:g}"
            one.semilogx(spectrum.periods[order], values, label=label, **look)
        if name.endswith("acceleration"):
            label = "largest ground acceleration"
            one.axhline(spectrum.peak_acceleration, color="0.5", linewidth=0.8, label=label)
        quantity = name.replace("_", "-", name.startswith("pseudo")).replace("_", " ")
        one.set(ylabel=f"{quantity} [{unit.replace('^2', '²')}]")
        one.set_ylim(bottom=0.0)
    for one in axes[2:]:
        one.set(xlabel="period [s]")
    legend_below(figure, axes[2], 4)
    return figure
