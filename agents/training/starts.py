"""The controllers as which networks begin: exactly or nearly, as functions of the observation."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import block_diag, solve_discrete_lyapunov

from agents.control.actuators import Command
from agents.control.observed_state import ROWS, Frame
from agents.control.scene import ENDLESS, beginning, plant_of
from agents.controllers.adjustable import Adjustable
from agents.controllers.clipped_lqr import WEIGHTED, ClippedLQR, weighted_clipped_lqr
from agents.controllers.clipped_optimal import ClippedOptimal, ClippedVoltage
from agents.controllers.constant import device_of
from agents.controllers.learned import Learned
from agents.controllers.lqg import DISTURBANCES, design_filter, design_lqg, state_units
from agents.controllers.lqr import regulator
from agents.network.layers import UNIT
from agents.policies import Policy, network
from agents.scoring import validation_cost
from agents.training.config import FUTURE, LawName, SearchSettings
from mm_gym import (
    ActionError,
    CompileError,
    DesignError,
    LinearSystem,
    MovingMassVectorEnv,
    Scene,
    compile_scene,
)
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness
from mm_gym.arrays import Array
from mm_gym.tasks import robust_ids

FLOOR = 1e-3  # of a correlation unit's denominator, see `agents.network.layers.Correlation`

FLOORS, HARDLY = (0.05, 0.01, FLOOR), 1.01
"""Floors that are tried on your own scene, whose signals may be small next to them: the largest one
is taken, of the smoothest slopes, that costs at most so many times the least."""

STRETCH, WEIGHT = 0.125, 1.0
"""Where a clipped LQR is designed: fraction of the stretch's range, and weight of its force."""

WEIGHTS = 1e-3, 1e-2, 0.1, 1.0  # of the force of clipped-optimal controls that are tried

DAMPERS = ("damping",), ("voltage",)
"""Names of the actuators of a scene that a network begins to switch by itself."""

GAIN = 2.0  # of a switching function: the action is full as soon as it is beyond a half
MEMORY = 0.97  # of the estimate of a frequency: some 30 control steps

CLEARLY = 1.1
"""By how much the start that suits the actuators may cost more than the cheapest one: on
CarriageForceFriction the LQR costs 5 % more than no control, and evolution ends alike from both."""

CAUTION = 0.1, 1.0, 10.0, 100.0
"""Factors of the force's weight in these designs: with more the force is clipped less often, which
the regulator does not foresee."""

LEAST = 1e-3
"""Least weight of the force in these designs, over the mean penalty without control: where a scene
states none or hardly any, the force is at its limits throughout, and noise and delay decide."""

FINELY = 10.0 ** np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
"""Factors of the best of these, that are tried then."""

SETTLED = 0.05, 0.25
"""Parts of an episode in which a filter's early gains fade to 1/e, that are tried."""

WEIGHTS_OF_MEMORY = "keep", "enter", "back"

MOST_STATES = 64
"""Of the memory of a filter. Each late frame adds some; where there are more, the memory is reduced
to what it tells: of many late channels hardly more than the last actions."""

TOLD = 1e-6
"""Part of what a state of a memory tells, over the state that tells most, below which it is left
out where the memory is reduced."""

SOFTER = 1.0, 0.5, 0.25, 0.125
"""Factors of the gain of correlation units that are tried where these may read a filter: where
sensors are late by an unknown time, a small action costs less than a full one at the wrong time."""

HELD = np.linspace(-1.0, 1.0, 17)  # constant actions of a stretch or a device that are tried

COARSE, FINE = 0.3, 0.01
"""Size of the changes of a switching function's weights, and of those of a frequency's estimate:
they are of order one, and a hundredth changes the frequency by as much as the springs can."""

LANES, STEPS, SEED = 64, 300, 3_000_000
"""Episodes and steps that are simulated for a memory, apart from those of any evaluation."""

PAST = 32  # control steps that foretell a force
LONGEST = 0.98  # largest eigenvalue of a memory: what is older than some 50 steps is forgotten

IN_WORDS: dict[str, str] = {
    "regulator": "the LQR of the force",
    "lqg": "the LQG of the force",
    "switching": "the clipped LQR of the stretch, or of the damper",
    "weighted": "the clipped LQR of the stretch with free weights",
    "tracking": "the absorber tuned to the frequency that it finds",
    "constant": "the best constant command of the stretch or the damper",
    "none": "no control",
}


@dataclass(frozen=True, eq=False)
class Start:
    """What a network is before hidden units take part."""

    # pairs, units: (r, 2, n + m), (r, 4), those of `agents.network.layers.Correlation`
    pairs: Array
    units: Array
    direct: Array  # (k, 1 + n + m + r): bias and direct weights of each action
    spreads: Array  # (r,) size of the changes of each pair's weights
    # keep, enter, back: (m, m), (m, n), and (m, k) or (m, 0), the linear memory, which is not
    # searched; where it knows the action, that of `agents.network.layers.Observer`
    keep: Array = field(default_factory=lambda: np.empty((0, 0)))
    enter: Array = field(default_factory=lambda: np.empty((0, 0)))
    back: Array = field(default_factory=lambda: np.empty((0, 0)))
    # early, fade: (m, m + n + k), (1,), or empty: those of `agents.network.layers.SettlingObserver`
    early: Array = field(default_factory=lambda: np.empty((0, 0)))
    fade: Array = field(default_factory=lambda: np.empty(0))
    law: LawName = "none"  # the name of what it is
    # Of an LQG that may settle, what it was designed with: the factor of the force's weight, and
    # `unmodelled`.
    design: tuple[float, float] | None = None

    def remembering(self, keep: Array, enter: Array, back: Array | None = None) -> Start:
        """Return it with a linear memory that has no part in the action."""
        _, _, shown = self.pairs.shape
        return replace(
            self,
            pairs=np.pad(self.pairs, ((0, 0), (0, 0), (0, len(keep)))),
            direct=np.insert(self.direct, [1 + shown] * len(keep), 0.0, axis=1),
            keep=keep,
            enter=enter,
            back=np.empty((len(keep), 0)) if back is None else back,
        )

    def recalling(self, steps: int) -> Start:
        """Return it with the last actions, of so many steps, that have no part in the next yet."""
        m, k = len(self.keep), len(self.direct)
        size, n = k * steps, self.pairs.shape[2] - m
        before = self.enter if m else np.empty((0, n))
        back = self.back if self.back.size else np.zeros((m, k))
        made = self.remembering(np.empty((size, 0)), np.empty((size, 0)))
        return replace(
            made,
            keep=block_diag(self.keep, np.eye(size, k=-k)) if m else np.eye(size, k=-k),
            enter=np.vstack([before, np.zeros((size, n))]),
            back=np.vstack([back, np.eye(size, k)]),
        )

    def policy(self, hidden: Array | None = None) -> Policy:
        """Return the policy of it and of hidden units; see `agents.training.network.Network`.

        Parameters
        ----------
        hidden
            (units, 1 + n + m + r + k); by default one that has no part in the action.
        """
        k, inputs = self.direct.shape
        units = np.zeros((1, inputs + k)) if hidden is None else hidden
        bias, weights, output = np.split(units, [1, inputs], axis=1)
        last, direct = np.split(self.direct, [1], axis=1)
        return network(
            (weights, output.T),
            (bias[:, 0], last[:, 0]),
            "rational",
            -np.ones(k),
            np.ones(k),
            direct=direct,
            keep=self.keep,
            enter=self.enter,
            back=self.back if self.back.size else (),
            early=self.early,
            fade=self.fade,
            pairs=self.pairs,
            units=self.units,
        )


def start_of(scene: Scene, settings: SearchSettings, generator: np.random.Generator) -> Start:
    """Return the start that is asked for, with its further correlation units and its memory.

    Raise `DesignError` if the law does not apply to the scene. "auto" takes another one then.
    """
    own = settings.scene is not None
    filtered = own or settings.task in robust_ids()
    shown = Shown(scene, filtered=filtered)
    if settings.law == "auto":
        start = _best_start(scene, shown, 1.0 if own else CLEARLY)
    else:
        start = _law(scene, settings.law, shown)
    random = {part.kind for part in scene.excitation} == {"noise"}
    if not start.keep.size and settings.memory and random and shown.history > 1:
        weights = _mean_force(scene, shown, 0)
        start = start.remembering(*force_memory(scene, weights, settings.memory))
    plant = compile_scene(scene)
    if plant.most_delay and not start.back.size:
        # The newest frames do not show yet what these actions did.
        start = start.recalling(plant.most_delay + plant.history - 1)
    return _with_units(start, settings.extra, generator)


def added_to(
    scene: Scene,
    settings: SearchSettings,
    generator: np.random.Generator,
    scheduled: Adjustable | None = None,
) -> Start:
    """Return what changes nothing of a base.

    It observes what the environment shows and the base's action; what sets the numbers of a law
    observes the law's situation.
    """
    k = len(scene.actuation.names)
    seen = Shown(scene).count + k
    if scheduled is not None:
        k, seen = len(scheduled.free), scheduled.inputs
    nothing = np.empty((0, 2, seen)), np.empty((0, 4)), np.zeros((k, 1 + seen))
    return _with_units(Start(*nothing, np.empty(0)), settings.extra, generator)


def _with_units(start: Start, extra: int, generator: np.random.Generator) -> Start:
    """Return it with correlation units that are drawn."""
    drawn = 0.5 * generator.standard_normal((extra, *start.pairs.shape[1:]))
    return replace(
        start,
        pairs=np.concatenate([start.pairs, drawn]),
        units=np.concatenate([start.units, np.tile((0.0, FLOOR, 0.0, 1.0), (extra, 1))]),
        spreads=np.concatenate([start.spreads, np.full(extra, COARSE)]),
        direct=np.pad(start.direct, ((0, 0), (0, extra))),
    )


def _with_floor_that_fits(scene: Scene, start: Start) -> Start:
    starts = [replace(start, units=start.units.copy()) for _ in FLOORS]
    for one, floor in zip(starts, FLOORS, strict=True):
        one.units[:, UNIT.index("floor")] = floor
    return _best(scene, starts, HARDLY)


def _softened(scene: Scene, start: Start) -> Start:
    """Return the start with the gain of its correlation units that costs least."""
    units = start.direct.shape[1] - len(start.units)
    starts = [replace(start, direct=start.direct.copy()) for _ in SOFTER]
    for one, factor in zip(starts, SOFTER, strict=True):
        one.direct[:, units:] *= factor
    return _best(scene, starts)


def _best_start(scene: Scene, shown: Shown, most: float) -> Start:
    """Return the start that suits the actuators, or the cheapest if it costs `most` times that."""
    starts: list[Start] = []
    tried: list[LawName] = [natural_law(scene), "lqg", "none"]
    for law in [*tried, "constant"] if shown.filtered else tried:
        with suppress(CompileError, DesignError):  # no regulator without mass
            starts.append(_law(scene, law, shown))
    return _best(scene, starts, most)


def natural_law(scene: Scene) -> LawName:
    """Return the law for a scene's actuators and excitation."""
    if scene.actuation.names in DAMPERS:
        return "switching"
    if scene.actuation.stretch is None:
        return "regulator"
    harmonic = {part.kind for part in scene.excitation} == {"harmonic"}
    return "tracking" if harmonic and scene.actuation.force is None else "switching"


class Estimate(NamedTuple):
    """What tells the state x1, x2, v1, v2 [m, m/s], of an observation and a linear memory."""

    state: Array  # (4, n + m): the state is nearest to `state` @ (observation, memory)
    # keep, enter: (m, m), (m, n), the memory
    keep: Array
    enter: Array


class Shown:
    """What an observation (n,) shows.

    Parameters
    ----------
    scene
        What is observed.
    filtered
        Whether switching functions may read a Kalman filter's estimate.

    Attributes
    ----------
    count, frame
        Numbers of an observation, and of a frame of it; the newest frame is the last.
    state
        (4, n): the state x1, x2, v1, v2 [m, m/s] is nearest to `state` @ observation.
    actions
        Number of actuators.
    """

    def __init__(self, scene: Scene, *, filtered: bool = False) -> None:
        frame, self.history, self.filtered = Frame(scene), plant_of(scene).history, filtered
        self.channels, self.units, self.zeros = frame.names, frame.unit, frame.zero
        self.frame, self.count = len(self.channels), len(self.channels) * self.history
        self.actions = len(scene.actuation.names)
        self.state = self.frame_state(0)

    def frame_state(self, age: int) -> Array:
        """Return `state` of the frame so many steps ago."""
        rows = np.zeros((self.frame, 4))
        for row, name in zip(rows, self.channels, strict=True):
            row[:] = ROWS.get(name, 0.0)
        inverse = np.linalg.pinv(rows) * self.units
        state = np.zeros((4, self.count))
        first = self.count - (age + 1) * self.frame
        state[:, first : first + self.frame] = inverse
        return state

    @property
    def now(self) -> Estimate:
        """What the newest frame alone shows."""
        return Estimate(self.state, np.empty((0, 0)), np.empty((0, 0)))

    def moving(self, time_step: float) -> Array:
        """Return `state`; velocities that no channel shows are differences of two frames'."""
        state = self.state.copy()
        if self.history > 1:
            passed = (state[:2] - self.frame_state(1)[:2]) / time_step
            hidden = ~state[2:].any(axis=1)
            state[2:][hidden] = passed[hidden]
        return state

    def estimates(self, scene: Scene, at: dict[str, float] | None) -> list[Estimate]:
        """Return Kalman filters of the scene, of which the best is to be found."""
        plant, found = plant_of(scene), list[Estimate]()
        for unmodelled in DISTURBANCES if self.filtered else ():
            with suppress(CompileError, DesignError):
                system, gains = design_filter(scene, at, unmodelled)
                units = state_units(scene, plant, system)
                _, keep, enter = self.memory_of(system, gains, units)
                told = np.eye(4, len(keep)) * units[:4, None]
                keep, enter, told = _reduced(keep, enter, told)
                state = np.hstack([np.zeros((4, self.count)), told])
                found.append(Estimate(state, keep, enter))
        return found

    def memory_of(
        self, system: LinearSystem, gains: Array, units: Array
    ) -> tuple[Array, Array, Array]:
        """Return 1 - F C of a filter's gains F, and `keep` and `enter` of the memory that it is.

        The memory is the estimate x = (1 - F C) A x + F y, each state over its unit, of the newest
        frame y.
        """
        corrected = np.eye(len(system.A)) - gains @ system.C
        keep = corrected @ system.A * units / units[:, None]
        shown = [self.channels.index(signal.name) for signal in system.outputs]
        enter = np.zeros((len(keep), self.count))
        newest = self.count - self.frame
        enter[:, [newest + k for k in shown]] = gains * self.units[shown] / units[:, None]
        return corrected, keep, enter

    def stretch(self) -> Array | None:
        """Return (1 + n,) bias and weights of the stretch, or None if it is not shown."""
        if "stretch" not in self.channels:
            return None
        row, column = np.zeros(1 + self.count), self.channels.index("stretch")
        row[0], row[1 + self.count - self.frame + column] = self.zeros[column], self.units[column]
        return row


def without_control(scene: Scene) -> Policy:
    """Return the policy of no force, and of stretch and damping that an episode begins with.

    Of a range of them it keeps the middle.
    """
    return _none(scene, Shown(scene)).policy()


def _none(scene: Scene, shown: Shown) -> Start:
    direct = np.zeros((shown.actions, 1 + shown.count))
    for row, name in zip(direct, scene.actuation.names, strict=True):
        held = np.full(1, beginning(scene, name))
        row[:1] = Command(scene, name)(held, held)[0]
    return Start(np.empty((0, 2, shown.count)), np.empty((0, 4)), direct, np.empty(0))


def _constant(scene: Scene, shown: Shown) -> Start:
    """Return the best of the constant commands of what is not a force."""
    if scene.actuation.names == ("force",):
        msg = "law: 'constant' needs a stretch or a damping; the scene has only a force"
        raise DesignError(msg)
    starts = [_none(scene, shown) for _ in HELD]
    for start, action in zip(starts, HELD, strict=True):
        start.direct[-1, 0] = action
    return _best(scene, starts)


def _law(scene: Scene, law: LawName, shown: Shown) -> Start:
    start = replace(_start(scene, law, shown), law=law)
    if shown.filtered and len(start.units):
        return _softened(scene, _with_floor_that_fits(scene, start))
    return start


def _start(scene: Scene, law: LawName, shown: Shown) -> Start:
    actuation = scene.actuation
    if law == "none":
        return _none(scene, shown)
    if law == "constant":
        return _constant(scene, shown)
    if actuation.device is not None:
        if law == "switching" and actuation.names in DAMPERS:
            return _clipped_optimal(scene, shown)
        device = device_of(scene)
        msg = (
            f"law: got {law!r}; allowed where actuation.{device} is: 'none', and where "
            f"actuation.{device} is alone 'switching'"
        )
        raise DesignError(msg)
    if law == "lqg":
        return _lqg(scene, shown)
    if law != "regulator" and actuation.stretch is None:
        msg = f"law: {law!r} tunes springs; actuation.stretch is missing"
        raise DesignError(msg)
    if law == "tracking":
        return _tracking(scene, shown)
    switches = actuation.stretch is not None
    start = _switching(scene, shown, law) if switches else _none(scene, shown)
    if actuation.force is not None:
        state = np.zeros((4, start.direct.shape[1] - 1))
        state[:, : shown.count] = shown.state
        start.direct[0, 1:] = _regulator(scene) @ state
    elif law == "regulator":
        msg = "law: 'regulator' needs a force; actuation.force is missing"
        raise DesignError(msg)
    return start


def _lqg(scene: Scene, shown: Shown) -> Start:
    """Return the LQG of the least validation cost, each with its stationary filter.

    The weight of the force is then searched more finely.
    """
    found: dict[tuple[float, float], tuple[float, Start]] = {}
    reasons: list[DesignError] = []
    held, weighed = _held(scene, shown), _weighed(scene)

    def try_all(designs: Iterable[tuple[float, float]]) -> tuple[float, float]:
        for design in designs:
            try:
                start = _one_lqg(weighed, shown, *design, held)
            except DesignError as error:
                reasons.append(error)
            else:
                found[design] = _cost(scene, start), start
        if not found:
            raise reasons[0]
        return min(found, key=lambda design: found[design][0])

    caution, unmodelled = try_all(itertools.product(CAUTION, DISTURBANCES))
    best = try_all((caution * factor, unmodelled) for factor in FINELY)
    return found[best][1]


def settling(scene: Scene, start: Start) -> Start:
    """Return the start with a filter that settles, where it is an LQG and costs less so.

    The stationary gain of a quick filter is that of an episode's start, and that of a slow one
    follows. Where little disturbs a motion, it takes longer than many an episode until the slow one
    alone has forgotten that it did not know the state.
    """
    if start.design is None:
        return start
    shown, (caution, stationary) = Shown(scene, filtered=True), start.design
    held, weighed, found = _held(scene, shown), _weighed(scene), [start]
    designs: dict[float, Start] = {}
    for unmodelled in {*DISTURBANCES, stationary}:
        with suppress(DesignError):
            designs[unmodelled] = _one_lqg(weighed, shown, caution, unmodelled, held)
    for (quick, first), (slow, last) in itertools.product(designs.items(), repeat=2):
        if not slow < quick or not slow <= stationary <= quick:
            continue
        for part in SETTLED:
            early = np.hstack([getattr(first, w) - getattr(last, w) for w in WEIGHTS_OF_MEMORY])
            fade = np.array([np.exp(-1.0 / (part * scene.control.steps))])
            own = {"early": early, "fade": fade, "law": start.law, "design": start.design}
            found.append(replace(last, **own))
    return _best(scene, found)


def _weighed(scene: Scene) -> Scene:
    """Return the scene with a weight of the force that a regulator can be designed with."""
    stated = Scene.of(scene.model_dump(mode="json"))  # without a reward of one's own
    least = LEAST * validation_cost(stated, Learned(without_control(stated))) ** 2
    if scene.objective.effort_weight >= least:
        return scene
    return scene.replace(**{"objective.effort_weight": least})


def _held(scene: Scene, shown: Shown) -> Start:
    """Return what the actuators but the force do next to an LQG: the best constant stretch."""
    stretch = scene.actuation.stretch
    if stretch is None or scene.actuation.force is None:
        return _none(scene, shown)
    if not shown.filtered or stretch.command == "rate":
        msg = "law: 'lqg' commands only a force; remove actuation.stretch"
        raise DesignError(msg)
    return _constant(scene, shown)


def _cost(scene: Scene, start: Start) -> float:
    try:
        cost = validation_cost(scene, Learned(start.policy()))
    except ActionError:  # of an observer that is not stable
        return np.inf
    return cost if np.isfinite(cost) else np.inf


def _one_lqg(scene: Scene, shown: Shown, caution: float, unmodelled: float, held: Start) -> Start:
    """Return an LQG at the stretch that is held, whose estimate is the linear memory.

    The estimate x is corrected by the observation y, and the regulator's own force is known:
    x = (1 - F C) (A x + B u) + F y, with the force u that was clipped.
    """
    force, stretch = scene.actuation.force, None
    if force is None:
        msg = "law: 'lqg' commands only a force; actuation.force is missing"
        raise DesignError(msg)
    if scene.actuation.stretch is not None:
        command = Command(scene, "stretch")
        stretch = command.low + 0.5 * (1.0 + held.direct[-1, 0]) * (command.high - command.low)
    weight = caution * scene.objective.effort_weight
    cautious = scene.replace(**{"objective.effort_weight": weight})
    design = design_lqg(cautious, stretch=stretch, unmodelled=unmodelled)
    system, limit = design.system, force.limit
    units = state_units(scene, plant_of(scene), system)
    corrected, keep, enter = shown.memory_of(system, design.filters[-1], units)
    back = np.zeros((len(keep), shown.actions))
    back[:, 0] = corrected @ system.B[:, 0] * limit / units
    entered, told = np.hstack([enter, back]), -design.gain[None] * units / limit
    kept, entered, told = _reduced(keep, entered, told)
    start = held.remembering(kept, *np.split(entered, [shown.count], axis=1))
    start.direct[0, 1 + shown.count :] = told
    # The states that are left of two filters are not the same.
    return replace(start, design=(caution, unmodelled) if kept is keep else None)


def _reduced(keep: Array, enter: Array, told: Array) -> tuple[Array, Array, Array]:
    """Return a memory and what is told of it (p, m), with fewer states where they are too many.

    Moore, *Principal component analysis in linear systems*, IEEE Trans. Autom. Control 26 (1981):
    those states are left out that inputs hardly excite, or that are hardly told. Inputs that do not
    follow from another excite each of the others by one.
    """
    if len(keep) <= MOST_STATES:
        return keep, enter, told
    matters = told.any(axis=0)
    for _ in keep:
        matters = matters | keep[matters].any(axis=0)
    keep, enter, told = keep[np.ix_(matters, matters)], enter[matters], told[:, matters]
    excited = solve_discrete_lyapunov(keep, enter @ enter.T)
    seen = solve_discrete_lyapunov(keep.T, told.T @ told)
    sizes, turned = np.linalg.eigh(excited)
    root = turned * np.sqrt(np.maximum(sizes, 0.0))
    parts, principal = np.linalg.eigh(root.T @ seen @ root)  # squares, the least first
    first = max(len(keep) - MOST_STATES, np.searchsorted(parts, TOLD**2 * parts[-1]))
    back = root @ principal[:, first:]
    to = (seen @ back / parts[first:]).T
    return to @ keep @ back, to @ enter, told @ back


def _regulator(scene: Scene) -> Array:
    """Return the LQR's action as (4,) weights of the state, at the stretch of `_switching`."""
    scene = _weighed(scene)
    stretch = None if scene.actuation.stretch is None else _design_stretch(scene)
    law = regulator(scene, stretch)
    weights = np.zeros(4)
    weights[list(law.design.states)] = -law.design.gain[0] / law.limit
    return weights


def _design_stretch(scene: Scene) -> float:
    command = Command(scene, "stretch")
    return command.low + STRETCH * (command.high - command.low)


def _switching(scene: Scene, shown: Shown, name: LawName) -> Start:
    """Return a clipped LQR in the limit of a small weight, as one switching function.

    The springs soften where the wanted internal force F and the offset have unlike signs, and
    stiffen elsewhere.
    """
    if name == "weighted":
        if scene.actuation.force is not None:
            msg = "law: 'weighted' commands only springs; remove actuation.force"
            raise DesignError(msg)
        law = weighted_clipped_lqr(scene, WEIGHTED.numbers(scene))
    else:
        law = ClippedLQR(scene, _design_stretch(scene), WEIGHT)
    stretch = law.about
    turned = law.lead.transitions[len(law.lead.transitions) // 2]
    found: list[Start] = []
    for seen in (shown.now, *shown.estimates(scene, {"initial.stretch": stretch})):
        ahead = turned @ seen.state
        found.append(_switched_by(np.stack([law.gain @ ahead, ahead[1] - ahead[0]]), shown, seen))
    return _best(scene, found)


def _best(scene: Scene, starts: list[Start], most: float = 1.0) -> Start:
    """Return the first of the starts that costs at most so many times the least."""
    if len(starts) == 1:
        return starts[0]
    costs = [_cost(scene, start) for start in starts]
    return next(one for one, cost in zip(starts, costs, strict=True) if cost <= most * min(costs))


def _switched_by(pair: Array, shown: Shown, seen: Estimate) -> Start:
    """Return one switching function: where two values (2, n + m) have like signs."""
    pair = pair / np.linalg.norm(pair, axis=1, keepdims=True)
    direct = np.zeros((shown.actions, 2 + shown.count + len(seen.keep)))
    direct[-1, -1] = GAIN
    units, spreads = np.array([[0.0, FLOOR, 0.0, 1.0]]), np.array([COARSE])
    back = np.empty((len(seen.keep), 0))
    return Start(pair[None], units, direct, spreads, seen.keep, seen.enter, back)


def _clipped_optimal(scene: Scene, shown: Shown) -> Start:
    """Return clipped-optimal control on or off, as one switching function, at the best weight.

    The damping or voltage is the greatest where the wanted force and the device's velocity have
    like signs.
    """
    now = shown.now._replace(state=shown.moving(scene.control.time_step))
    found: list[Start] = []
    for weight, seen in itertools.product(WEIGHTS, (now, *shown.estimates(scene, None))):
        if scene.actuation.voltage is None:  # a moment ahead
            law = ClippedOptimal(scene, "on-off", weight)
            ahead = law.lead.transitions[len(law.lead.transitions) // 2] @ seen.state
            pair = np.stack([law.force({}, ahead.T), law.device.velocity(ahead.T)])
        else:
            # The damper's force is taken to have the sign of the slip velocity, and to be the
            # smaller one: no linear function of an observation says when it is not.
            force = ClippedVoltage(scene, weight).force(seen.state.T)
            pair = np.stack([force, seen.state[3] - seen.state[2]])
        if pair.any(axis=1).all():
            found.append(_switched_by(pair, shown, seen))
    if not found:
        msg = "sensors.channels: switching needs the velocity of the damper's ends; allowed"
        msg += ": channels that show it, or displacements with sensors.history of at least 2"
        raise DesignError(msg)
    return _best(scene, found)


def _tracking(scene: Scene, shown: Shown) -> Start:
    """Return the absorber that is tuned to the frequency of the force, found by its correlation.

    The mean force of each control step follows from two frames: it changes the momentum, and
    balances damper and carriage spring, whatever the sphere's springs do. Of a harmonic force, the
    cosine of the phase between two steps is a correlation unit; the stretch that matches is nearly
    linear in it.
    """
    if shown.history < 3:  # noqa: PLR2004 - two forces
        msg = f"sensors.history: got {shown.history}; allowed for tracking: at least 3"
        raise DesignError(msg)
    step, command = scene.control.time_step, Command(scene, "stretch")
    pair = np.stack([_mean_force(scene, shown, age) for age in (0, 1)])
    pair /= np.abs(pair).max()
    low, high = command.low, command.high
    ends = spring_stiffness([high, low], scene.springs.stiffness)
    frequencies = np.linspace(*np.sqrt(ends / scene.sphere.mass), 33)
    cosines = np.cos(frequencies * step)
    wanted = stretch_for_stiffness(scene.sphere.mass * frequencies**2, scene.springs.stiffness)
    middle, scale = cosines.mean(), 1.0 / cosines.std()
    slope, level = np.polyfit((cosines - middle) * scale, wanted, 1)
    direct = np.zeros((1, 2 + shown.count))
    if not command.is_rate:
        half = 0.5 * (high - low)
        direct[0, [0, -1]] = (level - 0.5 * (high + low)) / half, slope / half
    else:
        present = shown.stretch()
        if present is None:
            msg = "sensors.channels: tracking needs the stretch, whose rate is commanded"
            raise DesignError(msg)
        direct[0, :-1] = -present
        direct[0, 0] += level
        direct[0, -1] = slope
        direct /= command.travel
    units = np.array([[MEMORY, FLOOR, middle, scale]])
    return Start(pair[None], units, direct, np.array([FINE]))


def _mean_force(scene: Scene, shown: Shown, age: int) -> Array:
    """Return (n,) weights of the mean force on the carriage [N] in a control step.

    The integral of the spring's force is that of Hermite's cubic, of error (step w)^4 / 720.
    """
    x1, _, v1, v2 = shown.frame_state(age)
    past = shown.frame_state(age + 1)
    step, carriage = scene.control.time_step, scene.carriage
    momentum = carriage.mass * (v1 - past[2]) + scene.sphere.mass * (v2 - past[3])
    displacement = 0.5 * (x1 + past[0]) - step / 12.0 * (v1 - past[2])
    stiffness = carriage.stiffness * carriage.linear_coefficient
    return (momentum + carriage.damping * (x1 - past[0])) / step + stiffness * displacement


def force_memory(scene: Scene, weights: Array, states: int) -> tuple[Array, Array]:
    """Return `keep` (m, m) and `enter` (m, n) of a `LinearMemory` that foretells a random force.

    The force of each step follows from two frames of the observation. Its best linear prediction
    from the past has few states: those combinations of the past that tell most of the future
    (Akaike, *Markovian representation of stochastic processes by canonical variables*, SIAM J.
    Control 13, 1975). They are fitted to simulated episodes, in a tenth of a second, and have unit
    variance.

    Parameters
    ----------
    scene
        The scene, of random excitation.
    weights
        (n,) the force of the last step is `weights` @ observation.
    states
        m, at most `FUTURE`.
    """
    force = _forces(scene, weights)
    past = sliding_window_view(force[: len(force) - FUTURE], PAST, axis=0)
    future = sliding_window_view(force[PAST:], FUTURE, axis=0)
    predictor = np.linalg.lstsq(_flat(past), _flat(future), rcond=None)[0]
    predicted = past @ predictor
    variances, directions = np.linalg.eigh(np.cov(_flat(predicted), rowvar=False))
    best = slice(None, -states - 1, -1)
    memory = predicted @ (directions[:, best] / np.sqrt(variances[best]))
    before = np.concatenate([memory[:-1], past[1:, :, -1:]], axis=2)
    found = np.linalg.lstsq(_flat(before), _flat(memory[1:]), rcond=None)[0].T
    keep, enter = found[:, :states], found[:, states]
    keep *= min(1.0, LONGEST / np.abs(np.linalg.eigvals(keep)).max())
    return keep, np.outer(enter, weights)


def _forces(scene: Scene, weights: Array) -> Array:
    """Return forces (steps, lanes) under random actions, without those of the first frames."""
    scene = scene.replace(**ENDLESS, **{"control.steps": STEPS})
    env = MovingMassVectorEnv(scene, LANES, info="none")
    observation, _ = env.reset(seed=SEED)
    generator, forces = np.random.default_rng(SEED), []
    for _ in range(STEPS - 1):
        observation, *_ = env.step(generator.uniform(-1.0, 1.0, env.action_space.shape))
        forces.append(observation @ weights)
    return np.array(forces[2:])


def _flat(array: Array) -> Array:
    return array.reshape(-1, array.shape[-1])
