"""Frames per second: one frame a control step, slowed down until the eye can follow."""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.lanes import layout as at
from mm_gym.rendering.numbers import text_of

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant

RATES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25)
"""Frames per second; 25 are fluent, and more would make videos larger."""

SHORTEST_PERIOD = 0.6
"""Least time [s] on the screen of the carriage's natural period, so that an eye can follow."""

FEWEST = 4.0
"""Control steps below which a period is not seen as one."""


def natural_period(plant: Plant) -> float:
    """Return the carriage's natural period [s], or infinity if it has no linear stiffness."""
    low, high = plant.support.start_low, plant.support.start_high
    row = 0.5 * low + 0.5 * high
    stiffness, mass = row[at.K1] * row[at.ALPHA], row[at.M1] or row[at.M2]
    with np.errstate(all="ignore"):
        return float(2.0 * pi * sqrt(mass / stiffness)) if stiffness > 0.0 else np.inf


def frames_per_second(plant: Plant) -> int:
    """Return how many control steps are shown in a second: one of `RATES`."""
    step, period = plant.time_step, natural_period(plant)
    slowdown = max(1.0, SHORTEST_PERIOD / max(period, FEWEST * step))
    most = 1.0 / (slowdown * step) * (1.0 + 1e-9)
    return max((rate for rate in RATES if rate <= most), default=RATES[0])


def speed_text(time_step: float, frames: int) -> str:
    """Return how the time on the screen relates to that of the motion."""
    ratio = 1.0 / (time_step * frames)
    if abs(ratio - 1.0) < 0.005:  # noqa: PLR2004 - what three digits do not tell from 1
        return "real time"
    if ratio > 1.0:
        return f"slow motion 1 : {text_of(float(f'{ratio:.3g}'))}"
    return f"fast motion {text_of(float(f'{1.0 / ratio:.3g}'))} : 1"
