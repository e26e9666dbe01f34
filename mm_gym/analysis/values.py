"""The numbers of a scene that analysis works with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.errors import SceneError
from mm_gym.lanes import layout as at
from mm_gym.law import dry_friction, springs
from mm_gym.plant.linearise import interface_slopes
from mm_gym.plant.support_of import support_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene


class Linear(NamedTuple):
    """Coefficients about rest: masses [kg], stiffnesses [N/m], dampings [N s/m]."""

    m1: float
    m2: float
    k1: float
    k2: float
    c: float
    d: float


def row_of(scene: Scene, what: str) -> NDArray[np.float64]:
    """Return the lane (rows,) that the scene starts as; raise `SceneError` for a range."""
    support = support_of(scene)
    drawn = [
        name
        for name, row in support.names.items()
        if support.start_low[row] != support.start_high[row]
    ]
    if drawn:
        msg = f"{drawn[0]}: got a range; {what} needs one value for every field"
        raise SceneError(msg)
    if support.is_general:
        msg = (
            f"{support.general_because}; allowed: interface.kind 'none', 'viscous', "
            f"'dry_friction' and springs without cubic_coefficient, for which {what} is known"
        )
        raise SceneError(msg)
    row = support.start_low.copy()
    row[at.X2] += row[at.X1]
    plain(dry_friction.write_regimes)(row[:, None], 0, 1)
    return row


def linear_values(scene: Scene) -> Linear:
    """Return the coefficients: the middle of each range, friction with its slope in stick."""
    support = support_of(scene)
    p = support.middle
    p[at.X1 : at.V2 + 1] = 0.0
    plain(dry_friction.write_regimes)(p[:, None], 0, 1)
    link = interface_slopes(support, p)
    return Linear(
        m1=float(p[at.M1]),
        m2=float(p[at.M2]),
        k1=float(p[at.K1] * p[at.ALPHA]),
        k2=float(plain(springs.stiffness)(p[at.K0], p[at.STRETCH])) + link.stiffness,
        c=float(p[at.C]) + link.damping,
        d=float(p[at.D]),
    )


def characteristic(values: Linear) -> NDArray[np.float64]:
    """Return g4 .. g0 of det(M s^2 + C s + K), eq. 13 of docs/model.md."""
    m1, m2, k1, k2, c, d = values
    return np.array(
        [m1 * m2, m1 * c + m2 * (c + d), m1 * k2 + c * d + m2 * (k1 + k2), d * k2 + c * k1, k1 * k2]
    )
