"""The classical controllers of a scene, tuned on the validation episodes.

All but the informed ones read what an agent observes.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from agents.controllers.both import Both
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.constant import (
    ConstantForce,
    ConstantStretch,
    constant_stretch,
    no_control,
)
from agents.controllers.controller import columns
from agents.controllers.extremum_seeking import ExtremumSeeking
from agents.controllers.feedback import Feedback
from agents.controllers.feedforward_lqr import FeedforwardLQR
from agents.controllers.finite_horizon_lqr import FiniteHorizonLQR
from agents.controllers.frequency_estimators import (
    FrequencyLockedLoop,
    LinearPrediction,
    ShortTimeFourier,
)
from agents.controllers.frequency_tracking import FrequencyTracking, reachable_band
from agents.controllers.h_infinity import HInfinity
from agents.controllers.linear_mpc import LinearMPC
from agents.controllers.lqg import LQG
from agents.controllers.lqr import LQR
from agents.controllers.matching_stretch import FREQUENCY, MatchingStretch
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.observed_state import ObservedState
from agents.controllers.on_off_stiffness import OnOffStiffness
from agents.controllers.phase_law import PhaseLaw
from agents.controllers.predictive_control import SEARCH, PredictiveControl
from agents.controllers.resetting_stiffness import ResettingStiffness
from agents.controllers.stable_rest import has_stable_rest
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from mm_gym import DesignError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Law
    from mm_gym import Scene

DECADES = np.linspace(-2.0, 2.0, 17)
"""Exponents of the gains and prices that are tried."""

CENTRED = np.linspace(-0.5, 0.5, 17)
"""Forces over the force limit that are tried."""

QUICK, SHORT = 0.005, 20
"""Control steps [s] up to which predictive control plans fewer steps ahead, to keep up."""

FURTHER: Mapping[tuple[str, ...], Mapping[str, Callable[[Scene], Controller]]] = {
    ("force",): {
        "finite-horizon-lqr": lambda scene: Feedback(scene, FiniteHorizonLQR(scene)),
        "linear-mpc": lambda scene: Feedback(scene, LinearMPC(scene)),
        "h-infinity": HInfinity,
    },
    ("stretch",): {"extremum-seeking": lambda scene: Feedback(scene, ExtremumSeeking(scene))},
    ("force", "stretch"): {},
}
"""By the actuators of a scene, laws that are slow or take extras, by the names of commands."""

REMEMBER = (
    *(ResettingStiffness, FrequencyTracking, FeedforwardLQR),
    *(FiniteHorizonLQR, LinearMPC, ExtremumSeeking),
)
"""Laws with a memory: others do not start a plan from the middle of an episode."""


def baselines(scene: Scene) -> list[Controller]:
    """Return the classical controllers that apply to a scene, but for predictive control.

    The first is the one that ratios refer to: the best constant stretch, or no control where there
    is no stretch.
    """
    still: list[Controller] = [Feedback(scene, no_control(scene))]
    if scene.actuation.stretch is not None:
        still.insert(0, best_constant_stretch(scene))
    laws = [*classical_laws(scene), *output_feedback(scene), *informed_laws(scene)]
    return [*still, *laws]


def classical_laws(scene: Scene) -> list[Feedback]:
    """Return the tuned laws, from the observation.

    Those that tune the springs about an unstable middle of the carriage are left out.
    """
    stable = has_stable_rest(scene)
    match columns(scene):
        case ("force",):
            return [*regulators(scene), best_velocity_feedback(scene)]
        case ("stretch",):
            return tuning_laws(scene) if stable else []
        case _:
            held = best_lqr_at_constant_stretch(scene)
            return [held, *switched_springs(scene)] if stable else [held]


def output_feedback(scene: Scene) -> list[Controller]:
    """Return the LQG of a force, which filters the observation, if one can be designed."""
    if columns(scene) != ("force",):
        return []
    try:
        return [LQG(scene)]
    except DesignError:
        return []


def further_laws(scene: Scene) -> list[Controller]:
    """Return what is scored on the page of the tasks alone: it is slow, or takes extras.

    Those that cannot be designed for the scene are left out.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        Without Slycot or OSQP (extras: robust, mpc), if the scene has a force alone.
    """
    found: list[Controller] = []
    for make in FURTHER[columns(scene)].values():
        with suppress(DesignError):
            found.append(make(scene))
    return found


def tuning_laws(scene: Scene) -> list[Feedback]:
    """Return the tuned laws of the stretch."""
    return [
        best_phase_law(scene),
        best_clipped_lqr(scene),
        best_on_off_stiffness(scene),
        *resetting_laws(scene),
        *frequency_trackers(scene),
    ]


def informed_laws(scene: Scene) -> list[Controller]:
    """Return the laws that know what an agent does not."""
    known = FREQUENCY in scene.randomization and has_stable_rest(scene)
    if known and columns(scene) == ("stretch",):
        return [MatchingStretch(scene)]
    return []


def switched_springs(scene: Scene) -> list[Feedback]:
    """Return the clipped LQR beside a regulator of the force, and one with feed-forward."""
    found = best_lqr_with_clipped_lqr(scene)
    try:
        return [found, _with_feedforward(scene, found)]
    except DesignError:  # no noise
        return [found]


def best_without_memory(scene: Scene, laws: Sequence[Feedback]) -> Law:
    """Return the law of least cost among those that depend on the present state alone.

    Where there is none, it is no control.
    """
    simple = [controller for controller in laws if not _remembers(controller.law)]
    still = Feedback(scene, no_control(scene))
    return min(simple or [still], key=lambda controller: _cost(scene, controller)).law


def _remembers(law: Law) -> bool:
    if isinstance(law, Both):
        return _remembers(law.force) or _remembers(law.stretch)
    return isinstance(law, REMEMBER)


def predictive_control(scene: Scene, law: Law) -> Feedback:
    """Return predictive control in real time.

    Plans are improved by derivatives where a force acts, if actuators and control steps allow it;
    elsewhere they are searched around a law without memory.
    """
    if scene.actuation.force is not None and scene.control.time_step > QUICK:
        with suppress(DesignError):
            return Feedback(scene, NewtonPredictiveControl(scene))
    horizon = SHORT if scene.control.time_step <= QUICK else SEARCH.horizon
    return Feedback(scene, PredictiveControl(scene, law, replace(SEARCH, horizon=horizon)))


def regulators(scene: Scene) -> list[Feedback]:
    """Return the LQR if one can be designed, without the stroke's weight if it must be."""
    with suppress(DesignError):
        return [Feedback(scene, LQR(scene))]
    with suppress(DesignError):
        regulator = LQR(scene.replace(**{"objective.stroke_weight": 0.0}))
        regulator.name = "LQR, blind to the stroke"
        return [Feedback(scene, regulator)]
    return []


def resetting_laws(scene: Scene) -> list[Feedback]:
    """Return both kinds of resetting stiffness."""
    return [Feedback(scene, ResettingStiffness(scene, passive=p)) for p in (True, False)]


def frequency_trackers(scene: Scene) -> list[Feedback]:
    """Return the laws that look for the frequency of a harmonic force."""
    if {part.kind for part in scene.excitation} != {"harmonic"}:
        return []
    low, high = band = reachable_band(scene)
    estimators = (
        LinearPrediction(scene),
        FrequencyLockedLoop(scene, 0.5 * (low + high)),
        ShortTimeFourier(scene, band),
    )
    return [Feedback(scene, FrequencyTracking(scene, estimator)) for estimator in estimators]


def best_constant(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Return the best of what never moves: a stretch, or a force where there is no stretch.

    With the seed of the final evaluation it is the best in hindsight.
    """
    actuator = scene.actuation.force
    if scene.actuation.stretch is not None or actuator is None:
        return best_constant_stretch(scene, seed)
    return _search(scene, lambda force: ConstantForce(scene, force), actuator.limit * CENTRED, seed)


def best_constant_stretch(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Search the constant stretch of least cost."""
    return _search(scene, lambda s: constant_stretch(scene, s), _stretches(scene), seed)


def best_phase_law(scene: Scene) -> Feedback:
    """Search the gain of the phase law over four decades."""
    return _search(scene, lambda exponent: PhaseLaw(scene, 10.0**exponent), DECADES)


def best_velocity_feedback(scene: Scene) -> Feedback:
    """Search the gain of the velocity feedback over four decades."""
    critical = 2.0 * np.sqrt(scene.carriage.mass * scene.carriage.stiffness)
    return _search(
        scene, lambda exponent: VelocityFeedback(scene, critical * 10.0**exponent), DECADES
    )


def best_on_off_stiffness(scene: Scene) -> Feedback:
    """Search the stretch about which on-off stiffness is designed."""
    return _search(scene, lambda stretch: OnOffStiffness(scene, stretch), _stretches(scene)[::4])


def best_clipped_lqr(scene: Scene) -> Feedback:
    """Search the stretch and the price of the clipped LQR."""
    return _search_pair(scene, lambda stretch, price: ClippedLQR(scene, stretch, price))


def best_lqr_at_constant_stretch(scene: Scene) -> Feedback:
    """Search the stretch at which a regulator of the force does best."""
    return _search(
        scene, lambda s: Both(LQR(scene, s), ConstantStretch(scene, s)), _stretches(scene)
    )


def best_lqr_with_clipped_lqr(scene: Scene) -> Feedback:
    """Search the stretch and the price of the clipped LQR beside a regulator of the force."""
    return _search_pair(
        scene,
        lambda stretch, price: Both(LQR(scene, stretch), ClippedLQR(scene, stretch, price)),
    )


def best_feedforward_lqr_with_clipped_lqr(scene: Scene) -> Feedback:
    """Search the clipped LQR as beside a regulator, then give the regulator feed-forward."""
    return _with_feedforward(scene, best_lqr_with_clipped_lqr(scene))


def _with_feedforward(scene: Scene, found: Feedback) -> Feedback:
    assert isinstance(found.law, Both)  # noqa: S101 - as it was made
    clipped = found.law.stretch
    assert isinstance(clipped, ClippedLQR)  # noqa: S101 - as it was made
    return Feedback(scene, Both(FeedforwardLQR(scene, clipped.about), clipped))


def _stretches(scene: Scene) -> NDArray[np.float64]:
    actuator = scene.actuation.stretch
    if actuator is None:
        msg = "actuation.stretch: missing; there is no stretch to hold"
        raise ValueError(msg)
    return np.linspace(actuator.minimum, actuator.maximum, 33)


def _search(
    scene: Scene,
    make: Callable[[float], Law],
    grid: NDArray[np.float64],
    seed: int = VALIDATION_SEED,
) -> Feedback:
    """Return the law of least cost: the best of a grid, refined between its neighbours."""
    source = ObservedState(scene)

    def controller(value: float) -> Feedback:
        return Feedback(scene, make(float(value)), source)

    def cost(value: float) -> float:
        return _cost(scene, controller(value), seed)

    costs = [cost(value) for value in grid]
    best = int(np.argmin(costs))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-3})
    return controller(float(refined.x) if refined.fun < costs[best] else float(grid[best]))


def _search_pair(scene: Scene, make: Callable[[float, float], Law]) -> Feedback:
    """Search a stretch on a coarse grid, with prices over four decades, then the price finely."""
    source = ObservedState(scene)
    pairs = [(s, 10.0**e) for s in _stretches(scene)[4::4] for e in DECADES[::4]]
    stretch, _ = min(pairs, key=lambda pair: _cost(scene, Feedback(scene, make(*pair), source)))
    return _search(scene, lambda exponent: make(stretch, 10.0**exponent), DECADES)


def _cost(scene: Scene, controller: Controller, seed: int = VALIDATION_SEED) -> float:
    return evaluate(scene, controller, seed=seed, episodes=100).cost
