"""Every plant with two masses, by an adaptive Taylor series: the nonlinear ones need it."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.kernels.control_step import build
from mm_gym.methods.base import Method, header
from mm_gym.methods.support import fastest_rate
from mm_gym.methods.taylor import blocks_kernel as taylor_block
from mm_gym.methods.taylor import kernel as taylor
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

SHARE = 0.0625
"""Share of the tolerance that a control step's series aim for together: they are judged by their
last terms, and of a thousand random scenes the worst exceeded what it aimed for nine times."""

RATE_PER_STEP = 2.0
"""Shortest time constants that one series spans at least, whatever the order."""


def _order(tolerance: float) -> int:
    """Return the even order at which a series costs least (after Jorba and Zou, 2005, eq. 11)."""
    return 2 * math.ceil(-0.25 * math.log(max(tolerance, TIGHTEST)) + 0.5 * EXTRA_ORDER)


def _model(support: Support, *, tolerance: float) -> NDArray[np.float64]:
    model = header(support, 5)
    low, high = support.low, support.high
    friction = low[at.VR] > 0.0
    damping = high[at.MU1] * high[at.FN] / low[at.VR] + high[at.CHI] if friction else None
    phase = fastest_rate(support, damping) * support.sample_interval
    if not phase <= RATE_PER_STEP * taylor.MOST_STEPS:
        msg = (
            f"control.time_step: {support.sample_interval} s spans {phase:.3g} times the scene's "
            f"shortest time constant {support.sample_interval / phase:.3g} s; the series allows "
            f"{RATE_PER_STEP * taylor.MOST_STEPS:.0f}. Shorten the step"
        )
        raise CompileError(msg)
    model[series.ORDER] = _order(tolerance)
    model[series.TOLERANCE] = SHARE * max(tolerance, TIGHTEST)
    model[series.HAS_FRICTION] = friction
    model[series.IS_CUBIC] = high[at.BETA] > 0.0
    model[series.IS_FINITE] = high[at.L0] > 0.0
    return model


def taylor_method(tolerance: float, plant: str) -> Method:
    """Return the method for a tolerance: a control step's error relative to the state's scale."""
    order = _order(tolerance)
    return Method(
        name="taylor",
        plant=plant,
        how=(
            "adaptive Taylor series; the order follows from the tolerance, "
            "each step from the last terms"
        ),
        order=f"at most {order}",
        bound=f"{tolerance:g} of the state's scale over a control step, and round-off",
        cost=lambda _: (
            f"some {order * (order + 20)} products a step, as many steps as the motion needs"
        ),
        model=partial(_model, tolerance=tolerance),
        entries=ENTRIES,
        options=("tolerance",),
    )


ENTRIES = build(taylor_block.propagate)
