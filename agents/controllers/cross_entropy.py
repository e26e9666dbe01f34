"""The cross-entropy method: a search for the best plan of actions by random trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Values


@dataclass(frozen=True, kw_only=True)
class Search:
    """Search for plans by the cross-entropy method.

    De Boer et al., *A tutorial on the cross-entropy method*, Ann. Oper. Res. 134 (2005).

    Attributes
    ----------
    horizon
        Control steps planned ahead.
    plans, elite, rounds
        Plans tried at once, those that the next are drawn around, and repetitions.
    kept
        Best plans that are tried again in the next round, at most `elite`.
    spread, least_spread
        Standard deviation of the first plans' actions, and the least later on [-].
    """

    horizon: int
    plans: int
    elite: int
    rounds: int
    kept: int
    spread: float
    least_spread: float = 0.0

    def best(
        self, first: Values, worth: Callable[[Values], Values], drawn: Callable[[], Values]
    ) -> Values:
        """Return the best plan (steps, lanes, k) of the first ones and of those drawn.

        Parameters
        ----------
        first
            (steps, lanes, count, k) plans to begin with, the likeliest first; actions in -1 to 1.
        worth
            Returns the sums of rewards (lanes, plans) of plans (steps, lanes, plans, k).
        drawn
            Returns the noise (steps, lanes, plans, k) of a round's plans, see `Noise`.
        """
        rows = np.arange(first.shape[1])[:, None]
        mean, kept = first[:, :, 0], first
        spread = np.full(mean.shape, self.spread)
        for _ in range(self.rounds):
            plans = mean[:, :, None] + spread[:, :, None] * drawn()
            plans[:, :, : kept.shape[2]] = kept
            np.clip(plans, -1.0, 1.0, out=plans)
            order = np.argsort(-worth(plans), axis=1)[:, : self.elite]
            elite = plans[:, rows, order]
            kept, mean = elite[:, :, : self.kept], elite.mean(axis=2)
            spread = np.maximum(elite.std(axis=2), self.least_spread)
        return kept[:, :, 0]
