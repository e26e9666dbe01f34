"""The coefficients of one lane in decimal arithmetic, and its linear equations."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import TYPE_CHECKING

from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout as at
from mm_gym.law import dry_friction, springs
from mm_gym.state_space.equations import StateSpace, state_space
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def values_of(row: NDArray[np.float64]) -> dict[str, Decimal]:
    """Return m1, m2, k1 (times alpha), d, c and k2 of one lane.

    Doubles enter as the decimals that they exactly are.
    """
    m1, m2, k1, d, alpha, c, k0, stretch = (
        Decimal(float(row[i]))
        for i in (at.M1, at.M2, at.K1, at.D, at.ALPHA, at.C, at.K0, at.STRETCH)
    )
    mu1, normal, vr = (Decimal(float(row[i])) for i in (at.MU1, at.FN, at.VR))
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        k2 = plain(springs.stiffness)(k0, stretch)
        c = plain(dry_friction.stick_slope)(mu1, normal, vr) if vr else c
        return {"m1": m1, "m2": m2, "k1": k1 * alpha, "d": d, "c": c, "k2": k2}


def linear_system(row: NDArray[np.float64]) -> StateSpace:
    """Return the linear equations of one lane; dry friction enters with its slope in stick."""
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        return state_space(values_of(row))
