"""The classical controllers of a scene, tuned on the validation episodes.

All but the informed ones read what an agent observes.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from agents.controllers.both import Both
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.clipped_optimal import ClippedOptimal, ClippedVoltage
from agents.controllers.constant import (
    ConstantForce,
    ConstantStretch,
    constant_damping,
    constant_stretch,
    no_control,
)
from agents.controllers.controller import columns
from agents.controllers.energy_shaping import EnergyShaping
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
from agents.controllers.observed_state import ObservedActuators, ObservedState
from agents.controllers.on_off_stiffness import OnOffStiffness
from agents.controllers.phase_law import PhaseLaw
from agents.controllers.predictive_control import SEARCH, PredictiveControl
from agents.controllers.resetting_stiffness import ResettingStiffness
from agents.controllers.semi_active import Balance, Hook, SemiActive
from agents.controllers.spring_force import middle
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from agents.policy_file import PolicyError
from mm_gym import CompileError, DesignError, SimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Law, StateSource
    from agents.controllers.damping_command import Switching
    from agents.controllers.semi_active import Hooked
    from mm_gym import Scene

Designed = TypeVar("Designed", bound="Controller")

TRACKERS = ("linear-prediction", "frequency-locked-loop", "short-time-fourier")
"""Ways to look for the frequency of a harmonic force."""

DECADES = np.linspace(-2.0, 2.0, 17)
"""Exponents of the gains and prices that are tried."""

PRICES = np.linspace(-4.0, 2.0, 13)
"""Exponents of the prices of clipped-optimal control that are tried."""

CENTRED = np.linspace(-0.5, 0.5, 17)
"""Forces over the force limit that are tried."""

RATIOS = np.linspace(0.3, 1.7, 15)
"""Frequencies of a sphere over that of the carriage on its spring that are tried."""

HOOKS: tuple[Hooked, ...] = ("skyhook", "groundhook", "displacement groundhook")
SWITCHINGS: tuple[Switching, ...] = ("on-off", "continuous")
"""Ways in which a semi-active damper follows a wanted force."""

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


NOT_SCORED = (CompileError, DesignError, PolicyError, SimulationError)
"""What keeps a controller from being scored on a scene, though others can be."""


class Baselines(NamedTuple):
    """The classical controllers of a scene.

    Attributes
    ----------
    controllers
        Those that can be designed.
    not_scored
        The names of the others, with the reason.
    """

    controllers: list[Controller]
    not_scored: dict[str, str]


def baselines(scene: Scene) -> Baselines:
    """Return the classical controllers of a scene, but for predictive control.

    The first is the one that ratios refer to: the best constant stretch, or no control where there
    is no stretch.
    """
    still: list[Controller] = [uncontrolled(scene)]
    if scene.actuation.stretch is not None:
        still.insert(0, best_constant_stretch(scene))
    found, not_scored = designed(scene, {**classical(scene), **filtered(scene), **informed(scene)})
    return Baselines([*still, *found], not_scored)


def designed(
    scene: Scene, makers: Mapping[str, Callable[[Scene], Designed]]
) -> tuple[list[Designed], dict[str, str]]:
    """Return the controllers that can be designed for a scene, and why the others cannot."""
    found: list[Designed] = []
    not_scored: dict[str, str] = {}
    for name, make in makers.items():
        try:
            found.append(make(scene))
        except NOT_SCORED as error:
            not_scored[name] = str(error)
    return found, not_scored


def uncontrolled(scene: Scene) -> Feedback:
    """Return no control, which needs no state."""
    return Feedback(scene, no_control(scene), ObservedActuators(scene))


def classical(scene: Scene) -> Mapping[str, Callable[[Scene], Feedback]]:
    """Return what makes the tuned laws that read the observation, by name."""
    match columns(scene):
        case ("force",):
            own = {"energy shaping": best_energy_shaping} if scene.actuation.is_between else {}
            return {"LQR": regulator, "velocity feedback": best_velocity_feedback, **own}
        case ("stretch",):
            return {
                "phase law": best_phase_law,
                "clipped LQR": best_clipped_lqr,
                "on-off stiffness": best_on_off_stiffness,
                "resetting stiffness, passive": partial(resetting_stiffness, passive=True),
                "resetting stiffness": partial(resetting_stiffness, passive=False),
                **{
                    f"frequency tracking, {name}": partial(frequency_tracker, name)
                    for name in trackers(scene)
                },
            }
        case ("force", "stretch"):
            switched = cache(lambda: best_lqr_with_clipped_lqr(scene))  # its search takes long
            return {
                "LQR + constant stretch": best_lqr_at_constant_stretch,
                "LQR + clipped LQR": lambda _: switched(),
                "LQR with feed-forward + clipped LQR": lambda scene: _with_feedforward(
                    scene, switched()
                ),
            }
        case ("damping",):
            return SEMI_ACTIVE
        case ("voltage",):
            return MAGNETORHEOLOGICAL
        case _:  # none is known for a damping or a voltage with other actuators
            return {}


def filtered(scene: Scene) -> Mapping[str, Callable[[Scene], Controller]]:
    """Return what makes the controllers with a filter of their own, by name."""
    return {"LQG": LQG} if columns(scene) == ("force",) else {}


def informed(scene: Scene) -> Mapping[str, Callable[[Scene], Controller]]:
    """Return what makes the controllers that know what an agent does not, by name."""
    known = FREQUENCY in scene.randomization and columns(scene) == ("stretch",)
    return {"matching stretch": MatchingStretch} if known else {}


def classical_laws(scene: Scene) -> list[Feedback]:
    """Return the tuned laws that read the observation, those that can be designed."""
    return designed(scene, classical(scene))[0]


def further_laws(scene: Scene) -> list[Controller]:
    """Return what is scored on the page of the tasks alone: it is slow, or takes extras.

    Those that cannot be designed for the scene are left out.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        Without Slycot or OSQP (extras: robust, mpc), if the scene has a force alone.
    """
    return designed(scene, FURTHER.get(columns(scene), {}))[0]


def best_without_memory(scene: Scene, laws: Sequence[Feedback]) -> Law:
    """Return the law of least cost among those that depend on the present state alone.

    Where there is none, it is no control.
    """
    simple = [controller for controller in laws if not _remembers(controller.law)]
    return min(simple or [uncontrolled(scene)], key=lambda controller: _cost(scene, controller)).law


def _remembers(law: Law) -> bool:
    if isinstance(law, Both):
        return any(_remembers(one) for one in law.laws)
    return law.remembers if isinstance(law, SemiActive) else isinstance(law, REMEMBER)


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


def regulator(scene: Scene) -> Feedback:
    """Return the LQR, without the stroke's weight if none can be designed with it."""
    try:
        return Feedback(scene, LQR(scene))
    except DesignError as error:
        with suppress(DesignError):
            law = LQR(scene.replace(**{"objective.stroke_weight": 0.0}))
            law.name = "LQR, blind to the stroke"
            return Feedback(scene, law)
        raise error from None


def resetting_stiffness(scene: Scene, *, passive: bool) -> Feedback:
    """Return either kind of resetting stiffness."""
    return Feedback(scene, ResettingStiffness(scene, passive=passive))


def trackers(scene: Scene) -> tuple[str, ...]:
    """Return the ways to look for the frequency, where all excitation is harmonic."""
    return TRACKERS if {part.kind for part in scene.excitation} == {"harmonic"} else ()


def frequency_tracker(name: str, scene: Scene) -> Feedback:
    """Return the law that looks for the frequency of a harmonic force in one of the ways."""
    low, high = band = reachable_band(scene)
    match name:
        case "linear-prediction":
            estimator = LinearPrediction(scene)
        case "frequency-locked-loop":
            estimator = FrequencyLockedLoop(scene, 0.5 * (low + high))
        case _:
            estimator = ShortTimeFourier(scene, band)
    return Feedback(scene, FrequencyTracking(scene, estimator))


def best_constant(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Return the best of what never moves: a stretch, else a damping, else a force.

    With the seed of the final evaluation it is the best in hindsight.
    """
    actuator = scene.actuation.force
    if scene.actuation.device is not None and scene.actuation.stretch is None:
        return best_constant_damping(scene, seed)
    if scene.actuation.stretch is not None or actuator is None:
        return best_constant_stretch(scene, seed)
    return _search(
        scene,
        lambda force: ConstantForce(scene, force),
        actuator.limit * CENTRED,
        seed,
        ObservedActuators(scene),
    )


def best_constant_damping(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Search the constant damping of least cost."""
    return _search(
        scene,
        lambda damping: constant_damping(scene, damping),
        _dampings(scene),
        seed,
        ObservedActuators(scene),
    )


def best_constant_stretch(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Search the constant stretch of least cost."""
    return _search(
        scene,
        lambda s: constant_stretch(scene, s),
        _stretches(scene),
        seed,
        ObservedActuators(scene),
    )


def best_phase_law(scene: Scene) -> Feedback:
    """Search the gain of the phase law over four decades."""
    return _search(scene, lambda exponent: PhaseLaw(scene, 10.0**exponent), DECADES)


def best_velocity_feedback(scene: Scene) -> Feedback:
    """Search the gain of the velocity feedback over four decades."""
    critical = 2.0 * np.sqrt(scene.carriage.mass * scene.carriage.stiffness)
    return _search(
        scene, lambda exponent: VelocityFeedback(scene, critical * 10.0**exponent), DECADES
    )


def best_hook(what: Hooked, switching: Switching, scene: Scene) -> Feedback:
    """Search what a skyhook or groundhook switches on, or its gain over four decades."""
    k1, m1 = middle(scene, "carriage.stiffness"), middle(scene, "carriage.mass")
    unit = k1 if what == "displacement groundhook" else 2.0 * np.sqrt(k1 * m1)
    return _search_semi_active(
        scene,
        switching,
        lambda on: Hook(scene, what, switching, on=on),
        lambda exponent: Hook(scene, what, switching, gain=unit * 10.0**exponent),
    )


def best_balance(switching: Switching, scene: Scene) -> Feedback:
    """Search what the balance switches on, or its gain over four decades."""
    return _search_semi_active(
        scene,
        switching,
        lambda on: Balance(scene, switching, on=on),
        lambda exponent: Balance(scene, switching, gain=10.0**exponent),
    )


def best_clipped_optimal(switching: Switching, scene: Scene) -> Feedback:
    """Search the price of the clipped-optimal control over six decades."""
    return _search(scene, lambda exponent: ClippedOptimal(scene, switching, 10.0**exponent), PRICES)


def best_clipped_voltage(scene: Scene) -> Feedback:
    """Search the price of the clipped-optimal control of a voltage over six decades."""
    return _search(scene, lambda exponent: ClippedVoltage(scene, 10.0**exponent), PRICES)


def _search_semi_active(
    scene: Scene,
    switching: Switching,
    switched: Callable[[float], Law],
    followed: Callable[[float], Law],
) -> Feedback:
    """Search the damping of an on-off law, or the exponent of the gain of a continuous one."""
    if switching == "continuous":
        return _search(scene, followed, DECADES)
    return _search(scene, switched, _dampings(scene)[2::2])


def best_energy_shaping(scene: Scene) -> Feedback:
    """Search the frequency of the sphere and the damping of the slip, over four decades."""
    k1, m1 = middle(scene, "carriage.stiffness"), middle(scene, "carriage.mass")
    m2 = middle(scene, "sphere.mass")

    def make(ratio: float, damping: float) -> Law:
        rate = ratio * np.sqrt(k1 / m1)
        return EnergyShaping(scene, m2 * rate**2, damping * m2 * rate)

    return _search_pair(scene, make, RATIOS)


SEMI_ACTIVE: Mapping[str, Callable[[Scene], Feedback]] = {
    f"{what}, {switching}": make
    for switching in SWITCHINGS
    for what, make in (
        *((hook, partial(best_hook, hook, switching)) for hook in HOOKS),
        ("balance", partial(best_balance, switching)),
        ("clipped-optimal", partial(best_clipped_optimal, switching)),
    )
}
"""Laws for a damping by name."""

MAGNETORHEOLOGICAL: Mapping[str, Callable[[Scene], Feedback]] = {
    "clipped-optimal, on-off": best_clipped_voltage
}
"""Laws for a voltage by name."""


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
    clipped = found.law.laws[1]
    assert isinstance(clipped, ClippedLQR)  # noqa: S101 - as it was made
    return Feedback(scene, Both(FeedforwardLQR(scene, clipped.about), clipped))


def _stretches(scene: Scene) -> NDArray[np.float64]:
    actuator = scene.actuation.stretch
    if actuator is None:
        msg = "actuation.stretch: missing; there is no stretch to hold"
        raise ValueError(msg)
    return np.linspace(actuator.minimum, actuator.maximum, 33)


def _dampings(scene: Scene) -> NDArray[np.float64]:
    actuator = scene.actuation.device
    assert actuator is not None  # noqa: S101 - the callers' scenes have one
    return np.linspace(actuator.minimum, actuator.maximum, 33)


def _search(
    scene: Scene,
    make: Callable[[float], Law],
    grid: NDArray[np.float64],
    seed: int = VALIDATION_SEED,
    source: StateSource | None = None,
) -> Feedback:
    """Return the law of least cost: the best of a grid, refined between its neighbours."""
    source = source or ObservedState(scene)

    def controller(value: float) -> Feedback:
        return Feedback(scene, make(float(value)), source)

    def cost(value: float) -> float:
        return _cost(scene, controller(value), seed)

    costs = [cost(value) for value in grid]
    best = int(np.argmin(costs))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-3})
    return controller(float(refined.x) if refined.fun < costs[best] else float(grid[best]))


def _search_pair(
    scene: Scene, make: Callable[[float, float], Law], first: NDArray[np.float64] | None = None
) -> Feedback:
    """Search a first value on a coarse grid, by default a stretch, and a second over four decades.

    Then search the second finely.
    """
    source = ObservedState(scene)
    coarse = _stretches(scene)[4::4] if first is None else first
    pairs = [(value, 10.0**e) for value in coarse for e in DECADES[::4]]
    best, _ = min(pairs, key=lambda pair: _cost(scene, Feedback(scene, make(*pair), source)))
    return _search(scene, lambda exponent: make(best, 10.0**exponent), DECADES)


def _cost(scene: Scene, controller: Controller, seed: int = VALIDATION_SEED) -> float:
    return evaluate(scene, controller, seed=seed, episodes=100).cost
