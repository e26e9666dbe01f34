"""The tuning of a scene: its optimum, whether the springs reach it, and the tuned scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.analysis.springs import spring_stiffness, stretch_for_stiffness
from mm_gym.analysis.tuning_closed_forms import CLOSED_FORMS, Absorber, closed_form
from mm_gym.analysis.tuning_criteria import largest_peak
from mm_gym.analysis.tuning_report import draw, table
from mm_gym.analysis.tuning_search import CRITERIA, FREQUENCY_RATIOS, Problem, measure, search
from mm_gym.analysis.tuning_transfer import check_path, transfer, without_dimension
from mm_gym.analysis.values import Linear, linear_values
from mm_gym.drawing import save, style
from mm_gym.errors import DesignError, OutOfReachError, suggest
from mm_gym.files import write_text
from mm_gym.scene.toml_text import toml_of

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.figure import Figure

    from mm_gym.scene.scene import Scene

REACHED = 1e-9
"""Relative distance from the end of the springs' range that is round-off."""


class Design(NamedTuple):
    """A stiffness and a damping, and what they attain.

    Attributes
    ----------
    stiffness, damping
        k2 [N/m] and c [N s/m].
    frequency_ratio, damping_ratio
        f = w2 / w1, and zeta = c / (2 m2 w2); without springs 0, and zeta = c / (2 m2 w1).
    value
        The criterion, without dimension as in `Absorber`.
    peak_frequency
        Where the amplitude is largest [rad/s].
    peak
        The largest amplitude, without dimension.
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
    """The optimum of a scene.

    Attributes
    ----------
    scene, tuned
        The scene, and the same with the optimal stretch and damping.
    excitation, channel, criterion
        What it was tuned for, see `tune`.
    before, free, after
        The scene's own design; the optimum of springs of any stiffness; the optimum that the
        scene's springs reach, which is that of `tuned`.
    stretch
        Stretch of the springs in `tuned` [-], or None without springs.
    closed_forms
        Those for this excitation, channel and criterion.
    out_of_reach
        Why the springs do not reach `free`, or None if they do.
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
        return table(self)

    def plot(self, path: str | PathLike[str] | None = None) -> Figure:
        """Draw the frequency response before and after, and write it as a PNG if a path is given.

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            Without matplotlib (extra: plot).
        """
        with style():
            figure = draw(self)
            if path is not None:
                save(figure, path)
        return figure

    def to_toml(self, path: str | PathLike[str]) -> None:
        """Write the tuned scene as a TOML file, whole or not at all."""
        write_text(path, toml_of(self.tuned))


def tune(
    scene: Scene,
    *,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
    criterion: str = "h_infinity",
) -> Tuning:
    """Find the damping of the interface, and the stretch of the springs, that suit a scene best.

    Parameters
    ----------
    scene
        Any scene whose carriage has mass. It is linear about rest: the middle stands for a range,
        the tangent for a cubic spring. Without springs the damping alone is tuned.
    excitation
        "force" on the carriage or "ground"; by default "ground" if all of the scene's excitation
        moves it, else "force". The kind of the scene's excitation is not looked at.
    channel
        What is kept small: one of `mm_gym.tuning.CHANNELS`.
    criterion
        "h_infinity": the largest amplitude over all frequencies; "h2": the variance under white
        noise; "stability": the largest real part of the eigenvalues.

    Returns
    -------
    Tuning
        The optimum with springs of any stiffness, and the best that the scene's springs reach:
        2 k0 < k2 <= 6 k0, or what the limits of `actuation.stretch` leave of that.

    Raises
    ------
    DesignError
        If a name is unknown, the carriage has no mass, the interface is dry friction, what is tuned
        is drawn, or the criterion is infinite for any damping and stiffness.
    """
    excitation = _checked(scene, excitation, channel, criterion)
    drawn = [name for name in TUNED if name in scene.randomization]
    if drawn:
        msg = f"randomization.{drawn[0]}: it is what is tuned; leave it out"
        raise DesignError(msg)
    values = linear_values(scene)
    scaled = without_dimension(values)
    reach = _reach(scene)
    anything = scaled.m2 * np.square(FREQUENCY_RATIOS)
    limits = (0.0, 0.0) if reach is None else (float(anything[0]), float(anything[1]))

    def optimum(stiffness: tuple[float, float]) -> Design:
        problem = Problem(scaled, excitation, channel, criterion, stiffness)
        return _design(values, search(problem), excitation, channel, criterion)

    free = after = optimum(limits)
    reason = None
    if reach is not None:
        reason = _obstacle(reach, free.stiffness)
        if reason is not None:
            after = optimum((reach.low / values.k1, reach.high / values.k1))
    stretch = None if reach is None else _stretch_within(reach, after.stiffness)
    return Tuning(
        scene=scene,
        tuned=_tuned(scene, stretch, after.damping),
        excitation=excitation,
        channel=channel,
        criterion=criterion,
        before=_design(values, scaled, excitation, channel, criterion),
        free=free,
        after=after,
        stretch=stretch,
        closed_forms=_references(
            scaled.m2, (excitation, channel), criterion, has_springs=reach is not None
        ),
        out_of_reach=reason,
    )


def evaluate(
    scene: Scene,
    *,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
    criterion: str = "h_infinity",
) -> Design:
    """Return a scene's own design and what it attains; arguments and errors as for `tune`."""
    excitation = _checked(scene, excitation, channel, criterion)
    values = linear_values(scene)
    return _design(values, without_dimension(values), excitation, channel, criterion)


def stretch_for(scene: Scene, stiffness: float) -> float:
    """Return the stretch [-] at which the scene's springs have a stiffness k2 [N/m].

    Raises
    ------
    OutOfReachError
        If there is none, or it is beyond the limits of `actuation.stretch`; the message says what
        the springs reach, and which `springs.stiffness` would do.
    DesignError
        If the scene has no springs.
    """
    reach = _reach(scene)
    if reach is None:
        msg = "springs.kind: 'none' has no stretch; allowed: 'small_on_large', 'finite_stretch'"
        raise DesignError(msg)
    reason = _obstacle(reach, stiffness)
    if reason is not None:
        raise OutOfReachError(reason)
    return _stretch_within(reach, stiffness)


TUNED = ("interface.damping", "springs.stretch")


def _checked(scene: Scene, excitation: str | None, channel: str, criterion: str) -> str:
    """Return the excitation; raise `DesignError` for what cannot be tuned."""
    if criterion not in CRITERIA:
        near = suggest(criterion, CRITERIA)
        msg = f"criterion: got {criterion!r}{near}; allowed: {', '.join(CRITERIA)}"
        raise DesignError(msg)
    if excitation is None:
        targets = {part.target for part in scene.excitation}
        excitation = "ground" if targets == {"ground"} else "force"
    check_path(excitation, channel)
    if scene.interface.kind == "dry_friction":
        msg = "interface.kind: 'dry_friction' has no damping to tune; allowed: 'viscous', 'none'"
        raise DesignError(msg)
    values = linear_values(scene)
    for name, value in (
        ("carriage.mass", values.m1),
        ("carriage.linear_coefficient", values.k1),
    ):
        if value == 0.0:
            msg = f"{name}: got 0; there is no resonance to tune to; allowed: greater than 0"
            raise DesignError(msg)
    return excitation


class Reach(NamedTuple):
    """What the springs of a scene reach.

    Attributes
    ----------
    k0
        ``springs.stiffness`` [N/m].
    low, high
        Least and largest k2 [N/m]. The least is approached, and not reached, unless the stretch is
        limited.
    shortest, longest
        Least and largest stretch [-].
    is_limited
        Whether `actuation.stretch` limits the stretch.
    """

    k0: float
    low: float
    high: float
    shortest: float
    longest: float
    is_limited: bool


LONGEST = 1e4
"""Stretch [-] that stands for an infinite one: k2 is then 2 k0 but for 2e-12 of it."""


def _reach(scene: Scene) -> Reach | None:
    """Return what the scene's springs reach; None without springs."""
    springs, actuator = scene.springs, scene.actuation.stretch
    if springs.kind == "none":
        return None
    low, high = (1.0, LONGEST) if actuator is None else (actuator.minimum, actuator.maximum)
    k0 = springs.stiffness
    least = spring_stiffness(np.inf if actuator is None else high, k0)
    return Reach(
        k0, float(least), float(spring_stiffness(low, k0)), low, high, actuator is not None
    )


def _obstacle(reach: Reach, stiffness: float) -> str | None:
    """Return why no stretch gives a stiffness [N/m], or None."""
    low, high = reach.low, reach.high
    above = low * (1.0 - REACHED) <= stiffness if reach.is_limited else low < stiffness
    if above and stiffness <= high * (1.0 + REACHED):
        return None
    limits = "the limits of actuation.stretch" if reach.is_limited else "stretch >= 1"
    least, most = reach.k0 * stiffness / high, reach.k0 * stiffness / low
    return (
        f"k2 = {stiffness:.6g} N/m is out of reach: with springs.stiffness = {reach.k0:g} N/m and "
        f"{limits} the springs have {low:.6g} to {high:.6g} N/m. A springs.stiffness from "
        f"{least:.4g} to {most:.4g} N/m reaches it"
    )


def _stretch_within(reach: Reach, stiffness: float) -> float:
    """Return the stretch of a stiffness that is in reach, kept from rounding out of its limits."""
    wanted = stretch_for_stiffness(stiffness, reach.k0)
    return float(np.clip(wanted, reach.shortest, reach.longest))


def _tuned(scene: Scene, stretch: float | None, damping: float) -> Scene:
    """Return the scene with a stretch and a viscous interface."""
    changes: dict[str, object] = {"interface": {"kind": "viscous", "damping": damping}}
    if stretch is not None:
        actuated = scene.actuation.stretch is not None
        changes["initial.stretch" if actuated else "springs.stretch"] = stretch
    return scene.replace(**changes)


def _design(values: Linear, found: Linear, excitation: str, channel: str, criterion: str) -> Design:
    """Return a design from coefficients without dimension."""
    w1 = float(np.sqrt(values.k1 / values.m1))
    peak = largest_peak(transfer(found, excitation, channel))
    f = float(np.sqrt(found.k2 / found.m2))
    return Design(
        stiffness=found.k2 * values.k1,
        damping=found.c * float(np.sqrt(values.k1 * values.m1)),
        frequency_ratio=f,
        damping_ratio=found.c / (2.0 * found.m2 * (f or 1.0)),
        value=measure(found, excitation, channel, criterion),
        peak_frequency=peak.frequency * w1,
        peak=peak.amplitude,
    )


def _references(
    mass_ratio: float, path: tuple[str, str], criterion: str, *, has_springs: bool
) -> tuple[Reference, ...]:
    """Return the closed forms for what is tuned, as far as they hold for the mass ratio."""
    return tuple(
        Reference(name, closed_form(name, mass_ratio), form.source)
        for name, form in CLOSED_FORMS.items()
        if criterion == form.criterion
        and (criterion == "stability" or path == (form.excitation, form.channel))
        and has_springs != name.startswith("lanchester")
        and mass_ratio < form.largest
    )
