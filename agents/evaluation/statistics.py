"""The bootstrap interval of a cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

RESAMPLES = 10_000


def interval(penalties: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % interval of the cost: the bootstrap's percentiles over episodes.

    Parameters
    ----------
    penalties
        (episodes,) as in `Evaluation`; the cost is the root of their mean.
    """
    drawn = np.random.default_rng(0).integers(penalties.size, size=(RESAMPLES, penalties.size))
    means: NDArray[np.float64] = penalties[drawn].mean(axis=1)
    low, high = np.sqrt(np.percentile(means, (2.5, 97.5)))
    return float(low), float(high)
