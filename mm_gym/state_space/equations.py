"""The linear equations of motion as matrices (docs/model.md, eqs 1-2).

The arithmetic is that of the values.
"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law import dry_friction, springs
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS

Values = dict[str, Decimal]


class StateSpace(NamedTuple):
    """x' = A x + force * p + ground * a_g + pair * u with the state x1, x2, v1, v2, in `Decimal`.

    The pair of forces acts between the masses: u on the carriage, -u on the sphere.
    """

    a: NDArray[np.object_]
    force: NDArray[np.object_]
    ground: NDArray[np.object_]
    pair: NDArray[np.object_]

    def control(self, *, is_between: bool) -> NDArray[np.object_]:
        """Return the column (4,) of the control force."""
        return self.pair if is_between else self.force


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
    ground, pair = [zero, zero, -one, -one], [zero, zero, one / m1, -one / m2]
    return StateSpace(*(np.array(x, dtype=object) for x in (a, force, ground, pair)))


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
    ground, pair = [zero, zero, -one, zero], [zero, zero, one / m1, -both]
    return StateSpace(*(np.array(x, dtype=object) for x in (a, force, ground, pair)))


def values_of(row: Array) -> dict[str, Decimal]:
    """Return m1, m2, k1 (times alpha), d, c and k2 of one lane.

    Doubles enter as the decimals that they exactly are.
    """
    masses, own = (layout.M1, layout.M2), (layout.K1, layout.ALPHA, layout.D)
    m1, m2, k1, alpha, d = (Decimal(float(row[i])) for i in masses + own)
    c, k0, stretch = (Decimal(float(row[i])) for i in (layout.C, layout.K0, layout.STRETCH))
    mu1, normal, vr = (Decimal(float(row[i])) for i in (layout.MU1, layout.FN, layout.VR))
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        k2 = plain(springs.stiffness)(k0, stretch)
        c = plain(dry_friction.stick_slope)(mu1, normal, vr) if vr else c
        return {"m1": m1, "m2": m2, "k1": k1 * alpha, "d": d, "c": c, "k2": k2}
