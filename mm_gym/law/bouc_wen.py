"""Hysteresis after Bouc and Wen: the interface's force depends on its own past.

    F = c w + a k xi + (1 - a) k u_y z
    z' = (w - |z|^n (b |w| sgn z + (1 - b) w)) / u_y

with the offset xi and its own state z, -1 <= z <= 1. Y. K. Wen, *Method for random vibration of
hysteretic systems*, J. Eng. Mech. Div. ASCE 102 (1976). With b >= 1/2 it never gives more energy
than it has taken: Erlicher and Point, Comptes Rendus Mecanique 332 (2004).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import power
from mm_gym.lanes.simd import alike
from mm_gym.lanes.simd_masks import where
from mm_gym.law.interface import Interface

if TYPE_CHECKING:
    from collections.abc import Sequence

PARAMETERS = (
    *("damping", "stiffness", "stiffness_ratio"),
    *("yield_displacement", "exponent", "shape"),
)


@inlined_kernel
def force(p, offset, slip, own):
    """Return the force [N] on the carriage at an offset [m], a slip velocity [m/s] and a z."""
    c, k, ratio, yielding = p[0], p[1], p[2], p[3]
    return fma(c, slip, k * fma(ratio, offset, (1.0 - ratio) * yielding * own[0]))


@inlined_kernel
def rates(p, offset, slip, own):  # noqa: ARG001 - as of every interface
    """Return the rate [1/s] of z, and 0."""
    yielding, exponent, shape = p[3], p[4], p[5]
    bent = power(abs(own[0]), exponent)
    resisting = where(own[0] < 0.0, -abs(slip), abs(slip))
    return (slip - bent * fma(shape, resisting - slip, slip)) / yielding, alike(slip, 0.0)


@inlined_kernel
def energy(p, offset, slip, own):  # noqa: ARG001 - as of every interface
    """Return the energy [J] that it can give back."""
    k, ratio, yielding = p[1], p[2], p[3]
    strain = yielding * own[0]
    return 0.5 * k * (ratio * offset * offset + (1.0 - ratio) * strain * strain)


def damping(p: Sequence[float]) -> float:
    """Return the slope over the slip velocity [N s/m]."""
    return p[0]


def stiffness(p: Sequence[float]) -> float:
    """Return a bound of the slope over the offset [N/m]: steepest where it is unloaded."""
    return p[1] * max(1.0, 2.0 * p[5])


BOUC_WEN = Interface(
    "bouc_wen",
    PARAMETERS,
    force,
    ("z",),
    rates,
    energy,
    damping=damping,
    stiffness=stiffness,
    rising=frozenset({"damping", "stiffness", "shape"}),
)
