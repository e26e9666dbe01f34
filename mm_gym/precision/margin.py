"""The margin between the largest error that was sampled and those that are still to come."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST = 20
"""Errors that the tail is fitted to, of few a quarter."""

RETURN = 100.0
"""How many times rarer than the largest sampled error an error above the margin is to be."""

LEAST = 2.0
"""Least margin."""

UNKNOWN = 10.0
"""Margin where there is but one error, and no spread."""


def margin(errors: NDArray[np.float64]) -> float:
    """Return the factor on the largest of (n,) errors that later errors hardly exceed.

    Above the (k + 1)-th largest error, log(error) is taken to be exponentially distributed with the
    mean g that the k larger ones have (Hill, *A simple general approach to inference about the tail
    of a distribution*, Ann. Statist. 3, 1975). An error is then larger than the largest of n with
    a probability of about 1 / n, and r times rarer if it is to be larger by r^g.
    """
    if errors.size == 1:
        return UNKNOWN
    count = min(LARGEST, max(1, errors.size // 4))
    ordered = np.sort(errors)[::-1][: count + 1]
    if not (np.isfinite(ordered).all() and ordered[-1] > 0.0):
        return UNKNOWN
    with np.errstate(over="ignore"):  # an infinite margin says that nothing is known of the tail
        return float(max(LEAST, RETURN ** np.log(ordered[:-1] / ordered[-1]).mean()))
