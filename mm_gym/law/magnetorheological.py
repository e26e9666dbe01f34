"""A magnetorheological damper, driven by a voltage: the modified Bouc-Wen model.

    F = c1 y' + k1 (x - x0)
    c1 y' = alpha z + k0 (x - y) + c0 (x' - y')
    z' = A r' - gamma |r'| z |z| - beta r' z^2,  r' = x' - y'
    alpha, c0 and c1 = a + b u each

with the offset x, the slip velocity x', the voltage u, and states y and z of its own. Spencer,
Dyke, Sain and Carlson, *Phenomenological model for magnetorheological dampers*, J. Eng. Mech. 123
(1997) 230-238, whose exponent is 2. At a constant voltage, with |beta| <= gamma, it never gives
more energy than it has taken: z r' = (z^2 / 2)' / A + (gamma |r'| |z| + beta r' z) z^2 / A.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.interface import Interface

if TYPE_CHECKING:
    from collections.abc import Sequence

PARAMETERS = (
    *("voltage", "damping", "damping_per_volt", "series_damping", "series_damping_per_volt"),
    *("hysteresis", "hysteresis_per_volt", "stiffness"),
    *("accumulator_stiffness", "accumulator_offset", "gain", "gamma", "beta"),
)


@inlined_kernel
def _flow(p, offset, slip, own):
    """Return y' [m/s], and c1 [N s/m]."""
    (y, z), u = own, p[0]
    c0, c1, alpha = fma(p[2], u, p[1]), fma(p[4], u, p[3]), fma(p[6], u, p[5])
    return fma(alpha, z, fma(p[7], offset - y, c0 * slip)) / (c0 + c1), c1


@inlined_kernel
def force(p, offset, slip, own):
    """Return the force [N] on the carriage at an offset [m], a slip velocity [m/s], y and z [m]."""
    flow, c1 = _flow(p, offset, slip, own)
    return fma(c1, flow, p[8] * (offset - p[9]))


@inlined_kernel
def rates(p, offset, slip, own):
    """Return the rates [m/s] of y and z."""
    z, gain, gamma, beta = own[1], p[10], p[11], p[12]
    flow, _ = _flow(p, offset, slip, own)
    sheared = slip - flow
    lost = fma(gamma * abs(sheared), abs(z), beta * sheared * z)
    return flow, fma(gain, sheared, -z * lost)


@inlined_kernel
def energy(p, offset, slip, own):  # noqa: ARG001 - as of every interface
    """Return the energy [J] that it can give back at this voltage."""
    z, strained, pressed = own[1], offset - own[0], offset - p[9]
    alpha = fma(p[6], p[0], p[5])
    springs = fma(p[7] * strained, strained, p[8] * pressed * pressed)
    return 0.5 * fma(alpha / p[10], z * z, springs)


def damping(p: Sequence[float]) -> float:
    """Return the slope over the slip velocity [N s/m] while y and z stay."""
    c0, c1 = p[1] + p[2] * p[0], p[3] + p[4] * p[0]
    return c0 * c1 / (c0 + c1)


def stiffness(p: Sequence[float]) -> float:
    """Return a bound of the slope over the offset [N/m]: that while y stays."""
    return (p[5] + p[6] * p[0]) * p[10] + p[7] + p[8]


MAGNETORHEOLOGICAL = Interface(
    "magnetorheological",
    PARAMETERS,
    force,
    ("y", "z"),
    rates,
    energy,
    is_bent=True,
    damping=damping,
    stiffness=stiffness,
    rising=frozenset(PARAMETERS),
)
