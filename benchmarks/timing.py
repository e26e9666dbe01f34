"""Timing side by side: candidates take turns, so that disturbances affect all alike."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Timing:
    """Seconds per unit of work of one candidate, one value per round."""

    name: str
    seconds: NDArray[np.float64]

    @property
    def median(self) -> float:
        """Median seconds per unit of work."""
        return float(np.median(self.seconds))

    @property
    def spread(self) -> float:
        """Half the interquartile range, relative to the median."""
        low, high = np.quantile(self.seconds, [0.25, 0.75])
        return float((high - low) / 2.0 / self.median)

    @property
    def fastest(self) -> float:
        """Least seconds per unit of work: what other processes disturbed least."""
        return float(self.seconds.min())

    def times_faster_than(self, other: Timing) -> float:
        """Return the median over rounds of the other's time over this one's."""
        return float(np.median(other.seconds / self.seconds))


def side_by_side(
    candidates: Mapping[str, Callable[[], object]],
    *,
    work: Mapping[str, float] | None = None,
    rounds: int = 15,
    seconds: float = 0.05,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Time candidates in turns.

    Parameters
    ----------
    candidates
        Name -> function without arguments; set-up belongs outside.
    work
        Units of work that one call does; by default one.
    rounds
        Number of turns of each candidate.
    seconds
        Duration of one turn [s], from which the number of calls in it follows.
    clock
        What tells the time [s].
    """
    calls = {name: _calls_for(function, seconds, clock) for name, function in candidates.items()}
    measured: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, function in candidates.items():
            measured[name].append(_time(function, calls[name], clock) / calls[name])
    units = work or {}
    return {
        name: Timing(name, np.array(values) / units.get(name, 1.0))
        for name, values in measured.items()
    }


def _calls_for(function: Callable[[], object], seconds: float, clock: Callable[[], float]) -> int:
    """Warm up, then return the number of calls that take about the given time [s]."""
    began = clock()
    while clock() - began < seconds:
        function()
    calls = 1
    while (taken := _time(function, calls, clock)) < seconds / 4.0:
        calls *= 2
    return max(1, round(calls * seconds / taken))


def _time(function: Callable[[], object], calls: int, clock: Callable[[], float]) -> float:
    began = clock()
    for _ in range(calls):
        function()
    return clock() - began
