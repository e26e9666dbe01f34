"""Embedded Runge-Kutta pairs: the method for any law of motion and any parameters over lanes."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.arrays import Array
from mm_gym.excitation import sources
from mm_gym.lanes import layout
from mm_gym.law.interface import always
from mm_gym.methods.base import Method, Option, Settings
from mm_gym.methods.runge_kutta import kernel
from mm_gym.methods.runge_kutta import layout as slots
from mm_gym.methods.runge_kutta.kernel import LONGEST_WAY, LONGEST_WAY_OF_BOTH, SAFETY
from mm_gym.methods.runge_kutta.tableau_kernel import Tableau, first_sum, tableaus
from mm_gym.methods.support import (
    GENERAL,
    PARAMETRIC_SWITCHED_LINEAR,
    SMOOTH_NONLINEAR,
    SWITCHED_LINEAR,
    SWITCHED_NONLINEAR,
    fastest_decay,
    fastest_oscillation,
)
from mm_gym.methods.taylor.method import Taylor
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from mm_gym.law.interface import Interface, Law
    from mm_gym.methods.support import Support
    from mm_gym.step.control_step import Entries

TIGHTEST = 1e-12  # smallest tolerance: the round-off of the steps must not pass for their error

TIGHT = 1e-9
"""Tolerance below which `auto` prefers a series, as it does at it where one is as quick: for the
cubic spring."""

LOOSEST = 5e-3  # tolerance that looser ones are taken for: estimates of larger errors are none
MARGIN = 0.125  # part of the tolerance that the estimates of all steps may reach together
MOST_EVALUATIONS = 150  # of the forces in a sample interval: beyond, a series is cheaper

COARSER = 0.5
"""Part that a step may have of the second estimate that a harmonic oscillation has where the first
is at the limit. The errors of an oscillation on a cubic spring are larger."""

COARSER_ALONE, MOST_EVALUATIONS_ALONE = 0.05, 3000
"""The same where there is no series: forces bend more sharply than springs, and the first estimate
may vanish by chance."""

TURNS = LONGEST_WAY / LONGEST_WAY_OF_BOTH
"""How many steps of a pair with two estimates do what one of the others does where a force turns
round at every change of the slip's direction."""

OF_TURNS = 0.5  # part of the tolerance that is used there: one estimate misses more than two

FINER = 1e-3
"""Part of the tolerance for the series, which redo the hardest steps: a sphere that bounces off the
end of its springs makes errors grow."""

SHORTEST = 1e-3  # phase [rad] that shorter sample intervals are taken for: any step does

# times the phase's square: what the slip velocity's bend says of its fourth derivative
_BENT = 0.125
_NEAR = 0.5  # of the time in which what a shift in time leaves out grows to the tolerance

_SERIES = Taylor()


class Plan(NamedTuple):
    """The pair, and the steps that a sample interval is expected to take."""

    tableau: Tableau
    steps: int

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces."""
        return self.steps * len(self.tableau.times)


class RungeKutta(Method):
    """Runge-Kutta pairs on all lanes side by side; events are located for many lanes at once."""

    name = "runge_kutta"
    title = "the Runge-Kutta method"
    how = (
        "Runge-Kutta pairs, each lane in steps of its own, whose lengths follow from its error "
        "estimates and changes of regime; what is in doubt is redone by the Taylor series, if the "
        "interface has one"
    )
    kinds = (
        *(SMOOTH_NONLINEAR, SWITCHED_LINEAR, PARAMETRIC_SWITCHED_LINEAR, SWITCHED_NONLINEAR),
        GENERAL,
    )
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(1, 13)))
    tightest = TIGHTEST
    beyond = ", and round-off"

    def entries_of(self, support: Support) -> Entries:
        """Return the kernels for a support's law of motion."""
        return entries_with(support.law, support.interface)

    def deferral(self, support: Support, settings: Settings) -> str | None:
        """Return why `auto` prefers a series, or None."""
        if support.is_general:
            return None
        if settings.tolerance < TIGHT:
            return f"solver.tolerance is below {TIGHT:g}, where a series costs no more"
        if settings.tolerance > TIGHT:
            return None
        if support.kind == SMOOTH_NONLINEAR and not support.high[layout.L0] > 0.0:
            return f"solver.tolerance is {TIGHT:g}, where the series costs no more in one motion"
        return None

    def failing(self, support: Support, settings: Settings) -> str | None:
        """Return why not, where it takes too many steps."""
        if plan_of(support, settings) is not None:
            return None
        alone = support.is_general
        remedy = "; shorten control.time_step, or loosen solver.tolerance" if alone else ""
        return f"it takes more than {_most(alone=alone)} evaluations of the forces{remedy}"

    def limit(self, support: Support) -> str | None:
        """Return why not, where a carriage can escape or the excitation is fast or manifold."""
        if support.low[layout.M1] == 0.0:
            return "carriage.mass is 0"
        if support.low[layout.BETA] < 0.0:
            return "carriage.cubic_coefficient is negative"
        return sources.obstacle(support.frequencies, support.terms, support.sample_interval)

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the model of the Taylor series, then the steps to begin with and their stages."""
        finer = settings._replace(tolerance=settings.tolerance * FINER)
        series = _SERIES.model(support, finer)
        plan = None if self.limit(support) else plan_of(support, settings)
        if plan is None:  # in an interval that is longer than the scene's
            return np.append(series, 0.0)
        tableau, steps = plan
        rate, limit = _rate(support), _limit(support, settings)
        longest = _longest(len(tableau.times), limit / steps, 1.0)
        coarse = _coarser(alone=support.is_general) * tableau.estimates(longest)[1]
        own = {
            slots.STEPS: steps,
            slots.STAGES: tableau.stages,
            slots.LIMIT: limit,
            slots.COARSE: coarse**2,
            slots.IS_COMBINED: tableau.is_combined,
            slots.BEND: _BENT * rate**2,
            slots.NEAR: _NEAR * math.sqrt(limit) / rate,
            slots.ROOTS: round(math.log2(tableau.power - 1)),
            slots.SUM: first_sum(tableau),
        }
        return np.concatenate([series, [own[slot] for slot in sorted(own)], tableau.times[1:]])

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - it follows from the tolerance
        """Return the orders of the pairs."""
        return "3, 5 or 8, whichever is cheapest"

    def cost(self, model: Array) -> str:
        """Return the work expected."""
        steps = int(model[slots.STEPS])
        evaluations = steps * int(model[slots.STAGES]) + 1
        return f"some {evaluations} evaluations of the forces, in {steps} step{'s' * (steps > 1)}"


@cache
def entries_with(law: Law, interface: Interface) -> Entries:
    """Return the kernels for a law of motion and its interface."""
    propagate = kernel.propagate_with(law)
    return build(propagate, shorten=kernel.shorten, stops_at_corners=True, interface=interface)


def _limit(support: Support, settings: Settings) -> float:
    """Return the sum of the relative errors that the steps of a sample interval may have.

    About an unstable place they grow until the control step's end.
    """
    growth = support.growth_rate * support.sample_interval * support.intervals_per_step
    tolerance = min(settings.tolerance, LOOSEST) / support.intervals_per_step
    margin = MARGIN * (OF_TURNS if support.interface.resolves is not always else 1.0)
    return margin * tolerance * math.exp(-growth)


def _rate(support: Support) -> float:
    """Return the fastest rate [1/s] at the amplitudes that episodes begin with, as it is usual."""
    starts = support.start_low[layout.X1], support.start_high[layout.X1]
    oscillation = fastest_oscillation(support, float(np.abs(starts).max()))
    harmonics = float(support.frequencies.max(initial=0.0))
    return max(oscillation, fastest_decay(support), harmonics)


def plan_of(support: Support, settings: Settings) -> Plan | None:
    """Return the steps with the fewest evaluations whose error is expected to be small enough.

    The error is that on an undamped oscillation at the fastest rate of the scene.
    """
    phase = max(_rate(support) * support.sample_interval, SHORTEST)
    if support.slips and support.high[layout.BETA] > 0.0:
        phase /= SAFETY  # a step that is too long would be repeated, and its event found again
    turns = TURNS if support.interface.is_bent else 1.0
    return _plan(phase, _limit(support, settings), turns, alone=support.is_general)


def _most(*, alone: bool) -> int:
    return MOST_EVALUATIONS_ALONE if alone else MOST_EVALUATIONS


def _coarser(*, alone: bool) -> float:
    return COARSER_ALONE if alone else COARSER


@lru_cache(maxsize=256)
def _plan(phase: float, limit: float, turns: float, *, alone: bool) -> Plan | None:
    plans = (_shortest(pair, phase, limit, alone=alone) for pair in tableaus())
    return min(filter(None, plans), key=lambda plan: _work(plan, turns), default=None)


def _work(plan: Plan, turns: float) -> float:
    return plan.evaluations * (turns if plan.tableau.is_combined else 1.0)


def _shortest(pair: Tableau, phase: float, limit: float, *, alone: bool) -> Plan | None:
    """Return the fewest steps of a pair that are enough: more are enough all the more."""

    def is_enough(steps: int) -> bool:
        longest = _longest(len(pair.times), limit / steps, _coarser(alone=alone))
        return phase / steps <= longest

    counts = range(1, _most(alone=alone) // len(pair.times) + 1)
    found = bisect_left(counts, True, key=is_enough)
    return Plan(pair, counts[found]) if found < len(counts) else None


@lru_cache(maxsize=1 << 14)
def _longest(stages: int, limit: float, coarser: float) -> float:
    """Return `Tableau.longest`: the same for intervals of any length, and for many scenes."""
    pair = next(pair for pair in tableaus() if len(pair.times) == stages)
    return pair.longest(limit, coarser)
