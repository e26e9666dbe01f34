"""Largest responses of damped oscillators to a recorded ground acceleration."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.errors import finite_numbers, refuse
from mm_gym.records.spectrum_kernel import TURN, write_peaks

MOST_DAMPING = 10.0  # largest damping ratio
MOST_PARTS = 1e10  # steps of the recurrence, at most: about a minute
EVEN = 2.0**-40  # rounding of a file's times, relative to them: what deviates less is evenly spaced


def peak_responses(times: Array, values: Array, periods: ArrayLike, damping: ArrayLike) -> Array:
    """Return the largest w^2 |x| and |absolute acceleration| (2, d, k) [m/s^2] of oscillators.

    They have periods (k,) [s] and damping ratios (d,). The ground's acceleration (n,) [m/s^2] is
    linear between increasing times (n,) [s], and zero before and after. `SceneError` refuses what
    is no period or ratio.
    """
    own, ratios = _numbers("periods", periods), _numbers("damping", damping)
    if not np.all(own > 0.0):
        refuse("periods", f"{own.min():g}", "greater than 0 s")
    if not np.all((ratios >= 0.0) & (ratios <= MOST_DAMPING)):
        got = ratios[(ratios < 0.0) | (ratios > MOST_DAMPING)][0]
        refuse("damping", f"{got:g}", f"a ratio from 0 to {MOST_DAMPING:g}")
    lasts = float(times[-1] - times[0])
    parts = 2.0 * np.pi * lasts * np.sum(1.0 / own) * np.sum(1.0 + 2.0 * ratios) / TURN
    if not parts <= MOST_PARTS:
        refuse(
            "periods",
            f"down to {own.min():g} s of a record of {lasts:g} s, which takes {parts:.1g} steps",
            f"{MOST_PARTS:.0g}. Leave out the shortest",
        )
    steps = np.diff(times)
    mean = lasts / len(steps)
    if np.all(np.abs(times - times[0] - mean * np.arange(len(times))) <= EVEN * times[-1]):
        steps = np.full(len(steps), mean)
    peaks = np.empty((2, len(ratios), len(own)))
    write_peaks(steps, np.array(values), own, ratios, peaks)
    return peaks


def _numbers(name: str, given: ArrayLike) -> Array:
    numbers = np.atleast_1d(finite_numbers(name, given))
    if numbers.ndim > 1 or not numbers.size:
        refuse(name, f"shape {numbers.shape}", "(n,) numbers")
    return numbers
