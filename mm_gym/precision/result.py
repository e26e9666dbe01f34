"""The result of a work-precision measurement: settings with their error and cost."""

# pyright: reportUnknownMemberType=false
# matplotlib's signatures are typed in part only

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, MARKERS, STYLES, drawn, legend_below, panels
from mm_gym.errors import positive_number
from mm_gym.files import write_csv
from mm_gym.scene.scene import Solver

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LARGEST = 20  # errors that the tail is fitted to, of few a quarter

RETURN = 100.0
"""How many times rarer than the largest sampled error an error above the margin is to be."""

LEAST = 2.0  # least margin
UNKNOWN = 10.0  # margin where there is but one error, and no spread


def margin(errors: Array) -> float:
    """Return the factor on the largest of (n,) errors that later errors hardly exceed.

    Above the (k + 1)-th largest error, log(error) is taken to be exponentially distributed with the
    mean g that the k larger ones have (Hill, *A simple general approach to inference about the tail
    of a distribution*, Ann. Statist. 3, 1975). An error is then larger than the largest of n with
    a probability of about 1 / n, and r times rarer if it is to be larger by r^g.
    """
    if errors.size == 1:
        return UNKNOWN
    count = min(LARGEST, max(1, errors.size // 4))
    ordered = np.sort(errors)[::-1][: count + 1]
    if not (np.isfinite(ordered).all() and ordered[-1] > 0.0):
        return UNKNOWN
    with np.errstate(over="ignore"):  # an infinite margin says that nothing is known of the tail
        return float(max(LEAST, RETURN ** np.log(ordered[:-1] / ordered[-1]).mean()))


LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)  # errors that a setting is recommended for
RULE = 3  # rule of three: with 95 % confidence what n samples do not show is rarer than 3 of n
WIDTH = 48  # characters of the longest setting


@dataclass(frozen=True)
class Setting:
    """A method with its setting, as measured on a scene.

    Attributes
    ----------
    method
        Value of ``solver.method``.
    option
        ``"tolerance"`` or ``"substeps"``; empty for a method without a setting.
    value
        Its value, NaN without one.
    error
        Largest error of a control step that was sampled, relative to the trajectory's scale;
        infinite if the state did not stay finite.
    seconds
        Cost of a control step of one lane [s]; infinite if the state did not stay finite.
    margin
        Factor on the error for the steps that were not sampled, see `mm_gym.precision.result`.
    """

    method: str
    option: str
    value: float
    error: float
    seconds: float
    margin: float = 1.0

    @property
    def bound(self) -> float:
        """The error with its margin, which decides on recommendations."""
        return self.error * self.margin

    @property
    def text(self) -> str:
        """The setting as a scene file states it."""
        option = f", {self.option} = {self.value:g}" if self.option else ""
        return f'method = "{self.method}"{option}'


@dataclass(frozen=True)
class WorkPrecision:
    """What each method costs on a scene, and how exact it is.

    Attributes
    ----------
    settings
        Every setting measured, by method from coarse to fine.
    refused
        Method -> why it does not apply to the scene.
    auto
        The method that ``solver.method = "auto"`` chooses.
    oracle
        What the errors were measured against.
    resolution
        The oracle's own error; smaller ones cannot be told from it.
    checked, steps
        Steps whose error was measured, and control steps that were timed.
    episodes
        Episodes that the former were taken from.
    lanes
        Lanes that were stepped side by side; of several the cost counts for each, with reward,
        termination and observation.
    """

    settings: tuple[Setting, ...]
    refused: dict[str, str]
    auto: str
    oracle: str
    resolution: float
    checked: int
    steps: int
    episodes: int = 1
    lanes: int = 1

    def cheapest(self, error: float) -> Setting | None:
        """Return the cheapest setting whose error, with its margin, is below one; or None.

        Parameters
        ----------
        error
            Error of a control step relative to the trajectory's scale, greater than 0. What is
            below the oracle's own error counts as that.

        Raises
        ------
        SceneError
            If the error is not a number greater than 0.
        """
        error = positive_number("error", error)
        met = [one for one in self.settings if max(one.bound, self.resolution) <= error]
        return min(met, key=lambda one: one.seconds, default=None)

    def table(self) -> str:
        """Return what was measured as text."""
        digits = 3 if self.lanes == 1 else 5
        lines = [
            f"error    largest of {self.checked} random steps in {self.episodes} episodes,",
            "         relative to the trajectory's scale",
            f"         against {self.oracle}, good to {self.resolution:.0e}",
            "margin   factor on it for other steps, from the spread of the largest errors",
            f"cost     mean of {self.steps} control steps{self._side_by_side()}",
            "",
            f"{'solver':{WIDTH}}{'error':>10}{'margin':>9}{'µs a step':>12}",
        ]
        for one in self.settings:
            if not math.isfinite(one.seconds):
                lines.append(f"{one.text:{WIDTH}}{'diverges':>10}{'-':>9}{'-':>12}")
                continue
            default = one.option == "" or one.value == Solver().tolerance
            mark = "  auto" if one.method == self.auto and default else ""
            numbers = f"{one.error:10.1e}{one.margin:9.1f}{one.seconds * 1e6:12.{digits}f}"
            lines.append(f"{one.text:{WIDTH}}{numbers}{mark}")
        lines += [f"{name} does not apply: {why}" for name, why in self.refused.items()]
        return "\n".join(lines)

    def _side_by_side(self) -> str:
        if self.lanes == 1:
            return " of one lane"
        return f", for each of {self.lanes:,} lanes side by side, observed and scored"

    def recommendations(self) -> str:
        """Return the cheapest setting for each of `LEVELS`, and the confidence, as text."""
        return "\n".join([*(self._recommendation(level) for level in LEVELS), self._confidence()])

    def _confidence(self) -> str:
        # Rule of three: what happens in a fraction 3/n of all steps stays away from n independent
        # ones with a probability of (1 - 3/n)^n < exp(-3) = 5 %.
        if self.checked <= RULE:
            return f"too few steps ({self.checked}) were sampled to state a confidence"
        return (
            f"Each was kept in all of {self.checked} sampled steps, with the margin. With 95 % "
            f"confidence it is exceeded in fewer than 1 of {self.checked / RULE:.0f} steps under "
            "such actions."
        )

    def _recommendation(self, level: float) -> str:
        best = self.cheapest(level)
        if best is None:
            return f"for {level:.0e} no setting was seen to suffice"
        return f"for {level:.0e} use {best.text}: {best.seconds * 1e6:.3g} µs a control step"

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the settings as rows; all digits are kept."""
        header = [
            *("method", "option", "value"),
            *("error [-]", "cost of a control step [s]", "margin [-]"),
        ]
        rows = [(s.method, s.option, s.value, s.error, s.seconds, s.margin) for s in self.settings]
        write_csv(path, header, list(zip(*rows, strict=True)))

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw cost over error, a curve per method, into a PNG if a path is given (extra: plot)."""
        return drawn(_draw, self, path)


def _draw(result: WorkPrecision) -> Figure:
    """Return the cost of a control step over its error, a curve per method."""
    figure, (axes,) = panels(3.6, 1, 1)
    methods = list(dict.fromkeys(one.method for one in result.settings))
    for k, method in enumerate(methods):
        own = [one for one in result.settings if one.method == method and math.isfinite(one.error)]
        # What is below the oracle's own error lies on its edge.
        errors = [max(one.error, result.resolution) for one in own]
        auto = method == result.auto
        axes.plot(
            errors,
            [1e6 * one.seconds for one in own],
            label=f"{method} (auto)" if auto else method,
            color="k" if auto else COLOURS[k % len(COLOURS)],
            linestyle=STYLES[k % len(STYLES)],
            marker=MARKERS[k % len(MARKERS)],
            markersize=7.0 if auto else 4.0,
            zorder=3.0 if auto else 2.0,
        )
    axes.axvspan(0.1 * result.resolution, result.resolution, color="0.9", label="error of SciPy")
    axes.set(xscale="log", yscale="log", xlim=(1.0, 0.3 * result.resolution))
    axes.set(xlabel="error of a control step [-]", ylabel="cost of a control step [µs]")
    legend_below(figure, axes, len(methods) + 1)
    return figure
