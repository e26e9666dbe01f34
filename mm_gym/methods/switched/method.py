"""Dry friction, every crossing found to round-off: transition matrices or series of each regime."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.excitation import sources
from mm_gym.lanes import layout
from mm_gym.law import dry_friction
from mm_gym.methods.base import (
    ExactMethod,
    Method,
    Settings,
    degree,
    header,
    refuse_long_interval,
    refuse_overflow,
)
from mm_gym.methods.linear_series.method import TruncatedSeries, degrees_within, rate_of
from mm_gym.methods.support import (
    PARAMETRIC_SWITCHED_LINEAR,
    SWITCHED_LINEAR,
    fastest_oscillation,
    fastest_rate,
)
from mm_gym.methods.switched import kernel, lanes_kernel, series_kernel
from mm_gym.methods.switched import layout as switched
from mm_gym.state_space.equations import slip_space, values_of
from mm_gym.state_space.matrix_exponential import halved_exponentials
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

STATE_INPUTS = 6
"""Inputs of a transition: x1, offset, v1, w, sign of slip, held force. Cosine and sine of each
harmonic follow."""

LONGEST_SERIES = 2.0
"""Longest interval of the last level, in units of the shortest time constant: its Taylor series
loses no digits."""

LONGEST_INTERVAL = 10_000.0
"""Longest sample interval, in units of the shortest time constant: some 0.01 s of work."""

LONGEST_OSCILLATION = 2.0**12
"""Longest sample interval, in units of 1 / the fastest undamped or excited frequency: each unit
takes one halved interval or more."""

LONGEST_DECAY = 2.0**28
"""Longest sample interval, in units of the shortest time constant: the slow motion after a fast
decay takes few halved intervals."""

STIFF = 200.0
"""Length of a sample interval, in units of the shortest time constant, from which halved intervals
are quicker than series side by side."""

FINER = 3  # further halvings of the last level, at which |w''| is sampled
MOST_SAMPLES = 1 << 15  # largest number of samples of |w''| in a regime

SLOWEST = 1e-100
"""Lowest frequency [rad/s] that positions are weighted by; its square does not underflow."""

SAMPLING = 1.1
"""Factor by which |w''| may exceed its samples; they are at most a quarter of the shortest time
constant apart."""


class Switched(ExactMethod):
    """A transition matrix for each regime, crossings of the reference velocity bisected."""

    name = "switched"
    title = "transition matrices for stick and slip"
    how = (
        "a transition matrix for stick and one for slip; "
        "crossings of the reference velocity bisected on halved intervals"
    )
    kinds = (SWITCHED_LINEAR,)
    entries = build(kernel.propagate, whole=kernel.propagate_whole)
    held = "a held force, every crossing found"

    def deferral(self, support: Support, settings: Settings) -> str | None:  # noqa: ARG002
        """Return why `auto` prefers a series where the matrices' lanes go one by one."""
        phase = fastest_rate(support) * support.sample_interval
        if _is_plain(support, phase) or phase > STIFF or _obstacle(support):
            return None
        return "lanes that change their regime would be followed one after the other"

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the transition matrices of both regimes over the interval and its halves."""
        low = support.low
        mu1, mu2, vr, chi, normal = (
            Decimal(float(low[i]))
            for i in (layout.MU1, layout.MU2, layout.VR, layout.CHI, layout.FN)
        )
        with localcontext(Context(prec=60)):
            stick = plain(dry_friction.stick_slope)(mu1, normal, vr)
            kinetic = plain(dry_friction.kinetic_force)(mu2, normal)
            intercept = plain(dry_friction.slip_intercept)(kinetic, chi, vr)
        phase = fastest_rate(support) * support.sample_interval
        unit = "the shortest time constant of the friction"
        refuse_long_interval(support, phase, LONGEST_DECAY, unit=unit)
        oscillation = max(fastest_oscillation(support), support.frequencies.max(initial=0.0))
        turn = oscillation * support.sample_interval
        refuse_long_interval(support, turn, LONGEST_OSCILLATION, unit="1 / the fastest frequency")
        levels = max(0, int(np.ceil(np.log2(phase / LONGEST_SERIES))))
        lines = (stick, Decimal(0)), (chi, intercept)
        with refuse_overflow(support):
            regimes = [_regime(support, *line, levels).ravel() for line in lines]
            is_plain = _is_plain(support, phase)
            series = [_series_model(support, _exact)] if is_plain else []
        model = header(support, switched.REGIMES - layout.MODEL_OWN)
        model[switched.VR], model[switched.LAST_LEVEL] = float(vr), levels
        model[switched.WHOLE] = support.sample_interval
        model[switched.DEGREE] = degree(phase / 2.0**levels)
        harmonics = switched.HARMONIC_SIZE * len(support.ground)
        model[switched.LEVEL_SIZE] = switched.HARMONICS + harmonics
        parts = [model, *regimes, *series]
        ends = np.cumsum([part.size for part in parts])
        model[switched.STICK : switched.STICK + 2] = ends[:2]
        if is_plain:
            model[switched.SERIES] = ends[2]
        return np.concatenate(parts)

    def cost(self, model: Array) -> str:
        """Return the work of an interval, and of a change of regime."""
        inputs = STATE_INPUTS + 2 * int(model[layout.HARMONIC_COUNT])
        terms = int(model[switched.DEGREE])
        return f"7 products with {inputs} inputs; a series of degree {terms} per change of regime"


class _OfLanes(Method):
    """What the series for stick and slip have in common."""

    kinds = (PARAMETRIC_SWITCHED_LINEAR, SWITCHED_LINEAR)
    entries = build(lanes_kernel.propagate, stops_at_corners=True)

    def cost(self, model: Array) -> str:
        """Return the work of a sample interval, and of a change of regime."""
        pieces = round(model[layout.SAMPLE_INTERVAL] / model[lanes_kernel.LONGEST])
        degree = int(model[series_kernel.DEGREE])
        return f"{pieces} series of degree {degree}, and one more per change of regime"


class SwitchedSeries(_OfLanes, ExactMethod):
    """A Taylor series for each regime, on which crossings of the reference velocity are found."""

    name = "switched"
    title = "a series for stick and slip"
    how = (
        "a Taylor series, cut off below round-off, for each regime; "
        "crossings of the reference velocity found on it, all lanes side by side"
    )
    held = "held actuators, every crossing found"

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the degree of the series and the longest piece."""
        return _series_model(support, _exact)


class TruncatedSwitched(_OfLanes, TruncatedSeries):
    """The same, cut off where the tolerance allows."""

    title = "the truncated series for stick and slip"
    how = (
        "a Taylor series of the lowest degree at which what is cut off is below the tolerance, for "
        "each regime; crossings of the reference velocity found on it, all lanes side by side"
    )

    def limit(self, support: Support) -> str | None:
        """Return why not, where the excitation is fast or manifold: lanes would go one by one."""
        return _obstacle(support)

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the degree of the series and the longest piece."""
        return _series_model(support, degrees_within(support, settings))


def _obstacle(support: Support) -> str | None:
    """Return why vectors have no room for the excitation, or None."""
    return sources.obstacle(support.frequencies, support.terms, support.sample_interval)


def _exact(phase: float, _pieces: float) -> int:
    return degree(phase)


def _series_model(support: Support, degree_of_piece: Callable[[float, float], int]) -> Array:
    """Return the constants of the kernel; the degree is that of a phase and of so many pieces."""
    refuse_long_interval(support, fastest_rate(support) * support.sample_interval, LONGEST_INTERVAL)
    slopes = support.steepest, float(support.high[layout.CHI])
    phases = np.array([rate_of(support, slope) * support.sample_interval for slope in slopes])
    pieces = np.maximum(1.0, np.ceil(phases / LONGEST_SERIES))
    parts = pieces.max() * support.intervals_per_step
    # What the last term of a jet causes begins so much later.
    terms = degree_of_piece((phases / pieces).max(), parts) + max(support.terms - 1, 0)
    model = header(support, lanes_kernel.END - layout.MODEL_OWN)
    model[series_kernel.DEGREE] = min(terms, lanes_kernel.WIDTH - 1)  # 31, where 25 are exact
    longest = support.sample_interval / pieces
    model[lanes_kernel.LONGEST : lanes_kernel.LONGEST + 2] = longest
    if not _obstacle(support):
        most = lanes_kernel.SPARE + (1 + lanes_kernel.SPARE_EACH) * pieces.max()
        model[lanes_kernel.MOST_PIECES] = most
    model[lanes_kernel.RECIPROCALS : lanes_kernel.END] = 1.0 / np.arange(1, lanes_kernel.WIDTH + 1)
    return model


def _is_plain(support: Support, phase: float) -> bool:
    """Return whether one interval is enough, and nothing excites the plant in it."""
    return phase <= LONGEST_SERIES and not support.ground


def _regime(support: Support, damping: Decimal, force: Decimal, levels: int) -> Array:
    """Return the levels of one regime of the friction, f = damping w + sign force.

    See `mm_gym.methods.switched.kernel`.
    """
    generator = _generator(support, damping, force)
    transitions = halved_exponentials(generator, support.sample_interval, levels + FINER)
    # The row that maps the inputs to w'' at the same instant.
    second = (generator[3] @ generator).astype(np.float64)
    gains = _gains(support, second, [transition.astype(np.float64) for transition in transitions])
    return np.array([_level(second, *level) for level in zip(transitions, gains, strict=False)])


def _level(second: Array, transition: NDArray[np.object_], gains: Array) -> Array:
    rows, change = _state_rows(transition), _change_of_slip(transition)
    slots = [second[:6], rows[:, :6].ravel(), change[:6], gains[:6], gains[-1:]]
    for k in range(6, len(second), 2):
        own = slice(k, k + 2)
        slots += [second[own], rows[:, own].ravel(), change[own], gains[own]]
        slots.append(transition[own, k].astype(np.float64))
    return np.concatenate(slots)


def _generator(support: Support, damping: Decimal, force: Decimal) -> NDArray[np.object_]:
    """Return the equations of one regime with all inputs as the state.

    They are x1, offset, v1, w, sign, u, then cosine and sine of each harmonic.
    """
    with localcontext(Context(prec=60)):
        values = values_of(support.low) | {"c": damping}
        system = slip_space(values)
        size = STATE_INPUTS + 2 * len(support.ground)
        generator = np.full((size, size), Decimal(0))
        generator[:4, :4] = system.a
        generator[:4, 5] = system.control(is_between=support.is_between)
        generator[3, 4] = -force * (1 / values["m1"] + 1 / values["m2"])
        generator[2, 4] = force / values["m1"]
        for j, ground in enumerate(support.ground):
            k = STATE_INPUTS + 2 * j
            frequency = Decimal(float(support.frequencies[j]))
            generator[:4, k + 1] = system.ground if ground else system.force
            generator[k, k + 1], generator[k + 1, k] = -frequency, frequency
    return generator


def _state_rows(transition: NDArray[np.object_]) -> Array:
    """Return the rows of x1, x2, v1, v2 for inputs with x2 and v2; each entry is rounded once."""
    x1, offset, v1, w = transition[:4]
    with localcontext(Context(prec=100)):
        rows = np.array([x1, x1 + offset, v1, v1 + w])
        rows[:, 0], rows[:, 2] = rows[:, 0] - rows[:, 1], rows[:, 2] - rows[:, 3]
    return rows.astype(np.float64)


def _change_of_slip(transition: NDArray[np.object_]) -> Array:
    """Return the row of w(t) - w(0); each entry is rounded once."""
    row = transition[3].copy()
    with localcontext(Context(prec=100)):
        row[3] -= 1
    return row.astype(np.float64)


def _gains(support: Support, second: Array, transitions: list[Array]) -> list[Array]:
    """Return for each level the gains that bound w'' over its interval h.

    They satisfy h**2 |w''(t)| / 2 <= gains . (|inputs|, |w''(0)|).

    w''(t) = r(t) . inputs, with r sampled. r(t) is split into g(t) r(0), its projection on r(0),
    and a rest, so that |w''(t)| <= |g(t)| |w''(0)| + |rest| . |inputs|. On the slow motion of a
    stiff regime both parts are small, where |r(t)| . |inputs| is not.
    """
    finest = len(transitions) - 1
    rows = second[None]
    while len(rows) <= min(1 << finest, MOST_SAMPLES):
        rows = np.vstack([rows, rows @ transitions[finest - int(np.log2(len(rows)))]])
    frequency = max(fastest_oscillation(support), SLOWEST)
    weights = np.zeros(len(second))
    weights[:4] = frequency**-2, frequency**-2, 1.0, 1.0
    norm = (weights * second) @ second
    along = rows @ (weights * second) / norm if norm > 0.0 else np.zeros(len(rows))
    rest = np.abs(rows - along[:, None] * second)
    largest = SAMPLING * np.maximum.accumulate(np.column_stack([rest, np.abs(along)]))
    gains: list[Array] = []
    for k in range(len(transitions) - FINER):
        last = 1 << (finest - k)
        # An interval too long to be sampled is always halved.
        bend = largest[last] if last < len(rows) else np.full(len(second) + 1, np.inf)
        gains.append(0.5 * (support.sample_interval / 2.0**k) ** 2 * bend)
    return gains
