"""A reduction compared with the whole structure and its device: numbers, a table and a figure."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
# matplotlib's signatures are typed in part only, and so is SciPy's linear algebra

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_lyapunov

from mm_gym.arrays import Array
from mm_gym.drawing import COLOURS, STYLES, drawn, legend_below, panels
from mm_gym.errors import StructureError, refuse
from mm_gym.files import aligned
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.task import middle
from mm_gym.records import Record
from mm_gym.records.text import evenly
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.simulation.response import root_mean_square
from mm_gym.simulation.simulate import checked_motion
from mm_gym.structure.full_model import FullModel
from mm_gym.structure.structure import Reduction, drift_matrix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mm_gym.simulation.simulate import Policy

POINTS = 20
"""Instants to the shortest natural period, so that peaks are within 1.3 % of those in between."""

MOST_INSTANTS = 1_000_000  # most instants of a comparison: each is a matrix product

MOST_PER_SAMPLE = 16
"""Instants to a sample of the ground's motion at most: it moves little that is faster."""

MOST_SHOWN = 12  # storeys whose drifts a table shows one by one

HEADER = ("", "unit", "peak full", "reduced", "error", "rms full", "reduced", "error", "difference")


class Row(NamedTuple):
    """A response of the whole structure and of its reduction."""

    name: str
    unit: str
    full_peak: float  # largest magnitude at the instants
    reduced_peak: float
    full_rms: float  # root mean square over time
    reduced_rms: float
    # root mean square of the difference over that of the whole structure [-]: the error of the
    # motion itself, which is larger than the error of the root mean square
    difference_rms: float

    @property
    def peak_error(self) -> float:
        """Relative error of the peak [-], positive where the reduction moves more."""
        return self.reduced_peak / self.full_peak - 1.0

    @property
    def rms_error(self) -> float:
        """Relative error of the root mean square [-], positive where the reduction moves more."""
        return self.reduced_rms / self.full_rms - 1.0


@dataclass(frozen=True, eq=False)
class Comparison:
    """Motions of the whole structure and of its reduction under one motion of the ground.

    Attributes
    ----------
    reduction, scene
        The compared reduction and scene.
    time
        (k,) [s].
    full, reduced
        Displacements (k, n) [m] of the degrees of freedom, relative to the ground; those of the
        reduction are shape * x1.
    rows
        The responses: displacement and absolute acceleration of the device's degree of freedom,
        the device's stroke, and each interstorey drift of a structure of storeys.
    """

    reduction: Reduction
    scene: Scene
    time: Array
    full: Array
    reduced: Array
    rows: tuple[Row, ...]

    def __getitem__(self, name: str) -> Row:
        """Return a row by its name."""
        found = {row.name: row for row in self.rows}
        if name not in found:
            refuse("comparison", f"{name!r}", ", ".join(map(repr, found)), StructureError)
        return found[name]

    def table(self) -> str:
        """Return the rows as text: peaks and root mean squares, and their relative errors.

        If there are more than `MOST_SHOWN` drifts, it shows the largest one and the one with the
        largest error.
        """
        cells = [HEADER, *(_cells(row) for row in self.rows if row not in self._left_out())]
        return "\n".join(aligned(cells, names=2))

    def _left_out(self) -> set[Row]:
        drifts = [row for row in self.rows if row.name.startswith("drift")]
        if len(drifts) <= MOST_SHOWN:
            return set()
        largest = max(drifts, key=lambda row: row.full_peak)
        return set(drifts) - {largest, max(drifts, key=lambda row: abs(row.peak_error))}

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw displacement and largest drifts, into a PNG if a path is given (extra: plot)."""
        return drawn(_draw, self, path)


def compare(
    reduction: Reduction,
    scene: Scene,
    ground: ArrayLike | Record,
    *,
    duration: float | None = None,
    action: ArrayLike | Policy | None = None,
) -> Comparison:
    """Compare a scene with the whole structure that carries the same device.

    The ground motion replaces the scene's excitation. Without an action, actuators exert no force
    and keep stretch and damping. The motion with a linear device is exact up to round-off, by a
    matrix exponential from sample to sample. SciPy integrates any other device to 1e-8.

    Parameters
    ----------
    reduction
        The reduction that the scene was made from.
    scene
        A scene without ranges, of `Reduction.scene`.
    ground
        (k, 2) increasing times [s] and accelerations [m/s^2], or a record of them; linear in
        between, zero before and after.
    duration
        Duration of the motion [s]; by default that of the record.
    action
        Commands to the actuators, as for `mm_gym.simulate`: a force, or the damping of a viscous
        interface. A function of time [s] and state (4,) is called for the scene's motion first,
        then for the structure's, with the displacement and velocity of the device's degree of
        freedom in place of x1 and v1. Both times it begins at 0 s. The device must be linear.

    Raises
    ------
    StructureError
        If the scene has another carriage or ranges, the comparison is too long, or the whole
        structure has no counterpart of an actuator.
    ActionError
        If the action does not fit the actuators.
    SimulationError
        If the ground motion contains anything but numbers, or a motion cannot be completed.
    SceneError
        If its times do not increase.
    """
    _check(reduction, scene)
    if isinstance(ground, Record):
        ground = np.column_stack([ground.times, ground.values])
    samples = checked_motion(ground)
    time = _instants(reduction, samples, duration)
    still = scene.replace(excitation=[])
    model = FullModel(reduction, still, action)
    short = reduction.simulate(still, samples, times=time, action=action)
    whole = model.motion(time, samples)
    x1, x2 = short.state[:, 0], short.state[:, 1]
    reduced = np.outer(x1, reduction.shape)
    place, own = reduction.place, whole.displacement[:, reduction.device - 1]
    responses = [
        (f"displacement of {place}", "m", own, x1),
        (f"acceleration of {place}", "m/s²", whole.acceleration, short.acceleration[:, 0]),
    ]
    if not scene.interface.kind == scene.springs.kind == "none":  # else the device is free
        responses.append(("stroke of the device", "m", whole.stroke, x2 - x1))
    if reduction.structure.storeys:
        drifts = drift_matrix(reduction.structure.count).T
        pairs = zip((whole.displacement @ drifts).T, (reduced @ drifts).T, strict=True)
        responses += [(f"drift of storey {k}", "m", *pair) for k, pair in enumerate(pairs, 1)]
    rows = tuple(_row(time, *response) for response in responses)
    return Comparison(reduction, scene, time, whole.displacement, reduced, rows)


def white_noise(duration: float, time_step: float, *, rms: float = 1.0, seed: int = 0) -> Array:
    """Return a ground motion (k, 2): times [s], and independent normal accelerations [m/s^2].

    The samples are connected by straight lines. The motion is therefore white only up to about a
    quarter of 1 / time_step [Hz], where its power has fallen by a third.

    Parameters
    ----------
    duration, time_step
        [s].
    rms
        Root mean square of the samples [m/s^2].
    seed
        Seed of `numpy.random.default_rng`.

    Raises
    ------
    StructureError
        If there are not two samples, or more than `MOST_INSTANTS`.
    """
    count = duration / time_step if time_step > 0.0 else np.nan
    if not 1.0 <= count <= MOST_INSTANTS:
        allowed = f"1 to {MOST_INSTANTS} steps"
        refuse("white noise", f"{duration} s in steps of {time_step} s", allowed, StructureError)
    samples = rms * np.random.default_rng(seed).standard_normal(round(count) + 1)
    return np.column_stack([evenly(len(samples), time_step), samples])


class BalancedError(NamedTuple):
    """Error of a balanced mapping under white noise, relative to the exact one."""

    displacement: float  # of x1: root mean square of the difference over that of the exact motion
    stroke: float  # the same of x2 - x1
    displacement_rms: float  # relative change of the root mean square itself
    stroke_rms: float


def balanced_error(reduction: Reduction, scene: Scene) -> BalancedError:
    """Return the error of the mapping "balanced" under white noise of the ground.

    The scene is linearised about equilibrium, in the middle of every range. The difference of the
    mappings is a pair of forces m1 m2 / (m1 + m2) (Gamma - r_j) a between carriage and device,
    (S7), so it vanishes with m2.

    Raises
    ------
    StructureError
        If the motion has no finite variance, because the scene is not asymptotically stable.
    """
    a, _ = compile_scene(scene).linear()
    shift = np.array([[1.0, 0.0], [-1.0, 1.0]])  # x1, x2 - x1
    turn = np.kron(np.eye(2), shift)
    a = turn @ a @ np.linalg.inv(turn)
    gamma, own = reduction.participation, reduction.ground
    mass = middle(scene, "sphere.mass", scene.sphere.mass)
    balance = reduction.shaking.balance(mass)
    exact = np.array([0.0, 0.0, *(shift @ [-gamma, -own])])
    scaled = np.array([0.0, 0.0, *(shift @ [-balance, -balance])])
    if np.linalg.eigvals(a).real.max() >= 0.0:
        msg = "scene: the motion has no variance under white noise; allowed: damping and springs"
        raise StructureError(msg)
    difference, one, other = (
        np.sqrt(np.diag(solve_continuous_lyapunov(a, -np.outer(b, b)))[:2])
        for b in (exact - scaled, exact, scaled)
    )
    return BalancedError(*map(float, (*(difference / one), *(other / one - 1.0))))


def _check(reduction: Reduction, scene: Scene) -> None:
    require_scene(scene)
    own = (reduction.mass, reduction.stiffness, reduction.damping, 1.0, 0.0)
    names = ("mass", "stiffness", "damping", "linear_coefficient", "cubic_coefficient")
    for name, value in zip(names, own, strict=True):
        got = getattr(scene.carriage, name)
        if got != value:
            allowed = f"{value:g}, that of the reduction"
            refuse(f"carriage.{name}", f"{got:g}", allowed, StructureError)
    ranges = [f"initial.{name}" for name, value in scene.initial if isinstance(value, tuple)]
    ranges += [f"randomization.{name}" for name in scene.randomization]
    if ranges:
        msg = f"{ranges[0]}: got a range; a comparison needs one value for every field"
        raise StructureError(msg)


def _instants(reduction: Reduction, ground: Array, duration: float | None) -> Array:
    """Return instants [s], some for every sample of the ground's motion, evenly until the end."""
    spacing = float(np.diff(ground[:, 0]).min())
    if not spacing > 0.0:
        refuse("ground", "times that do not increase", "increasing times [s]")
    end = float(ground[-1, 0]) if duration is None else duration
    fastest = float(reduction.structure.frequencies[-1])
    per_sample = np.ceil(spacing * fastest / (2.0 * np.pi) * POINTS)
    step = spacing / float(np.clip(per_sample, 1, MOST_PER_SAMPLE))
    count = end / step
    if not 1.0 - 1e-9 <= count <= MOST_INSTANTS:
        allowed = f"1 to {MOST_INSTANTS}, {step:g} s apart"
        refuse("duration", f"{end:g} s, which is {count:g} instants", allowed, StructureError)
    even = evenly(int(count * (1.0 + 1e-12)) + 1, step)
    return even if end - even[-1] <= 1e-9 * step else np.append(even, end)


def _row(time: Array, name: str, unit: str, full: Array, reduced: Array) -> Row:
    rms = root_mean_square(time, full)
    peaks = float(np.abs(full).max()), float(np.abs(reduced).max())
    if rms == 0.0:
        msg = f"ground: this motion does not move the structure: {name} is 0 at all times"
        raise StructureError(msg)
    difference = root_mean_square(time, reduced - full) / rms
    return Row(name, unit, *peaks, rms, root_mean_square(time, reduced), difference)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        *(row.name, row.unit),
        *(f"{row.full_peak:.4g}", f"{row.reduced_peak:.4g}", f"{row.peak_error:+.1%}"),
        *(f"{row.full_rms:.4g}", f"{row.reduced_rms:.4g}", f"{row.rms_error:+.1%}"),
        f"{row.difference_rms:.1%}",
    )


def _draw(comparison: Comparison) -> Figure:
    """Return displacements over time, and largest drifts over storeys, within `drawing.style`."""
    reduction = comparison.reduction
    drifts = [row for row in comparison.rows if row.name.startswith("drift")]
    figure, axes = panels(4.6 if drifts else 2.6, 1 + bool(drifts), 1)
    column = reduction.device - 1
    for k, (name, motion) in enumerate(
        (("whole structure", comparison.full), ("two masses", comparison.reduced))
    ):
        colour, curve = COLOURS[k], 1e3 * motion[:, column]
        axes[0].plot(comparison.time, curve, STYLES[k], color=colour, label=name)
        if drifts:
            peaks = [1e3 * (row.full_peak, row.reduced_peak)[k] for row in drifts]
            places = np.arange(1, len(peaks) + 1) + 0.4 * k - 0.2
            hatch = ("", "//")[k]
            axes[1].bar(places, peaks, 0.4, color=colour, edgecolor="white", hatch=hatch)
    axes[0].set(xlabel="time [s]", ylabel=f"{comparison.rows[0].name} [mm]")
    if drifts:
        axes[1].set(xlabel="storey", ylabel="largest drift [mm]")
        axes[1].margins(x=0.02)
        axes[1].set_xticks(range(1, len(drifts) + 1))
        axes[1].grid(visible=False, axis="x")
    legend_below(figure, axes[0], 2)
    return figure
