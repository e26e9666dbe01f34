"""Cubics between two instants, from values and rates at both (Hermite)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Cubic(NamedTuple):
    """A quantity over intervals: q(s) = c0 + c1 s + c2 s^2 + c3 s^3, with s from 0 to 1.

    Between the instants it is right to the fourth order in their spacing. For a vibration at w, the
    spacing h leaves (w h)^4 / 384 of the amplitude: 4e-4 for 16 instants a period.
    """

    c0: Array
    c1: Array
    c2: Array
    c3: Array

    def at(self, s: Array) -> Array:
        """Return the values at s."""
        return self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3))

    def turns(self) -> tuple[Array, Array]:
        """Return where the rate is zero within the interval, else its end, as two arrays of s."""
        a, b, c = 3.0 * self.c3, 2.0 * self.c2, self.c1
        inner = np.maximum(b * b - 4.0 * a * c, 0.0)
        q = -0.5 * (b + np.copysign(np.sqrt(inner), b))  # without a difference of equal numbers
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = q / a, c / q
        first, second = (np.where((s > 0.0) & (s < 1.0), s, 1.0) for s in roots)
        return np.minimum(first, second), np.maximum(first, second)

    def peak(self) -> Array:
        """Return the largest magnitude."""
        ones = np.ones_like(self.c0)
        inner = [np.abs(self.at(s)) for s in (*self.turns(), ones)]
        return np.maximum.reduce([np.abs(self.c0), *inner])

    def variation(self) -> Array:
        """Return how far it goes, there and back: the integral of the magnitude of its rate."""
        first, second = self.turns()
        stops = [self.c0, self.at(first), self.at(second), self.at(np.ones_like(self.c0))]
        return np.abs(np.diff(stops, axis=0)).sum(axis=0)

    def mean_square(self) -> Array:
        """Return the mean of the square over the interval."""
        c0, c1, c2, c3 = self
        return (
            c0 * (c0 + c1 + 2.0 / 3.0 * c2 + 0.5 * c3)
            + c1 * (c1 / 3.0 + 0.5 * c2 + 0.4 * c3)
            + c2 * (0.2 * c2 + c3 / 3.0)
            + c3 * c3 / 7.0
        )


def cubic(start: tuple[Array, Array], end: tuple[Array, Array], duration: Array | float) -> Cubic:
    """Return the cubic of given value and rate at the start and at the end of a duration [s]."""
    (q0, r0), (q1, r1) = start, end
    r0, r1, change = r0 * duration, r1 * duration, q1 - q0
    return Cubic(q0, r0, 3.0 * change - 2.0 * r0 - r1, r0 + r1 - 2.0 * change)
