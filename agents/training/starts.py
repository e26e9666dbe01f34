"""The controllers as which networks begin: exactly or nearly, as functions of the observation."""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import replace

import numpy as np

from agents.control.actuators import Command
from agents.controllers.adjustable import Adjustable
from agents.controllers.clipped_lqr import WEIGHTED, ClippedLQR, weighted_clipped_lqr
from agents.controllers.clipped_optimal import ClippedOptimal, ClippedVoltage
from agents.controllers.constant import device_of
from agents.controllers.lqg import weighed
from agents.controllers.lqr import regulator
from agents.network.layers import UNIT
from agents.policies import Policy
from agents.training.config import LawName, SearchSettings
from agents.training.lqg_start import lqg_start
from agents.training.shown import Estimate, Shown, force_memory
from agents.training.start import COARSE, FINE, FLOOR, Start, best_constant, best_of, no_control
from mm_gym import CompileError, DesignError, Scene, compile_scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness
from mm_gym.arrays import Array
from mm_gym.tasks import robust_ids

IN_WORDS: dict[str, str] = {
    "regulator": "the LQR of the force",
    "lqg": "the LQG of the force",
    "switching": "the clipped LQR of the stretch, or of the damper",
    "weighted": "the clipped LQR of the stretch with free weights",
    "tracking": "the absorber tuned to the frequency that it finds",
    "constant": "the best constant command of the stretch or the damper",
    "none": "no control",
}

CLEARLY = 1.1
"""By how much the start that suits the actuators may cost more than the cheapest one: on
CarriageForceFriction the LQR costs 5 % more than no control, and evolution ends alike from both."""

DAMPERS = ("damping",), ("voltage",)
"""Names of the actuators of a scene that a network begins to switch by itself."""

FLOORS, HARDLY = (0.05, 0.01, FLOOR), 1.01
"""Floors that are tried on your own scene, whose signals may be small next to them: the largest one
is taken, of the smoothest slopes, that costs at most so many times the least."""

SOFTER = 1.0, 0.5, 0.25, 0.125
"""Factors of the gain of correlation units that are tried where these may read a filter: where
sensors are late by an unknown time, a small action costs less than a full one at the wrong time."""


def start_of(scene: Scene, settings: SearchSettings, generator: np.random.Generator) -> Start:
    """Return the start that is asked for, with its further correlation units and its memory.

    Raise `DesignError` if the law does not apply to the scene. "auto" takes another one then.
    """
    own = settings.scene is not None
    shown = Shown(scene, filtered=own or settings.task in robust_ids())
    if settings.law == "auto":
        start = _best_start(shown, 1.0 if own else CLEARLY)
    else:
        start = _start(shown, settings.law)
    random = {part.kind for part in scene.excitation} == {"noise"}
    showing = shown.history > 1 and shown.mean_force().any()
    if not start.keep.size and settings.memory and random and showing:
        start = start.with_memory(*force_memory(shown, settings.memory))
    plant = compile_scene(scene)
    if plant.most_delay and not start.back.size:
        # The newest frames do not show yet what the last actions did, which it remembers.
        k = shown.actions
        size = k * (plant.most_delay + plant.history - 1)
        start = start.with_memory(
            np.eye(size, k=-k), np.zeros((size, shown.count)), np.eye(size, k)
        )
    return start.with_units(settings.extra, generator)


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
    return Start.linear(np.zeros((k, 1 + seen))).with_units(settings.extra, generator)


def without_control(scene: Scene) -> Policy:
    """Return the policy of no control."""
    return no_control(Shown(scene)).policy()


def natural_law(scene: Scene) -> LawName:
    """Return the law for a scene's actuators and excitation."""
    if scene.actuation.names in DAMPERS:
        return "switching"
    if scene.actuation.stretch is None:
        return "regulator"
    harmonic = {part.kind for part in scene.excitation} == {"harmonic"}
    return "tracking" if harmonic and scene.actuation.force is None else "switching"


def _best_start(shown: Shown, most: float) -> Start:
    """Return the start that suits the actuators, or the cheapest if it costs `most` times that."""
    starts: list[Start] = []
    tried: list[LawName] = [natural_law(shown.scene), "lqg", "none"]
    for law in [*tried, "constant"] if shown.filtered else tried:
        with suppress(CompileError, DesignError):  # no regulator without mass
            starts.append(_start(shown, law))
    return best_of(shown.scene, starts, most)


def _start(shown: Shown, law: LawName) -> Start:
    """Return a law, with floor and gain of its correlation units that fit where a filter may be."""
    start, scene = replace(_law(shown, law), law=law), shown.scene
    r, inputs = len(start.units), start.direct.shape[1]
    if not r or not shown.filtered:
        return start
    is_floor, is_gain = np.array(UNIT) == "floor", np.arange(inputs) >= inputs - r
    floors = [np.where(is_floor, floor, start.units) for floor in FLOORS]
    start = best_of(scene, [replace(start, units=units) for units in floors], HARDLY)
    gains = [np.where(is_gain, factor, 1.0) * start.direct for factor in SOFTER]
    return best_of(scene, [replace(start, direct=direct) for direct in gains])


def _law(shown: Shown, law: LawName) -> Start:
    actuation = shown.scene.actuation
    if law == "none":
        return no_control(shown)
    if law == "constant":
        return best_constant(shown)
    if law == "lqg":
        return lqg_start(shown)
    if actuation.device is not None:
        if law == "switching" and actuation.names in DAMPERS:
            return _clipped_optimal(shown)
        device = device_of(shown.scene)
        msg = (
            f"law: got {law!r}; allowed where actuation.{device} is: 'none', 'constant', 'lqg' "
            "with a force, and 'switching' without other actuators"
        )
        raise DesignError(msg)
    if law != "regulator" and actuation.stretch is None:
        msg = f"law: {law!r} tunes springs; actuation.stretch is missing"
        raise DesignError(msg)
    if law == "tracking":
        return _tracking(shown)
    start = no_control(shown) if actuation.stretch is None else _clipped_lqr(shown, law)
    if actuation.force is not None:
        _add_regulator(shown, start)
    elif law == "regulator":
        msg = "law: 'regulator' needs a force; actuation.force is missing"
        raise DesignError(msg)
    return start


STRETCH, WEIGHT = 0.125, 1.0
"""Where a clipped LQR is designed: fraction of the stretch's range, and weight of its force."""


def _design_stretch(scene: Scene) -> float:
    command = Command(scene, "stretch")
    return command.low + STRETCH * (command.high - command.low)


def _add_regulator(shown: Shown, start: Start) -> None:
    """Let a start command the force as the LQR does, at the stretch of `_clipped_lqr`."""
    scene = weighed(shown.scene)
    law = regulator(scene, None if scene.actuation.stretch is None else _design_stretch(scene))
    weights, state = np.zeros(4), np.zeros((4, start.direct.shape[1] - 1))
    weights[list(law.design.states)] = -law.design.gain[0] / law.limit
    state[:, : shown.count] = shown.state
    start.direct[0, 1:] = weights @ state


GAIN = 2.0  # of a switching function: the action is full as soon as it is beyond a half


def _switched_by(shown: Shown, pair: Array, seen: Estimate) -> Start:
    """Return one switching function: where two values (2, n + m) have like signs."""
    m = len(seen.keep)
    pair = pair / np.linalg.norm(pair, axis=1, keepdims=True)
    direct = np.zeros((shown.actions, 2 + shown.count + m))
    direct[-1, -1] = GAIN
    units, spreads = np.array([[0.0, FLOOR, 0.0, 1.0]]), np.array([COARSE])
    return Start(pair[None], units, direct, spreads, seen.keep, seen.enter, np.empty((m, 0)))


def _clipped_lqr(shown: Shown, name: LawName) -> Start:
    """Return a clipped LQR in the limit of a small weight, as one switching function.

    The springs soften where the wanted internal force F and the offset have unlike signs, and
    stiffen elsewhere.
    """
    scene = shown.scene
    if name == "weighted":
        if scene.actuation.force is not None:
            msg = "law: 'weighted' commands only springs; remove actuation.force"
            raise DesignError(msg)
        law = weighted_clipped_lqr(scene, WEIGHTED.numbers(scene))
    else:
        law = ClippedLQR(scene, _design_stretch(scene), WEIGHT)
    turned = law.lead.transitions[len(law.lead.transitions) // 2]
    found: list[Start] = []
    for seen in shown.estimates({"initial.stretch": law.about}):
        ahead = turned @ seen.state
        found.append(_switched_by(shown, np.stack([law.gain @ ahead, ahead[1] - ahead[0]]), seen))
    return best_of(scene, found)


WEIGHTS = 1e-3, 1e-2, 0.1, 1.0  # of the force of clipped-optimal controls that are tried


def _clipped_optimal(shown: Shown) -> Start:
    """Return clipped-optimal control on or off, as one switching function, at the best weight.

    The damping or voltage is the greatest where the wanted force and the device's velocity have
    like signs.
    """
    scene, found = shown.scene, list[Start]()
    for weight, seen in itertools.product(WEIGHTS, shown.estimates(moving=True)):
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
            found.append(_switched_by(shown, pair, seen))
    if not found:
        msg = "sensors.channels: switching needs the velocity of the damper's ends; allowed"
        msg += ": channels that show it, or displacements with sensors.history of at least 2"
        raise DesignError(msg)
    return best_of(scene, found)


MEMORY = 0.97  # of the estimate of a frequency: some 30 control steps


def _tracking(shown: Shown) -> Start:
    """Return the absorber that is tuned to the frequency of the force, found by its correlation.

    Of a harmonic force, the cosine of the phase between two steps is a correlation unit; the
    stretch that matches is nearly linear in it.
    """
    if shown.history < 3:  # noqa: PLR2004 - two forces
        msg = f"sensors.history: got {shown.history}; allowed for tracking: at least 3"
        raise DesignError(msg)
    springs, mass = shown.scene.springs, shown.scene.sphere.mass
    pair = np.stack([shown.mean_force(age) for age in (0, 1)])
    pair /= np.abs(pair).max()
    command = Command(shown.scene, "stretch")
    low, high = command.low, command.high
    ends = spring_stiffness([high, low], springs.stiffness)
    frequencies = np.linspace(*np.sqrt(ends / mass), 33)
    cosines = np.cos(frequencies * shown.scene.control.time_step)
    wanted = stretch_for_stiffness(mass * frequencies**2, springs.stiffness)
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
