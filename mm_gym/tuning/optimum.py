"""The stiffness and damping that minimise a criterion, with any springs and with a scene's own."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false
# SciPy ships no types

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter
from scipy.optimize import minimize, root

from mm_gym.analysis.linear import Linear, characteristic, linear_values
from mm_gym.arrays import Array
from mm_gym.errors import DesignError, check_name, refuse
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.tuning.closed_forms import CLOSED_FORMS, closed_form
from mm_gym.tuning.reach import obstacle, reach_of, require_fixed, springs_with, tuned_field
from mm_gym.tuning.result import Design, Reference, Tuning
from mm_gym.tuning.transfer import (
    CHANNELS,
    DAMPING_RATIOS,
    EXCITATIONS,
    FREQUENCY_RATIOS,
    Peak,
    Transfer,
    abscissa,
    amplitude,
    largest_peak,
    rough_peak,
    stationary_points,
    transfer,
    valley,
    variance,
    without_dimension,
)

CRITERIA = ("h_infinity", "h2", "stability")

GRID = 32  # points of the grid on which the search begins, each way

STARTS, APART, WORSE = 3, 3.0, 1.5
"""It continues from so many points of the grid at most, so many of its spacings apart, and none
that is worse by more than this factor than the best."""

ROUGH = np.concatenate([[0.0], np.geomspace(0.01, 100.0, 60)])
"""Frequencies over w1 at which the grid's amplitudes are looked at."""

MINIMA = 10  # the same for stability, whose eigenvalues meet and part along many curves

PAIRS = 5  # values of each unknown from which a double pair of eigenvalues is looked for

STEP = 1e-5  # step of central differences, of logarithms: their error is some 1e-10
ROUNDS = 6  # times that the frequency between the two peaks is found anew


class Goal(NamedTuple):
    """What is minimised, see `tune`; of coefficients without dimension."""

    excitation: str
    channel: str
    criterion: str

    def transfer(self, values: Linear) -> Transfer:
        """Return the transfer function."""
        return transfer(values, self.excitation, self.channel)

    def measure(self, values: Linear) -> float:
        """Return the criterion: a peak, a variance, or the largest real part of an eigenvalue."""
        path = self.transfer(values)
        if self.criterion == "h_infinity":
            return largest_peak(path).amplitude
        if self.criterion == "h2":
            return variance(path)
        own = characteristic(values)
        free = values.k2 == 0.0  # the sphere rests anywhere
        return abscissa(np.trim_zeros(own, "b") if free else own)


@dataclass(frozen=True)
class Problem:
    """What is tuned, and for what."""

    values: Linear  # coefficients without dimension; k2 and c are replaced
    goal: Goal
    stiffness: tuple[float, float]  # (lowest, highest) k2 / k1 allowed; both 0 without springs

    @property
    def has_springs(self) -> bool:
        """Whether the stiffness is tuned and not only the damping."""
        return self.stiffness[1] > 0.0

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of the unknowns: the logarithms of c and, with springs, of k2."""
        damping = 2.0 * self.values.m2 * np.array(DAMPING_RATIOS)
        limits = [damping, self.stiffness] if self.has_springs else [damping]
        return [(float(np.log(low)), float(np.log(high))) for low, high in limits]

    def at(self, unknowns: Array) -> Linear:
        """Return the coefficients for some unknowns."""
        c = float(np.exp(unknowns[0]))
        k2 = float(np.exp(unknowns[1])) if self.has_springs else 0.0
        return self.values._replace(c=c, k2=k2)

    def transfer(self, unknowns: Array) -> Transfer:
        """Return the transfer function for some unknowns."""
        return self.goal.transfer(self.at(unknowns))

    def measure(self, unknowns: Array) -> float:
        """Return the criterion for some unknowns."""
        return self.goal.measure(self.at(unknowns))


def search(problem: Problem) -> Linear:
    """Return the coefficients, without dimension, that minimise a problem's criterion."""
    starts = _starts(problem)
    improve = {"h_infinity": _minimax, "h2": _smooth, "stability": _slowest}[problem.goal.criterion]
    best = min((improve(problem, start) for start in starts), key=problem.measure)
    if problem.goal.criterion == "stability" and problem.has_springs:
        best = _coinciding(problem, best)
    return problem.at(best)


def _starts(problem: Problem) -> list[Array]:
    """Return the best points of a grid; for stability its local minima, as it has many."""
    axes = [np.linspace(low, high, GRID if high > low else 1) for low, high in problem.bounds]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    if problem.goal.criterion == "h_infinity":  # an estimate from below takes less time
        sizes = np.array([rough_peak(problem.transfer(point), ROUGH) for point in points])
    else:
        sizes = np.array([problem.measure(point) for point in points])
    order, most = np.argsort(sizes), STARTS
    least = sizes[order[0]]
    if not np.isfinite(least) or least == 0.0:
        excitation, channel, criterion = problem.goal
        flaw = f"has no finite {criterion}" if least else "is 0"  # of springs that are not there
        msg = (
            f"channel: {channel!r} under {excitation!r} excitation {flaw} for any damping and "
            "stiffness; choose another channel or criterion"
        )
        raise DesignError(msg)
    if problem.goal.criterion == "stability":
        around = minimum_filter(sizes.reshape([len(axis) for axis in axes]), 3, mode="nearest")
        order, most = order[(sizes == around.ravel())[order]], MINIMA
    spacing = np.array([max(high - low, 1.0) / GRID for low, high in problem.bounds])
    chosen: list[Array] = []
    for k in order:
        if len(chosen) == most or sizes[k] > least + (WORSE - 1.0) * abs(least):
            break
        if all(np.abs((points[k] - point) / spacing).max() >= APART for point in chosen):
            chosen.append(points[k])
    return chosen


def _gradient(function: Callable[[Array], Any], unknowns: Array) -> Array:
    """Return the gradient by central differences, one row an unknown."""
    steps = STEP * np.eye(len(unknowns))
    return np.array(
        [(function(unknowns + step) - function(unknowns - step)) / (2.0 * STEP) for step in steps]
    )


def _smooth(problem: Problem, start: Array) -> Array:
    """Minimise a variance."""

    def size(unknowns: Array) -> float:
        return float(np.log(problem.measure(unknowns)))

    found = minimize(
        size,
        start,
        jac=lambda unknowns: _gradient(size, unknowns),
        bounds=problem.bounds,
        method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 60},
    )
    return _better(problem, start, np.asarray(found.x))


def _minimax(problem: Problem, start: Array) -> Array:
    """Minimise the largest amplitude: t with t >= the peak on either side of a frequency."""
    # Each peak is a smooth function, their maximum is not.
    best = start
    for _ in range(ROUNDS):
        split = valley(problem.transfer(best))
        found = _epigraph(problem, best, split)
        better = _better(problem, best, found)
        moved = np.abs(better - best).max()
        best = better
        if moved <= 1e-10:  # noqa: PLR2004 - far below what is asked of an optimum
            break
    return best


def _epigraph(problem: Problem, start: Array, split: float) -> Array:
    """Return the minimax with the peaks on both sides of a frequency over w1."""
    sides = ((0.0, split), (split, np.inf))
    known: dict[bytes, list[Peak]] = {}

    def peaks(unknowns: Array) -> list[Peak]:
        key = unknowns.tobytes()
        if key not in known:
            path = problem.transfer(unknowns)
            points = stationary_points(path)
            known[key] = [largest_peak(path, *side, points) for side in sides]
        return known[key]

    def heights(z: Array) -> Array:
        return np.array([z[-1] - np.log(peak.amplitude) for peak in peaks(z[:-1])])

    def slopes(z: Array) -> Array:
        # A peak's slope is that at its fixed frequency; at infinity nothing changes any more.
        at = np.array([min(peak.frequency, 1e6) for peak in peaks(z[:-1])])

        def sizes(unknowns: Array) -> Array:
            return np.log(amplitude(problem.transfer(unknowns), at))

        return np.column_stack([-_gradient(sizes, z[:-1]).T, np.ones(2)])

    last = np.append(np.zeros(len(start)), 1.0)
    found = minimize(
        lambda z: z[-1],
        np.append(start, max(np.log(peak.amplitude) for peak in peaks(start))),
        jac=lambda _: last,
        bounds=[*problem.bounds, (None, None)],
        constraints=[{"type": "ineq", "fun": heights, "jac": slopes}],
        method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 60},
    )
    return np.asarray(found.x[:-1])


def _slowest(problem: Problem, start: Array) -> Array:
    """Minimise the largest real part by simplex."""
    found = minimize(
        problem.measure,
        start,
        bounds=problem.bounds,
        method="Nelder-Mead",
        options={"xatol": 1e-12, "fatol": 1e-15, "maxiter": 4000, "maxfev": 4000},
    )
    return _better(problem, start, np.asarray(found.x))


def _coinciding(problem: Problem, best: Array) -> Array:
    """Return the best of a point and of those where both pairs of eigenvalues coincide.

    Of a heavily damped carriage they are far from where a simplex ends.
    """
    spread = (np.linspace(*bounds, PAIRS) for bounds in problem.bounds)
    for first in (best, *map(np.array, itertools.product(*spread))):
        best = _better(problem, best, _double_pair(problem, first))
    return best


def _double_pair(problem: Problem, start: Array) -> Array:
    """Return where both pairs of eigenvalues coincide, if Newton's method finds it."""

    # The characteristic polynomial is then g4 (s^2 + p s + q)^2: four equations.
    def residual(unknowns: Array) -> Array:
        p, q = np.exp(unknowns[2:])
        square = np.polymul([1.0, p, q], [1.0, p, q])
        own = characteristic(problem.at(unknowns[:2]))
        return (own / own[0] - square)[1:]

    slowest = np.roots(characteristic(problem.at(start)))
    slowest = slowest[int(np.argmax(slowest.real))]
    guess = np.log([max(-2.0 * slowest.real, 1e-12), abs(slowest) ** 2])
    with np.errstate(over="ignore", invalid="ignore"):  # of a search that goes astray
        found = root(residual, np.append(start, guess), tol=1e-14)
    inside = all(
        low <= x <= high for x, (low, high) in zip(found.x[:2], problem.bounds, strict=True)
    )
    return np.asarray(found.x[:2]) if inside else start


def _better(problem: Problem, one: Array, other: Array) -> Array:
    """Return the one with the smaller criterion, within the bounds."""
    low, high = np.array(problem.bounds).T
    other = np.clip(other, low, high)
    if not np.isfinite(other).all():
        return one
    return other if problem.measure(other) <= problem.measure(one) else one


def tune(
    scene: Scene,
    *,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
    criterion: str = "h_infinity",
) -> Tuning:
    """Find the best damping of the interface, and the best stretch or stiffness of the springs.

    Parameters
    ----------
    scene
        Any scene whose carriage has mass. It is linearised about equilibrium: a range is replaced
        by its middle, a cubic spring by its tangent. Without springs only the damping is tuned.
    excitation
        "force" on the carriage or "ground"; by default "ground" if all excitation of the scene
        moves the ground, otherwise "force". The kind and spectrum of the scene's excitation have no
        influence.
    channel
        The minimised quantity: one of `mm_gym.tuning.CHANNELS`.
    criterion
        "h_infinity": the largest amplitude over all frequencies; "h2": the variance under white
        noise; "stability": the largest real part of the eigenvalues.

    Returns
    -------
    Tuning
        The optimum with springs of any stiffness, and the best design that the scene's springs
        reach: 2 k0 < k2 <= 6 k0, or less if `actuation.stretch` has narrower limits. Linear springs
        reach any stiffness.

    Raises
    ------
    DesignError
        If a name is unknown, the carriage has no mass, the interface is dry friction, a tuned
        parameter is drawn, or the criterion is infinite, or the channel 0, for every damping
        and stiffness.
    """
    goal = _goal(scene, excitation, channel, criterion)
    require_fixed(scene, ("interface.damping", tuned_field(scene)))
    values, reach = linear_values(scene), reach_of(scene)
    scaled = without_dimension(values)

    def optimum(low: float, high: float) -> Design:
        return _design(values, search(Problem(scaled, goal, (low, high))), goal)

    reason = None
    if reach is None:
        free = after = optimum(0.0, 0.0)
    else:
        free = after = optimum(*(scaled.m2 * np.square(FREQUENCY_RATIOS)).tolist())
        reason = obstacle(reach, free.stiffness)
        if reason is not None:
            after = optimum(reach.low / values.k1, reach.high / values.k1)
    changes, stretch = springs_with(scene, after.stiffness)
    viscous = {"kind": "viscous", "damping": after.damping}
    return Tuning(
        scene=scene,
        tuned=scene.replace(interface=viscous, **changes),
        **goal._asdict(),
        before=_design(values, scaled, goal),
        free=free,
        after=after,
        stretch=stretch,
        closed_forms=_references(scaled.m2, goal, has_springs=reach is not None),
        out_of_reach=reason,
    )


def evaluate(
    scene: Scene,
    *,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
    criterion: str = "h_infinity",
) -> Design:
    """Return a scene's own design and its values; arguments and errors are those of `tune`."""
    goal = _goal(scene, excitation, channel, criterion)
    values = linear_values(scene)
    return _design(values, without_dimension(values), goal)


def _goal(scene: Scene, excitation: str | None, channel: str, criterion: str) -> Goal:
    """Return what is minimised; raise `DesignError` for what cannot be tuned."""
    check_name("criterion", criterion, CRITERIA, DesignError)
    excitation = excitation_of(scene, excitation)
    check_name("excitation", excitation, EXCITATIONS, DesignError)
    check_name("channel", channel, CHANNELS, DesignError)
    if scene.interface.kind not in ("viscous", "none"):
        msg = (
            f"interface.kind: {scene.interface.kind!r} has no damping to tune; allowed: 'viscous', "
            "'none'; for friction see friction_absorber"
        )
        raise DesignError(msg)
    require_resonance(linear_values(scene))
    return Goal(excitation, channel, criterion)


def excitation_of(scene: Scene, excitation: str | None) -> str:
    """Return the excitation that is meant: that of the scene where none is given."""
    require_scene(scene)
    if excitation is not None:
        return excitation
    targets = {part.target for part in scene.excitation}
    return "ground" if targets == {"ground"} else "force"


def require_resonance(values: Linear) -> None:
    """Raise `DesignError` for a carriage without mass or without a spring about rest."""
    own = {"carriage.mass": values.m1, "carriage.linear_coefficient": values.k1}
    for name, value in own.items():
        if value <= 0.0:
            refuse(name, f"{value:g}", "greater than 0, for a resonance to tune to", DesignError)


def _design(values: Linear, found: Linear, goal: Goal) -> Design:
    """Return a design from coefficients without dimension."""
    w1 = float(np.sqrt(values.k1 / values.m1))
    peak = largest_peak(goal.transfer(found))
    f = float(np.sqrt(found.k2 / found.m2))
    return Design(
        stiffness=found.k2 * values.k1,
        damping=found.c * float(np.sqrt(values.k1 * values.m1)),
        frequency_ratio=f,
        damping_ratio=found.c / (2.0 * found.m2 * (f or 1.0)),
        value=goal.measure(found),
        peak_frequency=peak.frequency * w1,
        peak=peak.amplitude,
    )


def _references(mass_ratio: float, goal: Goal, *, has_springs: bool) -> tuple[Reference, ...]:
    """Return the closed forms for what is tuned, as far as they hold for the mass ratio."""
    return tuple(
        Reference(name, closed_form(name, mass_ratio), form.source)
        for name, form in CLOSED_FORMS.items()
        if goal.criterion == form.criterion
        and (goal.criterion == "stability" or goal[:2] == (form.excitation, form.channel))
        and has_springs != name.startswith("lanchester")
        and mass_ratio < form.largest
    )
