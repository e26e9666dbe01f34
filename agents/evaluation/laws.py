"""Controllers by the names that commands take."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from agents.controllers.controller import columns
from agents.controllers.lqg import LQG
from agents.controllers.lqr import force_price
from agents.controllers.matching_stretch import FREQUENCY, MatchingStretch
from agents.controllers.random_actions import RandomActions
from agents.evaluation.baselines import (
    FURTHER,
    MAGNETORHEOLOGICAL,
    SEMI_ACTIVE,
    TRACKERS,
    best_clipped_lqr,
    best_constant,
    best_energy_shaping,
    best_feedforward_lqr_with_clipped_lqr,
    best_lqr_at_constant_stretch,
    best_lqr_with_clipped_lqr,
    best_on_off_stiffness,
    best_phase_law,
    best_velocity_feedback,
    best_without_memory,
    classical_laws,
    frequency_tracker,
    predictive_control,
    regulator,
    resetting_stiffness,
    trackers,
    uncontrolled,
)
from mm_gym import DesignError, SceneError
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from agents.controllers.controller import Controller
    from mm_gym import Scene

    Make = Callable[[Scene], Controller]

RANDOM, MATCHING = "random", "matching-stretch"
BETWEEN = "energy-shaping"
FEEDFORWARD = "feedforward-lqr-and-clipped-lqr"

NOISES = ("noise", "kanai_tajimi", "clough_penzien")
"""Excitation whose next values can be expected."""

ALWAYS: Mapping[str, Make] = {
    RANDOM: RandomActions,
    "no-control": uncontrolled,
    "best-constant": best_constant,
    "predictive-control": lambda scene: predictive_control(
        scene, best_without_memory(scene, classical_laws(scene))
    ),
}
"""Laws for any actuators. Those called best are tuned on the validation episodes."""

LAWS: Mapping[tuple[str, ...], Mapping[str, Make]] = {
    ("force",): {
        "lqr": regulator,
        "lqg": LQG,
        "velocity-feedback": best_velocity_feedback,
        BETWEEN: best_energy_shaping,
    },
    ("stretch",): {
        "phase-law": best_phase_law,
        "clipped-lqr": best_clipped_lqr,
        "on-off-stiffness": best_on_off_stiffness,
        "resetting-stiffness-passive": partial(resetting_stiffness, passive=True),
        "resetting-stiffness": partial(resetting_stiffness, passive=False),
    },
    ("force", "stretch"): {
        "lqr": best_lqr_at_constant_stretch,
        "lqr-and-clipped-lqr": best_lqr_with_clipped_lqr,
        FEEDFORWARD: best_feedforward_lqr_with_clipped_lqr,
    },
    **{
        (device,): {name.replace(", ", "-").replace(" ", "-"): make for name, make in own.items()}
        for device, own in (("damping", SEMI_ACTIVE), ("voltage", MAGNETORHEOLOGICAL))
    },
}
"""Laws for the actuators that a scene has, beside those of `FURTHER`."""

PRICED = (
    *("lqr", "lqg", "finite-horizon-lqr", "linear-mpc", "h-infinity"),
    *("lqr-and-clipped-lqr", FEEDFORWARD),
)
"""Laws that need a force with a price, commanded by value."""


REASONS: Mapping[str, str] = {
    **dict.fromkeys(
        TRACKERS, "which looks for the frequency of a harmonic, and the excitation is another one"
    ),
    MATCHING: f"which reads {FREQUENCY}, and randomization does not draw it",
    BETWEEN: "which is for a force between the masses, and this one acts against the ground",
}
"""Why laws for the actuators of a scene do not apply to it all the same."""


def laws(scene: Scene) -> dict[str, Make]:
    """Return the laws that apply to a scene, by name."""
    found = {**ALWAYS, **LAWS.get(columns(scene), {}), **FURTHER.get(columns(scene), {})}
    force = scene.actuation.force
    if force is not None and (scene.objective.effort_weight == 0.0 or force.command == "rate"):
        for name in PRICED:
            found.pop(name, None)
    if not scene.actuation.is_between:
        found.pop(BETWEEN, None)
    kinds = {part.kind for part in scene.excitation}
    if not kinds.intersection(NOISES):
        found.pop(FEEDFORWARD, None)
    if columns(scene) == ("stretch",):
        found |= {name: partial(frequency_tracker, name) for name in trackers(scene)}
        if FREQUENCY in scene.randomization:
            found[MATCHING] = MatchingStretch
    return found


def obstacle(name: str, scene: Scene) -> str | None:
    """Return why a law does not apply to a scene, or None for a name that is no law's."""
    groups = {kinds: {*LAWS[kinds], *FURTHER.get(kinds, {})} for kinds in LAWS}
    groups["stretch",] |= {*TRACKERS, MATCHING}
    suited = [" and ".join(kinds) for kinds, names in groups.items() if name in names]
    if not suited:
        return None
    if name not in groups.get(columns(scene), ()):
        return f"which is for other actuators: {' or '.join(suited)}"
    if name in REASONS:
        return REASONS[name]
    if name in PRICED:
        try:
            force_price(scene)
        except DesignError as error:
            return f"which cannot be designed: {error}"
    return f"which expects the next values of {', '.join(NOISES)}, and the excitation has none"


def not_a_law(text: str, scene: Scene, what: str, others: str) -> SceneError:
    """Return the error about a name that is no law of a scene, with the nearest that is.

    Parameters
    ----------
    what
        The setting, for messages.
    others
        What else is allowed.
    """
    applicable = laws(scene)
    reason = obstacle(text, scene)
    why = "" if reason is None else f", {reason}"
    return SceneError(
        f"{what}: got {text!r}{why}{suggest(text, applicable)}; allowed for this scene: "
        f"{', '.join(applicable)}, {others}"
    )
