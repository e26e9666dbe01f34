"""A Taylor series for the linear plant whose parameters differ between lanes or between steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.kernels.control_step import build
from mm_gym.methods.base import Method, degree, header
from mm_gym.methods.exponential_action import kernel as series
from mm_gym.methods.support import fastest_rate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

LONGEST_PIECE = 2.0
"""Largest rate times piece: the series' terms grow to exp of it, and round-off with them."""

MOST_PIECES = 1000
"""Recording of a control step beyond which a scene is refused rather than run for minutes."""


def _model(support: Support) -> NDArray[np.float64]:
    model = header(support, 3)
    phase = fastest_rate(support) * support.sample_interval
    pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
    if not pieces <= MOST_PIECES:
        msg = (
            f"control.time_step: {support.sample_interval} s spans {phase:.3g} times the scene's "
            f"shortest time constant {support.sample_interval / phase:.3g} s; the series allows "
            f"{LONGEST_PIECE * MOST_PIECES:.0f}. Shorten the step, "
            "or fix what is randomised or actuated"
        )
        raise CompileError(msg)
    model[series.PIECES] = pieces
    model[series.DEGREE] = degree(phase / pieces)
    model[series.UNIFORM] = all(support.fixed(row) for row in range(at.M1, at.HARMONICS))
    return model


EXPONENTIAL_ACTION = Method(
    name="exact",
    plant="parametric linear",
    how="exponential acting on the state as a Taylor series, cut off below round-off",
    order="exact for a held force and stretch",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=lambda model: f"{int(model[series.PIECES])} x {int(model[series.DEGREE])} products with A",
    model=_model,
    entries=build(series.propagate),
)
