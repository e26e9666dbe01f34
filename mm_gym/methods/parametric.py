"""A Taylor series for the linear plant whose parameters differ between lanes or between steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.kernels import series
from mm_gym.kernels.entries import build
from mm_gym.methods.base import Method, degree, fastest_rate, header

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.parameters import Support

LONGEST_SUBSTEP = 2.0
"""Largest rate times substep: the series' terms grow to exp of it, and round-off with them."""

MOST_SUBSTEPS = 1000
"""Substeps of a control step beyond which a scene is refused rather than run for minutes."""


def _model(support: Support) -> NDArray[np.float64]:
    model = header(support, 3)
    phase = fastest_rate(support) * support.time_step
    substeps = max(1.0, np.ceil(phase / LONGEST_SUBSTEP))
    if not substeps <= MOST_SUBSTEPS:
        msg = (
            f"control.time_step: {support.time_step} s spans {phase:.3g} times the scene's "
            f"shortest time constant {support.time_step / phase:.3g} s; the series allows "
            f"{LONGEST_SUBSTEP * MOST_SUBSTEPS:.0f}. Shorten the step, "
            "or fix what is randomised or actuated"
        )
        raise CompileError(msg)
    model[series.SUBSTEPS] = substeps
    model[series.DEGREE] = degree(phase / substeps)
    model[series.UNIFORM] = all(support.fixed(row) for row in range(at.M1, at.TONES))
    return model


PARAMETRIC = Method(
    name="exact",
    plant="parametric linear",
    how="exponential acting on the state as a Taylor series, cut off below round-off",
    order="exact for a held force and stretch",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=lambda model: (
        f"{int(model[series.SUBSTEPS])} x {int(model[series.DEGREE])} products with A"
    ),
    model=_model,
    entries=build(series.propagate),
)
