"""Adaptive Taylor series for plants with two masses whose interface is no value form."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.methods.base import Method, Option, Settings, header, refuse_long_interval
from mm_gym.methods.support import GENERAL, KINDS, MASSLESS, fastest_rate
from mm_gym.methods.taylor import blocks_kernel, kernel
from mm_gym.methods.taylor import layout as series
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from mm_gym.methods.support import Support

TIGHTEST = 1e-15  # smallest useful tolerance: below it round-off exceeds the truncation error

EXTRA_ORDER = 16
"""Orders above the optimum of Jorba and Zou (2005), who count products only and estimate the error
from two terms. Here the other work of a series costs as much, and the estimate from eight terms
slows down low orders. Measured: from 13 on, times differ by a few per cent."""

MARGIN = 0.0625
"""Part of the tolerance that all series of a control step aim for together. Their errors are only
estimated, from the last terms: in the worst of a thousand random scenes the error was nine times
the aim."""

SHORTEST_SERIES = 2.0
"""Length of the shortest series at any order, in units of the shortest time constant."""


class Taylor(Method):
    """Adaptive Taylor series, on which crossings of the reference velocity are found."""

    name = "taylor"
    title = "the Taylor series"
    how = (
        "adaptive Taylor series; the order follows from the tolerance, "
        "the length of each series from its last terms"
    )
    kinds = tuple(kind for kind in KINDS if kind not in (GENERAL, MASSLESS))
    entries = build(blocks_kernel.propagate, shorten=kernel.shorten, stops_at_corners=True)
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(2, 16)))
    beyond = ", and round-off"

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the order, the tolerance, and which forces there are."""
        model = header(support, 5)
        high = support.high
        phase = fastest_rate(support) * support.sample_interval
        refuse_long_interval(support, phase, SHORTEST_SERIES * kernel.MOST_STEPS)
        # Each sample interval gets an equal part of the control step's tolerance.
        # About an unstable place the errors of a step's beginning grow until its end.
        growth = support.growth_rate * support.sample_interval * support.intervals_per_step
        tolerance = MARGIN * max(settings.tolerance, TIGHTEST) / support.intervals_per_step
        tolerance *= math.exp(-growth)
        model[series.ORDER] = _order(settings.tolerance)
        model[series.TOLERANCE] = tolerance
        model[series.HAS_FRICTION] = support.slips
        model[series.IS_CUBIC] = support.is_cubic
        model[series.IS_FINITE] = high[layout.L0] > 0.0
        return model

    def order(self, settings: Settings) -> str:
        """Return the highest order."""
        return f"at most {_order(settings.tolerance)}"

    def cost(self, model: Array) -> str:
        """Return the work of a series."""
        order = int(model[series.ORDER])
        return f"some {order * (order + 20)} products a series, as many series as the motion needs"


def _order(tolerance: float) -> int:
    """Return the cheapest even order (after Jorba and Zou, 2005, eq. 11)."""
    return 2 * math.ceil(-0.25 * math.log(max(tolerance, TIGHTEST)) + 0.5 * EXTRA_ORDER)
