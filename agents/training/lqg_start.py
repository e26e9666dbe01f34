"""The LQG of the force as a network, whose linear memory is the filter."""

import itertools
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from agents.control.actuators import Command
from agents.control.kalman_filter import state_units
from agents.control.scene import plant_of
from agents.controllers.lqg import DISTURBANCES, design_lqg, weighed
from agents.training.shown import Shown, reduced
from agents.training.start import Start, best_constant, best_of, no_control
from mm_gym import DesignError, Scene

CAUTION = 0.1, 1.0, 10.0, 100.0
"""Factors of the force's weight in these designs: with more the force is clipped less often, which
the regulator does not foresee."""

FINELY = 10.0 ** np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
"""Factors of the best of these, that are tried then."""

SETTLED = 0.05, 0.25
"""Parts of an episode in which a filter's early gains fade to 1/e, that are tried."""

WEIGHTS_OF_MEMORY = "keep", "enter", "back"


def lqg_start(shown: Shown) -> Start:
    """Return the LQG of the least validation cost, each with its stationary filter.

    The weight of the force is then searched more finely.
    """
    found: dict[tuple[float, float], tuple[float, Start]] = {}
    reasons: list[DesignError] = []
    design = _designer(shown)

    def best_of_all(tried: Iterable[tuple[float, float]]) -> tuple[float, float]:
        for numbers in tried:
            try:
                start = design(*numbers)
            except DesignError as error:
                reasons.append(error)
            else:
                least = min((cost for cost, _ in found.values()), default=np.inf)
                found[numbers] = start.cost(shown.scene, least), start
        if not found:
            raise reasons[0]
        return min(found, key=lambda numbers: found[numbers][0])

    caution, unmodelled = best_of_all(itertools.product(CAUTION, DISTURBANCES))
    best = best_of_all((caution * factor, unmodelled) for factor in FINELY)
    return found[best][1]


def settling(scene: Scene, start: Start) -> Start:
    """Return the start with a filter that settles, where it is an LQG and costs less so.

    The stationary gain of a quick filter is that of an episode's start, and that of a slow one
    follows. Where little disturbs a motion, it takes longer than many an episode until the slow one
    alone has forgotten that it did not know the state.
    """
    if start.design is None:
        return start
    design, (caution, stationary) = _designer(Shown(scene, filtered=True)), start.design
    designs: dict[float, Start] = {}
    for unmodelled in {*DISTURBANCES, stationary}:
        with suppress(DesignError):
            designs[unmodelled] = design(caution, unmodelled)
    found = [start]
    for (quick, first), (slow, last) in itertools.product(designs.items(), repeat=2):
        if not slow < quick or not slow <= stationary <= quick:
            continue
        early = np.hstack([getattr(first, w) - getattr(last, w) for w in WEIGHTS_OF_MEMORY])
        for part in SETTLED:
            fade = np.array([np.exp(-1.0 / (part * scene.control.steps))])
            found.append(replace(last, early=early, fade=fade, law=start.law, design=start.design))
    return best_of(scene, found)


def _designer(shown: Shown) -> Callable[[float, float], Start]:
    """Return what makes an LQG of a factor of the force's weight and of what is unmodelled.

    What the actuators but the force do next to it is the best constant.
    """
    scene, actuation = shown.scene, shown.scene.actuation
    if actuation.force is None:
        msg = "law: 'lqg' commands only a force; actuation.force is missing"
        raise DesignError(msg)
    for name in actuation.names[1:]:
        if not shown.filtered or getattr(actuation, name).command == "rate":
            msg = f"law: 'lqg' commands only a force; remove actuation.{name}"
            raise DesignError(msg)
    held = best_constant(shown) if actuation.names[1:] else no_control(shown)
    return partial(_lqg, shown, held, weighed(scene))


def _lqg(shown: Shown, held: Start, scene: Scene, caution: float, unmodelled: float) -> Start:
    """Return an LQG at the stretch or damping that is held, whose estimate is the linear memory.

    The estimate x is corrected by the observation y, and the regulator's own force is known:
    x = (1 - F C) (A x + B u) + F y, with the force u that was clipped.
    """
    at, limit = {}, Command(scene, "force").high
    for name, action in zip(scene.actuation.names[1:], held.direct[1:, 0], strict=True):
        command = Command(scene, name)
        value = command.low + 0.5 * (1.0 + action) * (command.high - command.low)
        field = "initial.stretch" if name == "stretch" else str(scene.actuation.damped)
        at[field] = min(value, command.high)  # beyond which it may be rounded
    weight = caution * scene.objective.effort_weight
    cautious = scene.replace(**{"objective.effort_weight": weight})
    design = design_lqg(cautious, at=at, unmodelled=unmodelled)
    units = state_units(scene, plant_of(scene), design.system)
    corrected, keep, enter = shown.memory_of(design.system, design.filters[-1], units)
    back = np.zeros((len(keep), shown.actions))
    back[:, 0] = corrected @ design.system.B[:, 0] * limit / units
    entered, told = np.hstack([enter, back]), -design.regulator.gain[None] * units / limit
    kept, entered, told = reduced(keep, entered, told)
    start = held.with_memory(kept, *np.split(entered, [shown.count], axis=1))
    start.direct[0, 1 + shown.count :] = told
    # The states that are left of two filters are not the same.
    return replace(start, design=(caution, unmodelled) if kept is keep else None)
