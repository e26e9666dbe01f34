"""Runge-Kutta pairs as the kernel reads them: SciPy's coefficients, in the form of Nystroem.

Velocities are the rates of the positions, so the accelerations of the stages suffice: where a
pair's weights are A, positions take those of A squared (Hairer, Norsett and Wanner, *Solving
Ordinary Differential Equations I*, 1993, II.14).
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Tableau(NamedTuple):
    """A pair of methods; the last stage is the end of the step.

    Attributes
    ----------
    times
        (stages,) of each stage, in steps.
    weights
        (stages, stages) of the accelerations in a stage's velocity, times h.
    errors
        (2, stages) of two estimates of the velocity's error.
    is_combined
        Whether the error is that of eighth order from both, or the first alone.
    """

    times: NDArray[np.float64]
    weights: NDArray[np.float64]
    errors: NDArray[np.float64]
    is_combined: bool

    @property
    def stages(self) -> int:
        """Number of the stages before the end."""
        return len(self.times) - 1

    def slots(self) -> NDArray[np.float64]:
        """Return the times and weights in the order of `mm_gym.methods.runge_kutta.layout`."""
        pairs = np.stack([self.weights, self.weights @ self.weights], axis=-1)
        errors = np.stack([self.errors, self.errors @ self.weights], axis=-1)
        stages = [np.append(time, pairs[i, :i]) for i, time in enumerate(self.times)]
        return np.concatenate([*stages, errors.ravel()])

    def estimates(self, phase: float) -> tuple[float, float]:
        """Return both estimates of the error on an undamped oscillation, relative to its velocity.

        Parameters
        ----------
        phase
            Angle that it turns by in the step [rad].
        """
        turn = 1j * phase
        rates = np.linalg.solve(
            np.eye(len(self.times)) - turn * self.weights, turn + 0 * self.times
        )
        first, second = np.abs(self.errors @ rates)
        if self.is_combined:
            first = first * first / math.hypot(first, 0.1 * second)
        return float(first), float(second)

    def longest(self, limit: float, part: float = 1.0) -> float:
        """Return the phase [rad] up to which the first estimate is below a limit.

        And the second below a part of what it then is.
        """
        phase = self._up_to(0, limit)
        return phase if part == 1.0 else self._up_to(1, part * self.estimates(phase)[1])

    def _up_to(self, k: int, limit: float) -> float:
        """Return the phase at which one of the estimates reaches a limit, by bisection."""
        low, high = 0.0, math.pi
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.estimates(middle)[k] < limit else (low, middle)
        return low


@cache
def tableaus() -> tuple[Tableau, ...]:
    """Return the pairs of Bogacki and Shampine, 3(2), and Dormand and Prince, 5(4) and 8(5, 3)."""
    from scipy.integrate import DOP853, RK23, RK45  # noqa: PLC0415 - other methods need none

    return (
        _tableau(RK23, RK23.E, nodes=[0, 1, 3]),
        _tableau(RK45, RK45.E, nodes=[0, 2, 3, 6]),
        _tableau(DOP853, DOP853.E5, other=DOP853.E3),
    )


def _tableau(
    pair: type[Any],
    error: NDArray[np.float64],
    *,
    other: NDArray[np.float64] | None = None,
    nodes: Sequence[int] = (),
) -> Tableau:
    """Return a pair; without another estimate, the difference from a quadrature of some stages."""
    weights = np.zeros((pair.n_stages + 1, pair.n_stages + 1))
    weights[:-1, : pair.A.shape[1]], weights[-1, :-1] = pair.A, pair.B
    times = np.append(pair.C, 1.0)
    if other is not None:
        return Tableau(times, weights, np.stack([error, other]), is_combined=True)
    powers, second = np.arange(len(nodes)), weights[-1].copy()
    second[nodes] -= np.linalg.solve(times[nodes] ** powers[:, None], 1.0 / (powers + 1.0))
    return Tableau(times, weights, np.stack([error, second]), is_combined=False)
