"""Taylor series for stick and slip, for plants with dry friction and varying parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.methods.base import ExactMethod, Settings, degree, header
from mm_gym.methods.support import PARAMETRIC_SWITCHED_LINEAR, SWITCHED_LINEAR, fastest_rate
from mm_gym.methods.switched import series_kernel
from mm_gym.methods.switched.method import LONGEST_SERIES, refuse_long_interval
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

LONGEST_INTERVAL = 10_000.0
"""Longest sample interval, in units of the shortest time constant: some 0.01 s of work."""


class SwitchedSeries(ExactMethod):
    """A Taylor series for each regime, on which crossings of the reference velocity are found."""

    name = "switched"
    title = "a series for stick and slip"
    how = (
        "a Taylor series, cut off below round-off, for each regime; "
        "crossings of the reference velocity found on it"
    )
    kinds = (PARAMETRIC_SWITCHED_LINEAR, SWITCHED_LINEAR)
    entries = build(series_kernel.propagate, stops_at_corners=True)
    held = "a held force and stretch, every crossing found"

    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:  # noqa: ARG002
        """Return the degree of the series."""
        phase = fastest_rate(support) * support.sample_interval
        refuse_long_interval(
            support, phase, LONGEST_INTERVAL, "the shortest time constant that the scene can have"
        )
        model = header(support, 1)
        model[series_kernel.DEGREE] = degree(LONGEST_SERIES)
        return model

    def cost(self, model: NDArray[np.float64]) -> str:
        """Return the work of a time constant, and of a change of regime."""
        degree = int(model[series_kernel.DEGREE])
        return f"a series of degree {degree} per time constant and change of regime"
