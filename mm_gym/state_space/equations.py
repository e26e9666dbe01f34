"""The linear equations of motion as matrices (docs/model.md, eqs 1-2).

The arithmetic is that of the values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from decimal import Decimal

    from numpy.typing import NDArray

    Values = dict[str, Decimal]


class StateSpace(NamedTuple):
    """x' = A x + force * u + ground * a_g with the state x1, x2, v1, v2, as arrays of `Decimal`."""

    a: NDArray[np.object_]
    force: NDArray[np.object_]
    ground: NDArray[np.object_]


def state_space(p: Values) -> StateSpace:
    """Return the matrices for m1, m2, k1 (times alpha), d, c and k2."""
    m1, m2, k1, d, c, k2 = (p[name] for name in ("m1", "m2", "k1", "d", "c", "k2"))
    zero, one = 0 * m1, m1 / m1
    a = [
        [zero, zero, one, zero],
        [zero, zero, zero, one],
        [-(k1 + k2) / m1, k2 / m1, -(c + d) / m1, c / m1],
        [k2 / m2, -k2 / m2, c / m2, -c / m2],
    ]
    force = [zero, zero, one / m1, zero]
    ground = [zero, zero, -one, -one]
    return StateSpace(*(np.array(x, dtype=object) for x in (a, force, ground)))


def slip_space(p: Values) -> StateSpace:
    """Return the same equations for the state x1, x2 - x1, v1, v2 - v1.

    No digits of a small slip cancel in it.
    """
    m1, m2, k1, d, c, k2 = (p[name] for name in ("m1", "m2", "k1", "d", "c", "k2"))
    zero, one = 0 * m1, m1 / m1
    both = one / m1 + one / m2
    a = [
        [zero, zero, one, zero],
        [zero, zero, zero, one],
        [-k1 / m1, k2 / m1, -d / m1, c / m1],
        [k1 / m1, -k2 * both, d / m1, -c * both],
    ]
    force = [zero, zero, one / m1, -one / m1]
    ground = [zero, zero, -one, zero]
    return StateSpace(*(np.array(x, dtype=object) for x in (a, force, ground)))
