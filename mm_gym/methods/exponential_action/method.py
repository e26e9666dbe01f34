"""Taylor series of the exponential's action, for linear plants with varying parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.lanes import layout as at
from mm_gym.law.free_motion import respond
from mm_gym.methods.base import ExactMethod, Settings, degree, header
from mm_gym.methods.exponential_action import kernel
from mm_gym.methods.support import LINEAR, PARAMETRIC_LINEAR, fastest_rate
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

LONGEST_PIECE = 2.0
"""Largest product of the fastest rate and a piece, the equal part of a sample interval that one
series covers. The terms of a series grow up to exp of it, and round-off with them."""

MOST_PIECES = 1000
"""Largest number of pieces in a sample interval; scenes that need more would run for minutes."""


class ExponentialAction(ExactMethod):
    """A Taylor series of the exponential acting on the state, cut off below round-off."""

    name = "exact"
    title = "the exponential's action"
    how = "exponential acting on the state as a Taylor series, cut off below round-off"
    kinds = (PARAMETRIC_LINEAR, LINEAR)
    entries = build(kernel.propagate, respond=respond)
    held = "a held force and stretch"

    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:  # noqa: ARG002
        """Return the number of pieces in a sample interval and the degree of the series."""
        model = header(support, 3)
        phase = fastest_rate(support) * support.sample_interval
        pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
        if not pieces <= MOST_PIECES:
            msg = (
                f"control.time_step: a sample interval of {support.sample_interval} s spans "
                f"{phase:.3g} times the scene's shortest time constant "
                f"{support.sample_interval / phase:.3g} s; the series allows "
                f"{LONGEST_PIECE * MOST_PIECES:.0f}. Shorten the control step, "
                "or fix what is randomised or actuated"
            )
            raise CompileError(msg)
        model[kernel.PIECES] = pieces
        model[kernel.DEGREE] = degree(phase / pieces)
        model[kernel.UNIFORM] = all(support.fixed(row) for row in range(at.M1, at.HARMONICS))
        return model

    def cost(self, model: NDArray[np.float64]) -> str:
        """Return the number of products with A."""
        return f"{int(model[kernel.PIECES])} x {int(model[kernel.DEGREE])} products with A"
