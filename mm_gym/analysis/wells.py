"""The wells of the carriage's spring, and what its energy allows, for any signs of its terms."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout as at
from mm_gym.law.carriage_spring import carriage_energy, carriage_force

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Spring(NamedTuple):
    """The carriage's spring, of force k1 (alpha + beta x1^2) x1: k1 [N/m], alpha [-], beta [1/m^2].

    Energies [J] are those of (9) of docs/model.md: 0 in the middle.
    """

    k1: float
    alpha: float
    beta: float

    @classmethod
    def of(cls, p: NDArray[np.float64]) -> Spring:
        """Return the spring of a lane (rows,)."""
        return cls(float(p[at.K1]), float(p[at.ALPHA]), float(p[at.BETA]))

    @property
    def place(self) -> float:
        """|x1| [m] where the force vanishes off the middle: wells, or a barrier; NaN if not."""
        if self.alpha * self.beta >= 0.0:
            return math.nan
        return math.sqrt(-self.alpha / self.beta)

    @property
    def is_bistable(self) -> bool:
        """Whether there are two wells, at `place`, about an unstable middle."""
        return self.alpha < 0.0 < self.beta

    @property
    def has_well(self) -> bool:
        """Whether any place holds the carriage: the middle, or one of two wells."""
        return self.alpha > 0.0 or self.beta > 0.0

    @property
    def least_energy(self) -> float:
        """Energy in the wells [J], 0 or less."""
        return -0.25 * self.k1 * self.alpha**2 / self.beta if self.is_bistable else 0.0

    def holds(self, x1: float, energy: float) -> bool:
        """Tell whether a carriage at x1 [m] stays in a well for ever with an energy [J] at most."""
        if self.beta >= 0.0:
            return self.beta > 0.0 or self.alpha >= 0.0
        barrier = -0.25 * self.k1 * self.alpha**2 / self.beta
        return self.alpha > 0.0 and abs(x1) < self.place and energy < barrier

    def largest_force(self, energy: float) -> float:
        """Return a bound of the force [N] on a carriage in a well with an energy [J] at most.

        Where the spring stiffens or is linear, the larger of what the linear and the cubic part
        alone allow; else the force at the ends of the displacements with so much energy, and in
        between at its extremum.
        """
        k1, alpha, beta = self
        if alpha >= 0.0 and beta >= 0.0:
            square = 2.0 * energy / (k1 * alpha) if alpha > 0.0 else math.inf
            if beta > 0.0:
                square = min(square, math.sqrt(4.0 * energy / (k1 * beta)))
            return k1 * (alpha + beta * square) * math.sqrt(square)
        # k1 (alpha u / 2 + beta u^2 / 4) = energy, u = x1^2; the root does not cancel.
        root = math.sqrt(max(0.0, alpha * alpha + 4.0 * beta * energy / k1))
        inner, outer = sorted(((-alpha - root) / beta, (-alpha + root) / beta))
        least, most = (max(inner, 0.0), outer) if self.is_bistable else (0.0, inner)
        extremum = -alpha / (3.0 * beta)
        squares = [least, most] + ([extremum] if least < extremum < most else [])
        return max(abs(self.force(math.sqrt(square))) for square in squares)

    def force(self, x1: float) -> float:
        """Return the force [N] that resists a displacement [m]."""
        return float(plain(carriage_force)(*self, x1))

    def energy(self, x1: float) -> float:
        """Return the energy [J] at a displacement [m]."""
        return float(plain(carriage_energy)(*self, x1))
