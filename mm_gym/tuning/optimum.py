"""The optimum of a scene, with any springs and with its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis.values import Linear, linear_values
from mm_gym.errors import DesignError, suggest
from mm_gym.tuning.closed_forms import CLOSED_FORMS, closed_form
from mm_gym.tuning.criteria import largest_peak
from mm_gym.tuning.reach import obstacle, reach_of, springs_with, tuned_field
from mm_gym.tuning.result import Design, Reference, Tuning
from mm_gym.tuning.search import CRITERIA, FREQUENCY_RATIOS, Problem, measure, search
from mm_gym.tuning.transfer import check_path, transfer, without_dimension

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene


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
        parameter is drawn, or the criterion is infinite for every damping and stiffness.
    """
    excitation = _checked(scene, excitation, channel, criterion)
    require_fixed(scene, "interface.damping")
    values = linear_values(scene)
    scaled = without_dimension(values)
    reach = reach_of(scene)
    anything = scaled.m2 * np.square(FREQUENCY_RATIOS)
    limits = (0.0, 0.0) if reach is None else (float(anything[0]), float(anything[1]))

    def optimum(stiffness: tuple[float, float]) -> Design:
        problem = Problem(scaled, excitation, channel, criterion, stiffness)
        return _design(values, search(problem), excitation, channel, criterion)

    free = after = optimum(limits)
    reason = None
    if reach is not None:
        reason = obstacle(reach, free.stiffness)
        if reason is not None:
            after = optimum((reach.low / values.k1, reach.high / values.k1))
    changes, stretch = springs_with(scene, after.stiffness)
    viscous = {"kind": "viscous", "damping": after.damping}
    return Tuning(
        scene=scene,
        tuned=scene.replace(interface=viscous, **changes),
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
    """Return a scene's own design and its values; arguments and errors are those of `tune`."""
    excitation = _checked(scene, excitation, channel, criterion)
    values = linear_values(scene)
    return _design(values, without_dimension(values), excitation, channel, criterion)


def require_fixed(scene: Scene, name: str) -> None:
    """Raise `DesignError` if a field, or that of the springs' stiffness, is drawn."""
    for tuned in (name, tuned_field(scene)):
        if tuned in scene.randomization:
            msg = f"randomization.{tuned}: a tuned field cannot be drawn; leave it out"
            raise DesignError(msg)


def _checked(scene: Scene, excitation: str | None, channel: str, criterion: str) -> str:
    """Return the excitation; raise `DesignError` for what cannot be tuned."""
    if criterion not in CRITERIA:
        near = suggest(criterion, CRITERIA)
        msg = f"criterion: got {criterion!r}{near}; allowed: {', '.join(CRITERIA)}"
        raise DesignError(msg)
    excitation = excitation_of(scene, excitation)
    check_path(excitation, channel)
    if scene.interface.kind not in ("viscous", "none"):
        msg = (
            f"interface.kind: {scene.interface.kind!r} has no damping to tune; allowed: 'viscous', "
            "'none'; for friction see friction_absorber"
        )
        raise DesignError(msg)
    require_resonance(linear_values(scene))
    return excitation


def excitation_of(scene: Scene, excitation: str | None) -> str:
    """Return the excitation that is meant: that of the scene where none is given."""
    if excitation is not None:
        return excitation
    targets = {part.target for part in scene.excitation}
    return "ground" if targets == {"ground"} else "force"


def require_resonance(values: Linear) -> None:
    """Raise `DesignError` for a carriage without mass or without a spring about rest."""
    for name, value in (
        ("carriage.mass", values.m1),
        ("carriage.linear_coefficient", values.k1),
    ):
        if value <= 0.0:
            msg = f"{name}: got {value:g}; allowed: greater than 0, for a resonance to tune to"
            raise DesignError(msg)


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
