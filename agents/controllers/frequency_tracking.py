"""Frequency tracking: an absorber tuned to the frequency that it finds in the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.actuators import Command, require_stable_rest
from agents.controllers.controller import Law
from agents.controllers.feedback import Feedback
from agents.controllers.frequency_estimators import (
    FrequencyLockedLoop,
    LinearPrediction,
    ShortTimeFourier,
)
from agents.controllers.registry import Entry
from agents.controllers.tunable import Free, Tunable
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from agents.controllers.controller import Acted, Memory, Values
    from agents.controllers.frequency_estimators import FrequencyEstimator
    from mm_gym import Scene


def reachable_band(scene: Scene) -> tuple[float, float]:
    """Return the frequencies [rad/s] with which the springs can make the sphere resonate."""
    command = Command(scene, "stretch")
    ends = spring_stiffness([command.high, command.low], scene.springs.stiffness)
    low, high = np.sqrt(ends / scene.sphere.mass)
    return float(low), float(high)


class FrequencyTracking(Law):
    """Hold the stretch at which the sphere resonates with the frequency that is estimated.

    As `MatchingStretch`, from measured signals alone. Until the estimate begins the stretch stays.

    Parameters
    ----------
    estimator
        Of the frequency.
    ratio
        Of the sphere's own frequency to the one that is estimated [-].
    """

    def __init__(self, scene: Scene, estimator: FrequencyEstimator, ratio: float = 1.0) -> None:
        require_stable_rest(scene, "frequency tracking")
        self.name = f"frequency tracking, {estimator.name}"
        self.estimator, self.command = estimator, Command(scene, "stretch")
        self.mass, self.stiffness = scene.sphere.mass * ratio**2, scene.springs.stiffness
        self.begin = estimator.begin

    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the action towards the matching stretch."""
        frequency, memory = self.estimator.frequency(memory, state, applied)
        present = self.command.present(applied)
        matching = stretch_for_stiffness(self.mass * frequency**2, self.stiffness)
        return self.command(np.where(np.isnan(frequency), present, matching), present), memory


def _tracker(name: str, order: int, estimator: Callable[[Scene], FrequencyEstimator]) -> Entry:
    return Entry(
        name,
        ("stretch",),
        lambda scene: Feedback(scene, FrequencyTracking(scene, estimator(scene))),
        order,
        label=f"frequency tracking, {name}",
        refuses=_not_harmonic,
    )


def _not_harmonic(scene: Scene) -> str | None:
    if {part.kind for part in scene.excitation} == {"harmonic"}:
        return None
    return "which looks for the frequency of a harmonic, and the excitation is another one"


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return start [rad/s], damping and gain [1/s] of a frequency-locked loop, and the ratio."""
    low, high = reachable_band(scene)
    return {
        "start": Free(0.5 * (low + high), 0.2 * (high - low), ratio=False, low=low, high=high),
        "damping": Free(1.0, 0.3),
        "gain": Free(15.0, 0.5),
        "ratio": Free(1.0, 0.03),
    }


def _tuned_loop(scene: Scene, numbers: Mapping[str, float]) -> Feedback:
    loop = FrequencyLockedLoop(scene, numbers["start"], numbers["damping"], numbers["gain"])
    law = FrequencyTracking(scene, loop, numbers["ratio"])
    law.name += ", tuned"
    return Feedback(scene, law)


TUNED_LOOP = Tunable("tuned-frequency-locked-loop", free_numbers, _tuned_loop)

ENTRIES = (
    Entry(
        TUNED_LOOP.name,
        ("stretch",),
        TUNED_LOOP.best,
        27,
        label="frequency tracking, tuned loop",
        refuses=_not_harmonic,
        tunable=TUNED_LOOP,
    ),
    _tracker("linear-prediction", 25, LinearPrediction),
    _tracker(
        "frequency-locked-loop",
        26,
        lambda scene: FrequencyLockedLoop(scene, 0.5 * sum(reachable_band(scene))),
    ),
    _tracker(
        "short-time-fourier", 27, lambda scene: ShortTimeFourier(scene, reachable_band(scene))
    ),
)
