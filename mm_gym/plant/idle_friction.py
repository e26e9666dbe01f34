"""Dry friction that provably never slips, replaced by the viscous interface that it equals."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import refuse
from mm_gym.lanes import layout
from mm_gym.law import dry_friction, springs
from mm_gym.methods.support import Support

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene

FRICTION = (layout.MU1, layout.MU2, layout.VR, layout.CHI, layout.FN)
"""Rows of the parameters of dry friction."""


def without_idle_friction(scene: Scene, support: Support) -> tuple[Support, tuple[str, ...]]:
    """Return a support without dry friction that never slips, and the reason, if there is any."""
    low, high = support.low, support.high
    driven = scene.excitation or {"force", "stretch"} & set(scene.actuation.names)
    fixed = all(support.fixed(row) for row in FRICTION)
    known = high[layout.L0] == 0.0 and low[layout.M1] > 0.0 and fixed
    if not support.slips or driven or scene.solver.method == "switched" or not known:
        return support, ()
    fastest, vr = _fastest_slip(support), low[layout.VR]
    if not fastest < vr:
        return support, ()
    damping = plain(dry_friction.stick_slope)(low[layout.MU1], low[layout.FN], vr)
    arrays: dict[str, Array] = {}
    for name in ("start_low", "start_high", "low", "high"):
        arrays[name] = getattr(support, name).copy()
        arrays[name][list(FRICTION)] = 0.0
        arrays[name][layout.C] = damping
    reason = (
        f"dry friction never slips: by its energy |w| <= {fastest:.3g} m/s, below "
        f"interface.reference_velocity = {vr:g} m/s, so it is viscous with {damping:.6g} N s/m"
    )
    stated = {row: float(low[row]) for row in FRICTION}
    return replace(support, idle=stated, **arrays), (reason,)


REMEDY = (
    "because no motion of this scene slips, and its plant has no friction in slip. Widen the "
    "ranges of initial to such states, or set solver.method = 'switched'"
)
"""What follows where a state in slip is refused."""

ROUND_OFF = 1e-9  # part of the reference velocity that the round-off of energies may come to


def require_stick(support: Support, values: Array, where: str) -> None:
    """Raise `SceneError` for states from which friction might slip that is left out of the plant.

    They are those of `values` (rows, lanes); `where` is what is refused, as the message names it.
    By its energy, which cannot grow, each state of the scene itself stays below the reference
    velocity.
    """
    limit = support.idle_velocity
    if limit == np.inf:
        return
    rows = (layout.M1, layout.M2, layout.K1, layout.ALPHA, layout.BETA, layout.K0, layout.STRETCH)
    m1, m2, k1, alpha, beta, k0, stretch = (values[row] for row in rows)
    x1, x2, v1, v2 = values[:4]
    with np.errstate(over="ignore"):
        twice = m1 * v1**2 + m2 * v2**2 + plain(springs.stiffness)(k0, stretch) * (x2 - x1) ** 2
        twice += k1 * (alpha * x1**2 + 0.5 * beta * x1**4)
        wells = (alpha < 0.0) & (beta > 0.0)
        depth = np.divide(alpha**2, beta, out=np.zeros_like(beta), where=wells)
        fastest = _slip_of(twice + 0.5 * k1 * depth, m1, m2)
    wrong = np.flatnonzero(~(fastest <= limit * (1.0 + ROUND_OFF)))
    if wrong.size:
        refuse(
            where,
            f"a state whose energy lets the sphere slip at up to {fastest[wrong[0]]:.3g} m/s",
            f"below interface.reference_velocity = {limit:g} m/s, {REMEDY}",
        )


def _slip_of(twice: Array, m1: Array, m2: Array) -> Array:
    """Return the largest |w| [m/s] of masses that have twice an energy [J]."""
    return np.sqrt(np.maximum(twice, 0.0) * (1.0 / m1 + 1.0 / m2))


def _fastest_slip(support: Support) -> float:
    """Return a bound of |w| [m/s] from the largest initial energy, which cannot grow.

    It is infinite if the energy of the carriage's spring has no lower bound.
    """
    low, high = support.low, support.high
    x1, offset, v1, v2 = (
        max(abs(support.start_low[row]), abs(support.start_high[row])) for row in range(4)
    )
    twice = high[layout.M1] * v1**2 + high[layout.M2] * v2**2 + support.stiffest * offset**2
    twice += high[layout.K1] * max(
        0.0, high[layout.ALPHA] * x1**2 + 0.5 * high[layout.BETA] * x1**4
    )
    alpha, beta = low[layout.ALPHA], low[layout.BETA]
    if beta < 0.0 or (alpha < 0.0 and beta == 0.0):
        return np.inf
    if alpha < 0.0:
        twice += 0.5 * high[layout.K1] * alpha**2 / beta  # the depth of the wells, below the middle
    return float(_slip_of(twice, low[layout.M1], low[layout.M2]))
