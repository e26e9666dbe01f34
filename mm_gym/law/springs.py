"""The springs between sphere and carriage: linear, small on large or of finite stretch.

They are (5), (6) and (10) of docs/model.md, over every kind of number.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import inlined_kernel
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.simd_masks import larger, where

LINEAR = -1.5874010519681994
"""Stretch of linear springs, minus the cube root of 4: with it, (5) is k2 = k0 to one rounding."""

LONGEST_WAY = 2.0
"""Of a step, in units of what is left of the way to a spring's collapse."""


@inlined_kernel
def stiffness(k0, stretch):
    """Return k2 [N/m] of springs small on large; of springs of finite stretch, at the middle."""
    return 2 * k0 * (1 + 2 / (stretch * stretch * stretch))  # (5), eqs 15 and 16 of the paper


@inlined_kernel
def spring_force(k0, l0, stretch, offset):
    """Return the force [N] of the sphere's springs on the carriage; l0 is 0 if small on large."""
    if k0 == 0.0:
        return 0.0  # and not -0.0
    if l0 == 0.0:
        return stiffness(k0, stretch) * offset
    return pair_force(2.0 * k0, stretch, offset, offset / l0)


@inlined_kernel
def pair_force(twice_k0, stretch, offset, shortened):
    """Return the force [N] of the neo-Hookean pair on the carriage; `shortened` is offset / l0.

    There is no difference of the two sides' nearly equal stretches in it. A collapsed spring has no
    number as its force.
    """
    by = _by_product(stretch, shortened)
    return twice_k0 * offset * fma(stretch + stretch, by * by, 1.0)  # (6)


@inlined_kernel
def pair_slope(stretch, shortened):
    """Return the slope of that force over the offset, over 2 k0."""
    by, square = _by_product(stretch, shortened), shortened * shortened
    return fma((stretch + stretch) * (by * by), fma(4.0 * square, by, 1.0), 1.0)


@inlined_kernel
def pair_bend(stretch, shortened):
    """Return a sixth of its third derivative, over 2 k0 / l0^2."""
    by = _by_product(stretch, shortened)
    rise = shortened * shortened * by
    return 4.0 * stretch * (by * by * by) * fma(fma(16.0, rise, 12.0), rise, 1.0)


@inlined_kernel
def _by_product(stretch, shortened):
    """Return one over the product of both sides' stretches; of a collapsed spring no number."""
    product = fma(-shortened, shortened, stretch * stretch)
    return 1.0 / where(product > 0.0, product, math.nan)


@inlined_kernel
def spring_energy(k0, l0, stretch, offset):
    """Return the energy [J] of the sphere's springs in excess of the centred sphere's.

    The integral of `spring_force` over the offset, without differences of nearly equal numbers.
    """
    shortened = (offset / l0) ** 2 if l0 else 0.0
    return k0 * offset**2 * (1.0 + 2.0 / (stretch * (stretch**2 - shortened)))  # (10)


@inlined_kernel
def is_resolved(by_l0, stretch, before, after):
    """Tell whether a step sees the force of springs of finite stretch rise towards a collapse.

    It grows with the inverse square of what is left of the way to the collapse, so a step's way
    must not be much longer than that. `by_l0` is 1 / l0 [1/m]; the offsets [m] are those before and
    after the step.
    """
    left = stretch - by_l0 * larger(abs(before), abs(after))
    return by_l0 * abs(after - before) <= LONGEST_WAY * left
