"""Every plant with two masses, by an adaptive Taylor series: the nonlinear ones need it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.kernels.control_step import build
from mm_gym.methods.base import Method, Option, Settings, header
from mm_gym.methods.support import KINDS, MASSLESS, fastest_rate
from mm_gym.methods.taylor import blocks_kernel, kernel
from mm_gym.methods.taylor import layout as series

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

TIGHTEST = 1e-15
"""Smallest useful tolerance: below it round-off is larger than what is cut off."""

EXTRA_ORDER = 16
"""Orders above the optimum of Jorba and Zou, who count the products only and look at two terms:
here the rest of a series costs as much, and the eight terms looked at hold short series back.
Measured: from 13 on times differ by a few per cent."""

MARGIN = 0.0625
"""Part of the tolerance that a control step's series aim for together: they are rated by their
last terms, and of a thousand random scenes the worst exceeded what it aimed for nine times."""

RATE_PER_STEP = 2.0
"""Shortest time constants that one series spans at least, whatever the order."""


class Taylor(Method):
    """Adaptive Taylor series; crossings of the reference velocity are found on it."""

    name = "taylor"
    title = "the Taylor series"
    how = (
        "adaptive Taylor series; the order follows from the tolerance, "
        "each step from the last terms"
    )
    kinds = tuple(kind for kind in KINDS if kind != MASSLESS)
    entries = build(blocks_kernel.propagate)
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(2, 16)))

    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:
        """Return order, tolerance and which of the forces there are."""
        model = header(support, 5)
        low, high = support.low, support.high
        friction = low[at.VR] > 0.0
        damping = high[at.MU1] * high[at.FN] / low[at.VR] + high[at.CHI] if friction else None
        phase = fastest_rate(support, damping) * support.sample_interval
        if not phase <= RATE_PER_STEP * kernel.MOST_STEPS:
            msg = (
                f"control.time_step: a sample interval of {support.sample_interval} s spans "
                f"{phase:.3g} times the scene's shortest time constant "
                f"{support.sample_interval / phase:.3g} s; the series allows "
                f"{RATE_PER_STEP * kernel.MOST_STEPS:.0f}. Shorten the step"
            )
            raise CompileError(msg)
        # The sample intervals of a control step have equal parts of its tolerance.
        tolerance = MARGIN * max(settings.tolerance, TIGHTEST) / support.intervals_per_step
        model[series.ORDER] = _order(settings.tolerance)
        model[series.TOLERANCE] = tolerance
        model[series.HAS_FRICTION] = friction
        model[series.IS_CUBIC] = high[at.BETA] > 0.0
        model[series.IS_FINITE] = high[at.L0] > 0.0
        return model

    def order(self, settings: Settings) -> str:
        """Return the largest order."""
        return f"at most {_order(settings.tolerance)}"

    def cost(self, model: NDArray[np.float64]) -> str:
        """Return the work of a series."""
        order = int(model[series.ORDER])
        return f"some {order * (order + 20)} products a series, as many series as the motion needs"

    def bound(self, settings: Settings) -> str:
        """Return the tolerance."""
        return f"{settings.tolerance:g} of the state's scale over a control step, and round-off"


def _order(tolerance: float) -> int:
    """Return the even order at which a series costs least (after Jorba and Zou, 2005, eq. 11)."""
    return 2 * math.ceil(-0.25 * math.log(max(tolerance, TIGHTEST)) + 0.5 * EXTRA_ORDER)
