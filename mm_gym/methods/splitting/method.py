"""Extrapolated splitting, for springs that are not linear, at rates that a step resolves."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.arrays import Array
from mm_gym.excitation import sources
from mm_gym.excitation.kinds import CORNERS
from mm_gym.lanes import layout
from mm_gym.methods.base import Method, Option, Settings, degree
from mm_gym.methods.splitting import kernel
from mm_gym.methods.splitting import layout as slots
from mm_gym.methods.support import SMOOTH_NONLINEAR, fastest_decay
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor.method import Taylor
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from mm_gym.law.interface import Law
    from mm_gym.methods.support import Support
    from mm_gym.step.control_step import Entries

TIGHTEST = 1e-12
"""Smallest tolerance: the columns' round-off, some 1e-15, must not pass for their error."""

TIGHT = 1e-9
"""Tolerance up to which `auto` prefers the Taylor series: the default stays what it was, with
errors of 1e-11 over an episode where the splitting's reach the tolerance in each control step."""

TIGHT_IF_LINEAR = 1e-5
"""The same where springs of finite stretch alone are not linear, in favour of Runge-Kutta pairs."""

LONGEST = 6.0
"""Longest sample interval, in radians of the fastest oscillation; in longer ones a method that
chooses the length of each step is cheaper."""

MARGIN = 0.5  # part of the tolerance that estimate and bound of the error may reach

FASTEST = 1.0
"""Largest phase of a decay in half a sample interval for which a lane's own dampers are a series:
its digits cancel where it is large."""

SMALL = 1.0 / 8.0
"""Amplitude of the slowest lane of a vector, over the largest that episodes begin with."""

FINEST = 24  # most substeps of the first column

# A sample interval spans r radians at the largest displacement on the way, and the first of k
# columns has n substeps. A column's error is a series in even powers of its substep. Its
# coefficients are sums of products of the springs' forces and slopes, r^2 each; of the carriage's
# way s, f times the largest position; and of the shift h^2 F / m1 by a held force from rest, q
# times that position.
#
# One column: the error is below the sum of
#   ERROR (r / n)^4 max(1, r / ROUGH)^2,
#   ERROR_OF_PUSH r^2 max(q, q^2) / n^4, and
#   ERROR_OF_WAY h^2 k1 beta / m1 s^2 (f + q) / n^4.
# In a short interval at a turning point the velocity, which the first one is relative to, is as
# small as r. The last one is what Simpson's rule leaves of the cubic spring's force times the time
# that remains, on a straight way: exact, and the largest in flight through the middle.
#
# Several: the difference from the result without the first column is the error of the others. It is
# ESTIMATE r^2 times the product, over the columns but the first, of (r / 2 m)^2. With the first the
# error is up to (RAISE r / n)^2 times as large, by which the estimate is raised where that exceeds
# 1. A power of the substep can vanish by chance, but hardly two in a row: the estimate is taken as
# LATER (r / m)^2 times that of one column less at least, with m substeps in the last one; that is
# half of what is usual. Under a held force each further column takes max(r^2, q) / (2 m)^2 of the
# term above.
#
# Springs of finite stretch add ERROR_OF_WAY h^2 F'''/6 (1 / m1 + 1 / m2) s^2 (f + q) / n^4 of their
# force F and their way s, BENT_APART times as large since F''' grows along the way. They raise the
# estimate by LEAST_RISE and the square of RISE times the way between two kicks over what is left of
# the way to a collapse.
#
# Excitation is sampled at the kicks, with one substep as by Simpson's rule. That leaves of the
# velocity SIMPSON h^5 / n^4 times its fourth derivative f, and of the position the same of
# (h - t) f. Each further column leaves 1 / (2 m)^2 of that at most, since no excitation turns by
# more than a radian.
#
# ERROR, ROUGH, ERROR_OF_PUSH, RAISE and LATER were chosen on 698,000 intervals of 3,774 random
# plants (of tests/numerics/random_scenes.py, at amplitudes from a thirtieth to twice the start's,
# speeds and forces of all sizes): each bound alone may reach MARGIN of the tolerance, and the
# largest error was 0.82 of it. BENT_APART and RISE were chosen on 3,000 more, see section 7 of
# docs/numerics.md. ESTIMATE is the typical size on CarriageForceDuffing: it decides on
# the cost.
_ESTIMATE, _ERROR, _ROUGH = 1.5e-4, 1.5e-3, 1.5
_ERROR_OF_PUSH, _ERROR_OF_WAY = 1e-2, 1.0 / 120.0
_SIMPSON = 1.0 / 2880.0
_BENT_APART = 4.0  # of springs of finite stretch, whose bend grows along the way
_RAISE, _LATER = 2.0, 0.5
_OVERHEAD = 0.7  # of a column, in substeps
_ROUND_OFF = 2e-15  # of a column; the weights multiply it
_RECIPROCALS = [1.0 / math.factorial(n + 1) for n in range(slots.MOST_DEGREE + 1)]


class Plan(NamedTuple):
    """The columns of an interval."""

    first: int  # substeps of the first column; each next one has one more
    columns: int  # whose error is expected to be below the tolerance

    @property
    def counts(self) -> range:
        """Substeps of each column."""
        return range(self.first, self.first + self.columns)


class Splitting(Method):
    """Kicks and drifts in several columns of substeps, extrapolated until they agree."""

    name = "splitting"
    title = "extrapolated splitting"
    how = (
        "fourth-order splitting into exact drifts and kicks with the force's gradient, in one "
        "number of substeps or extrapolated from several; what misses the tolerance is redone by "
        "the Taylor series"
    )
    kinds = (SMOOTH_NONLINEAR,)
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(1, 13)))
    tightest = TIGHTEST

    def entries_of(self, support: Support) -> Entries:
        """Return the kernels for a support's law of motion."""
        return entries_with(support.law)

    def failing(self, support: Support, settings: Settings) -> str | None:
        """Return why not, where round-off is beyond the tolerance."""
        if plan_of(support, settings) is None:
            return f"its round-off is beyond solver.tolerance = {settings.tolerance:g}"
        return None

    def deferral(self, support: Support, settings: Settings) -> str | None:
        """Return why `auto` takes another method at tight tolerances."""
        if settings.tolerance <= TIGHT:
            return (
                f"solver.tolerance is {TIGHT:g} or less, where the series costs no more in one "
                "motion and stays far below it; over many lanes the splitting is faster"
            )
        if settings.tolerance < TIGHT_IF_LINEAR and not support.is_cubic:
            return (
                f"solver.tolerance is below {TIGHT_IF_LINEAR:g} and the carriage's spring linear, "
                "where the Runge-Kutta pairs cost no more"
            )
        return None

    def limit(self, support: Support) -> str | None:
        """Return why not, where a spring or excitation is of another kind, or all is too fast."""
        if support.low[layout.ALPHA] < 0.0 or support.low[layout.BETA] < 0.0:
            return "a coefficient of the carriage's spring is negative"
        if support.sampled and support.excitation[CORNERS] > 0.0:
            return "a record has corners within sample intervals"
        too_fast = sources.obstacle(support.frequencies, support.terms, support.sample_interval)
        return too_fast or _haste(support)

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the model of the Taylor series, then the columns and their weights."""
        series = _SERIES.model(support, settings)
        model = np.concatenate([series, np.zeros(slots.END - len(series))])
        low, high, plan = support.low, support.high, plan_of(support, settings)
        assert plan is not None  # noqa: S101 - else there is an obstacle
        model[slots.FIRST_CHECK] = plan.columns
        limit = model[slots.LIMIT] = _limit(support, settings)
        model[slots.COLUMNS] = max(plan.columns, _most_columns(plan.first, limit))
        # With excitation the masses share more terms than springs alone would give them.
        excited = support.terms or len(support.ground) > 0
        model[slots.IS_SPRUNG] = high[layout.K0] > 0.0 or excited or support.is_between
        model[slots.INTERVAL] = support.sample_interval
        fastest = support.frequencies.max(initial=0.0) * support.sample_interval
        model[slots.FASTEST_TURN] = 1.0 if support.terms else fastest**2
        linear = -high[layout.K1] * high[layout.ALPHA] / low[layout.M1]
        cubic = -high[layout.K1] * high[layout.BETA] / low[layout.M1]
        masses = 1.0 / low[layout.M1], 1.0 / low[layout.M2]
        model[slots.PLANT : slots.RECIPROCALS] = *masses, linear, cubic
        if _drawn(support):
            model[slots.IS_DRAWN], model[slots.DEGREE] = 1.0, degree(_decay(support) / plan.first)
        model[slots.RECIPROCALS : slots.SQUARE] = _RECIPROCALS
        square = model[slots.SQUARE] = support.sample_interval**2
        coupled = square * (1.0 / low[layout.M1] + 1.0 / low[layout.M2])
        model[slots.STEEPNESS] = -square * linear
        if not high[layout.L0] > 0.0:
            model[slots.STEEPNESS] += coupled * support.stiffest
        else:  # lanes know their own slope
            model[slots.COUPLED] = coupled
            bent = _BENT_APART * _ERROR_OF_WAY / plan.first**4 / limit / low[layout.L0] ** 2
            model[slots.BENT_APART] = coupled * bent
        model[slots.STEEPER] = -3.0 * square * cubic
        model[slots.BENT] = -_ERROR_OF_WAY * square * cubic / plan.first**4 / limit
        model[slots.RAISE] = (_RAISE / plan.first) ** 2
        counts = np.arange(plan.first, plan.first + slots.MOST)
        pushed = np.cumprod([_ERROR_OF_PUSH / plan.first**4, *(0.25 / counts[1:] ** 2)]) / limit
        model[slots.PUSHED : slots.PUSHED + slots.MOST] = pushed
        bending = np.cumprod([_SIMPSON / plan.first**4, *(0.25 / counts[1:] ** 2)]) / limit
        model[slots.BENDING : slots.BENDING + slots.MOST] = bending
        model[slots.LATER + 2 : slots.LATER + slots.MOST] = _LATER / counts[2:] ** 2
        lengths = support.sample_interval / counts
        drifts = drifts_of(high, 0.5 * lengths)
        model[slots.LONGEST : slots.LONGEST + slots.MOST] = longest(support, settings, plan.first)
        for k, (h, drift) in enumerate(zip(lengths, drifts, strict=True)):
            middle, gradient = 2.0 * h / 3.0, h * h / 24.0
            slot = slots.COLUMN + slots.COLUMN_SIZE * k
            own = plan.first + k, h / 6.0, h / 3.0, middle, gradient
            model[slot : slot + slots.COLUMN_SIZE] = [*own, *drift]
            slot = slots.WEIGHTS + slots.WEIGHTS_SIZE * (k + 1)
            model[slot : slot + slots.WEIGHTS_SIZE] = weights_of(plan.first, k + 1)
        return model

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - it follows from the tolerance
        """Return the order."""
        return "2 more than twice the number of columns"

    def cost(self, model: Array) -> str:
        """Return the work expected."""
        first, columns = int(model[slots.COLUMN + slots.COUNT]), int(model[slots.FIRST_CHECK])
        counts = Plan(first, columns).counts
        substeps = "one substep" if sum(counts) == 1 else f"{', '.join(map(str, counts))} substeps"
        return (
            f"some {30 * sum(counts)} products in {substeps}; more where that misses the tolerance"
        )


_SERIES = Taylor()


@cache
def entries_with(law: Law) -> Entries:
    """Return the kernels for a law of motion."""
    return build(kernel.propagate_with(law), shorten=taylor.shorten)


def _drawn(support: Support) -> bool:
    """Tell whether lanes have constants of their own."""
    rows = (layout.M1, layout.M2, layout.D, layout.C, layout.K1, layout.ALPHA, layout.BETA)
    return not all(support.fixed(row) for row in rows)


def _decay(support: Support) -> float:
    """Return the phase of the fastest decay in half a sample interval."""
    return 0.5 * support.sample_interval * fastest_decay(support)


def _haste(support: Support) -> str | None:
    """Return why a sample interval is too long for dampers or springs, or None."""
    if _drawn(support) and not _decay(support) <= FASTEST:
        return (
            f"dampers that are drawn slow the masses down by {_decay(support):.3g} in half a "
            f"sample interval; at most {FASTEST:g}"
        )
    phase = fastest_frequency(support) * support.sample_interval
    if not phase <= LONGEST:
        return (
            f"a sample interval spans {phase:.3g} radians of the fastest oscillation; "
            f"at most {LONGEST:g}"
        )
    return None


def _limit(support: Support, settings: Settings) -> float:
    """Return what the estimate may reach in a sample interval."""
    return MARGIN * settings.tolerance / support.intervals_per_step


def fastest_frequency(support: Support) -> float:
    """Return the fastest frequency [rad/s] at the largest amplitude that is to be expected.

    That of the energy at the start, and of the held force. It decides on the cost alone.
    """
    low, high = support.low, support.high
    x1, offset, v1, v2 = (
        max(abs(support.start_low[row]), abs(support.start_high[row])) for row in range(4)
    )
    linear, cubic = high[layout.K1] * high[layout.ALPHA], high[layout.K1] * high[layout.BETA]
    energy = high[layout.M1] * v1**2 + high[layout.M2] * v2**2 + support.stiffest * offset**2
    energy += linear * x1**2 + 0.5 * cubic * x1**4
    # 0.5 cubic x^4 + linear x^2 = energy
    root = math.sqrt(linear**2 + 2.0 * cubic * energy)
    square = 2.0 * energy / (linear + root) if energy else 0.0
    outer, pair = linear + 3.0 * cubic * square, support.stiffest
    return math.sqrt((outer + pair) / low[layout.M1] + pair / low[layout.M2])


def longest(support: Support, settings: Settings, first: int) -> Array:
    """Return by what angle, squared, the springs may turn the motion if 1, 2, ... columns do.

    There the bound of their error, at the rate that follows from springs and dampers, reaches the
    limit. Negative if it is beyond the limit even at rest.

    Returns
    -------
    numpy.ndarray
        (of.MOST,)
    """
    limit = _limit(support, settings)
    decay = fastest_decay(support) * support.sample_interval
    turns = [_longest(first, k + 1, limit) - decay for k in range(slots.MOST)]
    return np.array([turn * abs(turn) for turn in turns])


def _longest(first: int, columns: int, limit: float) -> float:
    """Return the radians that an interval may span for an error of the columns below a limit."""
    if columns == 1:
        room = limit / _ERROR * float(first) ** 4
        return min(room ** (1 / 4), (room * _ROUGH**2) ** (1 / 6))
    scale = math.prod(2.0 * (first + k) for k in range(1, columns))
    return (limit / _ESTIMATE * scale**2) ** (0.5 / columns)


def plan_of(support: Support, settings: Settings) -> Plan | None:
    """Return the cheapest plan for the fastest oscillation; None if each misses the tolerance."""
    phase = fastest_frequency(support) * support.sample_interval
    return _plan(phase, _pushed(support), _limit(support, settings))


def _pushed(support: Support) -> float:
    """Return the shift h^2 F / m1 by the largest held force, over an amplitude of episodes' starts.

    The slowest lane of a vector decides, but not how many a processor's vectors hold.
    """
    rows, force = [layout.X1, layout.X2], float(support.high[layout.FORCE])
    starts = np.abs([support.start_low[rows], support.start_high[rows]]).max() * SMALL
    amplitude = float(starts) or force / (support.outer_stiffness or 1.0) or 1.0
    return force / float(support.low[layout.M1]) * support.sample_interval**2 / amplitude


@lru_cache(maxsize=1024)
def _plan(phase: float, push: float, limit: float) -> Plan | None:
    best: tuple[float, Plan | None] = (math.inf, None)
    for first in range(1, FINEST + 1):
        if first > best[0]:
            break  # more substeps only cost more
        pushed = _ERROR_OF_PUSH * phase**2 * max(push, push**2) / float(first) ** 4
        if phase <= min(_longest(first, 1, limit), 2.0 * first) and pushed <= limit:
            best = min(best, (float(first), Plan(first, 1)), key=lambda one: one[0])
        estimate = _ESTIMATE * phase**2
        for columns in range(2, slots.MOST):
            estimate *= (phase / (2.0 * (first + columns - 1))) ** 2
            pushed *= max(phase**2, push) / (2.0 * (first + columns - 1)) ** 2
            if max(estimate, pushed) <= limit and phase <= first:
                plan = Plan(first, columns)
                cost = sum(plan.counts) + _OVERHEAD * (columns + 2)
                if cost < best[0] and _can_extrapolate(first, columns, limit):
                    best = cost, plan
                break
    return best[1]


@lru_cache(maxsize=1024)
def _most_columns(first: int, limit: float) -> int:
    """Return how many columns can be extrapolated with their round-off below a limit."""
    return next(k for k in range(slots.MOST, 0, -1) if k == 1 or _can_extrapolate(first, k, limit))


def _can_extrapolate(first: int, columns: int, limit: float) -> bool:
    """Tell whether the weighed round-off of the columns is below a limit."""
    weights = _extrapolating(range(first, first + columns))
    return _ROUND_OFF * sum(map(abs, weights)) <= limit


@lru_cache(maxsize=256)
def weights_of(first: int, columns: int) -> Array:
    """Return the weights of the columns' states, then what weighs them to the estimate.

    Both are filled up with zeros to (of.MOST,) each. The estimate is the difference from the result
    without the first column.
    """
    weights, without_first = np.zeros((2, slots.MOST))
    weights[:columns] = _extrapolating(range(first, first + columns))
    if columns > 1:
        without_first[1:columns] = _extrapolating(range(first + 1, first + columns))
    return np.append(weights, weights - without_first)


def _extrapolating(counts: range) -> list[float]:
    """Return the weights that remove the powers 4, 6, ... of the substep from the error.

    As fractions: their sums cancel.
    """
    matrix = [
        [Fraction(1, n ** (2 + 2 * row) if row else 1) for n in counts] + [Fraction(row == 0)]
        for row in range(len(counts))
    ]
    for j, pivot in enumerate(matrix):  # Gauss and Jordan: no pivot of distinct powers is 0
        pivot[:] = [x / pivot[j] for x in pivot]
        for row in matrix:
            if row is not pivot:
                row[:] = [x - row[j] * y for x, y in zip(row, pivot, strict=True)]
    return [float(row[-1]) for row in matrix]


def drifts_of(row: Array, times: Array) -> Array:
    """Return how the dampers alone, v' = M v, let the masses drift in times [s], (n, 8).

    What the velocities add to the positions (2, 2) [s], then what is left of them (2, 2). Scaled by
    the roots of the masses M is symmetric.
    """
    roots = np.sqrt(row[[layout.M1, layout.M2]])
    d, c = row[layout.D], row[layout.C]
    rates, modes = np.linalg.eigh(-np.array([[c + d, -c], [-c, c]]) / np.outer(roots, roots))
    phases = np.minimum(rates, 0.0) * times[:, None]
    there, back = modes / roots[:, None], modes.T * roots
    still = phases == 0.0
    mean = np.where(still, 1.0, np.expm1(phases) / np.where(still, 1.0, phases))
    added, left = (
        np.einsum("ij,nj,jk->nik", there, factor, back)
        for factor in (mean * times[:, None], np.exp(phases))
    )
    return np.concatenate([added.reshape(-1, 4), left.reshape(-1, 4)], axis=1)
