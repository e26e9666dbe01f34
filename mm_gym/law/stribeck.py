"""Friction that falls with the slip velocity (Stribeck), regularised at rest.

    F = F_N (mu2 + (mu1 - mu2) exp(-(w / v_s)^2)) w / sqrt(w^2 + v_r^2) + chi w

Armstrong-Helouvry, Dupont and Canudas de Wit, *Automatica* 30 (1994), eq. 5, with the sign of w
replaced by a smooth function. The sphere never quite sticks: at rest the friction is a damper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import exp_of
from mm_gym.lanes.simd import alike, root
from mm_gym.lanes.simd_masks import smaller, where
from mm_gym.law.interface import Interface

if TYPE_CHECKING:
    from collections.abc import Sequence

PARAMETERS = (
    *("static_coefficient", "kinetic_coefficient", "reference_velocity"),
    *("stribeck_velocity", "slip_damping", "normal_force"),
)

STEEPEST = 0.858
"""Largest slope of exp(-x^2), the root of 2 / e."""


@inlined_kernel
def force(p, offset, slip, own):  # noqa: ARG001 - as of every interface
    """Return the force [N] on the carriage at a slip velocity [m/s]."""
    static, kinetic, vr, vs, chi, normal = p[0], p[1], p[2], p[3], p[4], p[5]
    part = slip / vs
    coefficient = fma(static - kinetic, exp_of(-part * part), kinetic)
    return slip * fma(normal, coefficient / root(fma(slip, slip, vr * vr)), chi)


@inlined_kernel
def resolves(p, before, after, way):
    """Tell whether a step sees the force turn round at v_r, and fall at v_s."""
    nearest = where(before * after > 0.0, smaller(abs(before), abs(after)), alike(before, 0.0))
    return abs(after - before) <= way * (smaller(p[2], p[3]) + nearest)


def damping(p: Sequence[float]) -> float:
    """Return a bound of its slope [N s/m]."""
    static, kinetic, vr, vs, chi, normal = p
    return normal * (static / vr + STEEPEST * (static - kinetic) / vs) + chi


STRIBECK = Interface(
    "stribeck",
    PARAMETERS,
    force,
    resolves=resolves,
    is_bent=True,
    damping=damping,
    rising=frozenset(PARAMETERS) - {"kinetic_coefficient", *PARAMETERS[2:4]},
)
