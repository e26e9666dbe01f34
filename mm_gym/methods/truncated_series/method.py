"""A Taylor series with as many terms as the tolerance asks for, for an actuated stretch."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mm_gym.lanes import layout as at
from mm_gym.law.free_motion import respond
from mm_gym.methods.base import Method, Option, Settings, header
from mm_gym.methods.support import PARAMETRIC_LINEAR, fastest_rate
from mm_gym.methods.truncated_series import kernel
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

LONGEST_STEP = 2.0
"""Largest product of the fastest rate and the sample interval."""

TIGHTEST = 1e-12
"""Smallest tolerance: its degree is 19 in the longest step, where the terms lose no digits."""

TIGHT = 1e-9
"""Tolerance up to which `auto` prefers the exact methods: they cost little more than the series,
some 13 products with the generator, and the default stays what it was."""

MARGIN = 0.25
"""Part of the tolerance that what is cut off may reach in units of energy: an error of one mass may
be larger relative to the motion, in the worst of two thousand random scenes by a factor of two."""


class TruncatedSeries(Method):
    """A Taylor series of the motion, cut off where the tolerance allows."""

    name = "series"
    title = "the truncated series"
    how = (
        "Taylor series of the lowest degree at which what is cut off is below the tolerance, all "
        "lanes side by side"
    )
    kinds = (PARAMETRIC_LINEAR,)
    entries = build(kernel.propagate, respond=respond)
    option = Option("tolerance", tuple(float(f"1e-{digits}") for digits in range(1, 13)))
    tightest = TIGHTEST

    def deferral(self, support: Support, settings: Settings) -> str | None:  # noqa: ARG002
        """Return why `auto` takes an exact method at tight tolerances."""
        if settings.tolerance > TIGHT:
            return None
        return f"solver.tolerance is {TIGHT:g} or less, where an exact method costs little more"

    def limit(self, support: Support) -> str | None:
        """Return why not, unless only the stretch and one harmonic force vary, in short steps."""
        others = support.varying_parameters
        if others:
            return f"{others[0]} is randomised or actuated"
        if support.terms or any(support.ground) or len(support.ground) > 1:
            return "of all excitation it takes only impulses and one harmonic force"
        phase = _phase(support)
        if not phase <= LONGEST_STEP:
            return f"fastest rate times sample interval is {phase:.3g}, above {LONGEST_STEP:g}"
        return None

    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:
        """Return the degree, the generator, and the weights of the derivatives."""
        model = header(support, kernel.END - at.MODEL_OWN)
        p, h = support.low, support.sample_interval
        unit = h * h / p[at.M1]
        model[kernel.DEGREE] = degree_of(_phase(support), settings.tolerance)
        model[kernel.K1] = p[at.K1] * p[at.ALPHA] * unit
        model[kernel.D], model[kernel.C] = p[at.D] * h / p[at.M1], p[at.C] * h / p[at.M1]
        model[kernel.K0], model[kernel.PUSH] = p[at.K0] * unit, unit
        model[kernel.BOTH] = 1.0 + p[at.M1] / p[at.M2]
        weights = [1.0 / math.factorial(n) for n in range(kernel.MOST + 1)]
        model[kernel.WEIGHTS : kernel.END] = weights
        return model

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - it follows from the tolerance
        """Return the order."""
        return "the number of derivatives"

    def cost(self, model: NDArray[np.float64]) -> str:
        """Return the number of derivatives."""
        return f"{int(model[kernel.DEGREE])} derivatives of some 10 products each"

    def bound(self, settings: Settings) -> str:
        """Return the tolerance."""
        return f"{settings.tolerance:g} of the state's scale over a control step"


def _phase(support: Support) -> float:
    """Return the largest product of a rate and the sample interval."""
    return fastest_rate(support) * support.sample_interval


def degree_of(phase: float, tolerance: float) -> int:
    """Return the lowest degree n at which what is cut off is below a part of the tolerance.

    In a free motion its first term is at most phase**(n + 1) / (n + 1)!, and each next one smaller
    by a factor of phase / (n + 2) or less. From rest a force moves the carriage by phase**2 / 2
    only, of which the first term is 2 phase**(n - 1) / (n + 1)!.
    """
    n = 2
    while _first_left_out(phase, n) > MARGIN * tolerance * (1.0 - phase / (n + 2)):
        n += 1
    return n


def _first_left_out(phase: float, n: int) -> float:
    """Return the first term beyond degree n, relative to the motion."""
    return max(phase**2, 2.0) * phase ** (n - 1) / math.factorial(n + 1)
