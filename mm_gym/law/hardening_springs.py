"""Linear springs with a cubic term, in value form: a part of the interface that they act with.

    s = k2 (1 + gamma xi^2) xi

with the offset xi. Gamma is at least 0: springs that soften would let the sphere escape.
"""

from __future__ import annotations

from functools import cache

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.interface import Interface, zero

CUBIC = "springs.cubic_coefficient"
PARAMETERS = ("springs.stiffness", CUBIC)


@inlined_kernel
def _viscous(p, offset, slip, own):  # noqa: ARG001 - as of every interface
    return p[0] * slip


LINES = {
    "none": Interface("none", (), zero),
    "viscous": Interface(
        "viscous", ("damping",), _viscous, damping=lambda p: p[0], rising=frozenset({"damping"})
    ),
}
"""By kind: interfaces without springs that harden have no need of a value form."""


@cache
def with_hardening_springs(interface: Interface) -> Interface:
    """Return an interface with such springs in parallel; their parameters follow its own."""
    first = len(interface.parameters)
    between, stored = interface.force, interface.energy

    @inlined_kernel
    def springs(p, offset, slip, own):  # noqa: ARG001 - as of every interface
        return p[first] * fma(p[first + 1] * offset, offset, 1.0) * offset

    @inlined_kernel
    def force(p, offset, slip, own):
        return between(p, offset, slip, own) + springs(p, offset, slip, own)

    @inlined_kernel
    def energy(p, offset, slip, own):
        square = offset * offset
        own_share = 0.5 * p[first] * square * fma(0.5 * p[first + 1], square, 1.0)
        return stored(p, offset, slip, own) + own_share

    return Interface(
        interface.kind,
        (*interface.parameters, *PARAMETERS),
        force,
        interface.states,
        interface.rates,
        energy,
        springs=springs,
        resolves=interface.resolves,
        is_bent=interface.is_bent,
        damping=lambda p: interface.damping(p[:first]),
        stiffness=lambda p: interface.stiffness(p[:first]) + p[first],
        rising=interface.rising | {PARAMETERS[0]},
    )
