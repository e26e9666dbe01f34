"""The exponential as a cubic in the generator (Cayley-Hamilton), for an actuated stretch."""

from __future__ import annotations

import math
from decimal import Context, Decimal, localcontext
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.methods.base import ExactMethod, Settings, header
from mm_gym.methods.cayley_hamilton import kernel as ch
from mm_gym.methods.support import PARAMETRIC_LINEAR, fastest_rate
from mm_gym.state_space.equations import values_of
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support
    from mm_gym.state_space.equations import Values

LONGEST_STEP = 2.0
"""Largest product of the fastest rate and the sample interval h. The springs' part of its square,
k2 h^2 / m, is at most 4 and varies by at most 4 / 3 about its middle, so that term n of the
polynomials is at most (4 / 3)**n / (2 n)!: below round-off from the tenth on."""

DIGITS = 40  # decimal digits of the sums: enough for every digit of a double
ORDERS = 48  # number of powers of the generator in the sums; the last adds 2**48 / 48!, 1e-47

MOST_AMPLIFIED = 256.0
"""Largest ratio of the steady motion to the motion that the force causes from rest in one sample
interval: the difference of two steady motions loses this factor in precision."""


class CayleyHamilton(ExactMethod):
    """The exponential as a cubic in the generator, for an actuated stretch."""

    name = "exact"
    title = "a cubic in the generator"
    how = (
        "exponential as a cubic in the generator (Cayley-Hamilton), its coefficients polynomials "
        "in the springs' stiffness; a harmonic force by its steady motion, sampled excitation as a "
        "polynomial in time"
    )
    kinds = (PARAMETRIC_LINEAR,)
    entries = build(ch.propagate, respond=ch.respond)
    held = "held actuators"

    def limit(self, support: Support) -> str | None:
        """Return why not, unless only the stretch and the excitation vary, within bounds."""
        others = support.varying_parameters
        if others:
            return f"{others[0]} is randomised or actuated"
        if any(support.ground):
            return "a harmonic shakes the ground"
        phase = fastest_rate(support) * support.sample_interval
        if not phase <= LONGEST_STEP:
            return f"fastest rate times sample interval is {phase:.3g}, above {LONGEST_STEP:g}"
        amplification = _amplification(support)
        if not amplification <= MOST_AMPLIFIED:
            return (
                "too little damping for a harmonic force: its steady motion may be "
                f"{amplification:.3g} times that of one sample interval, above {MOST_AMPLIFIED:g}"
            )
        return None

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the generator and the polynomials of the cubic's coefficients."""
        model = np.concatenate([header(support, 0), np.zeros(ch.END - layout.MODEL_OWN)])
        p = values_of(support.low)  # the springs are stiffest at the lowest stretch
        most_stretched = support.low.copy()
        most_stretched[layout.STRETCH] = support.high[layout.STRETCH]
        with localcontext(Context(prec=DIGITS)):
            h, m1 = Decimal(support.sample_interval), p["m1"]
            unit = h * h / m1
            softest, stiffest = values_of(most_stretched)["k2"], p["k2"]
            middle, half = unit * (stiffest + softest) / 2, unit * (stiffest - softest) / 2
            model[ch.K1], model[ch.D] = p["k1"] * unit, p["d"] * h / m1
            model[ch.C] = p["c"] * h / m1
            model[ch.K0], model[ch.PUSH] = Decimal(float(support.low[layout.K0])) * unit, unit
            model[ch.MASS_RATIO], model[ch.MIDDLE] = p["m2"] / m1, middle
            model[ch.SCALE] = 1 / half if half else 0
            model[ch.PHASE] = fastest_rate(support) * support.sample_interval
            model[ch.IS_PUSHED] = not support.fixed(layout.FORCE)
            half_range = (stiffest - softest) / 2
            cubics = _cubics(p, h, (softest + stiffest) / 2, half_range, support.terms)
        model[ch.OF_STATE : ch.END] = cubics[:, :, ::-1].astype(np.float64).ravel()
        return model

    def cost(self, model: Array) -> str:
        """Return the products of the polynomials and of the excitation."""
        excitation = 40 * int(model[layout.HARMONIC_COUNT]) + 10 * int(model[layout.TERMS])
        return f"{4 * ch.COEFFICIENTS + 28 + excitation} products"


def _amplification(support: Support) -> float:
    """Return a bound of the steady motion relative to F h^2 / 2 m1, that of h from rest.

    The mean energy rate of the force is at most F w X1 / 2, and the dissipated one is
    d w^2 X1^2 / 2 + c w^2 X^2 / 2, with X1 and X the amplitudes of carriage and offset.
    """
    if not support.ground:
        return 0.0
    c, d, h = support.low[layout.C], support.low[layout.D], support.sample_interval
    lowest = support.lowest_frequencies.min() * h * h * min(d, math.sqrt(c * d))
    return 2.0 * support.low[layout.M1] / lowest if lowest > 0.0 else math.inf


def _cubics(
    p: Values, h: Decimal, middle: Decimal, half: Decimal, terms: int
) -> NDArray[np.object_]:
    """Return (3, 4, COEFFICIENTS) polynomials in (k2 - middle) / half, lowest coefficient first.

    They are the coefficients of I, A h, (A h)^2 and (A h)^3 in exp(A h), in (exp(A h) - I) / (A h)
    and in n! times what the exponential's series leaves from term n on, over (A h)^n, for n terms.
    Powers from the fourth on are reduced by the characteristic polynomial of A, which is linear in
    k2.
    """
    characteristic = [
        (_characteristic(p, h, middle + half) + sign * _characteristic(p, h, middle - half)) / 2
        for sign in (1, -1)
    ]
    powers = np.full((4, ch.COEFFICIENTS), Decimal(0))
    powers[0, 0] = Decimal(1)
    sums = np.full((3, 4, ch.COEFFICIENTS), Decimal(0))
    left_out = (0, 1, terms)
    for n in range(ORDERS):
        for k, terms_out in enumerate(left_out):
            sums[k] += powers * factorial(terms_out) / factorial(n + terms_out)
        highest = powers[3]
        powers = np.vstack([np.full(ch.COEFFICIENTS, Decimal(0)), powers[:3]])
        powers -= np.outer(characteristic[0], highest)
        powers[:, 1:] -= np.outer(characteristic[1], highest[:-1])
    return sums


def _characteristic(p: Values, h: Decimal, k2: Decimal) -> NDArray[np.object_]:
    """Return the coefficients of I .. (A h)^3 in the characteristic polynomial of A h."""
    m1, m2, k1, c, d = p["m1"], p["m2"], p["k1"], p["c"], p["d"]
    both = m1 * m2
    return np.array(
        [
            h**4 * k1 * k2 / both,
            h**3 * (c * k1 + d * k2) / both,
            h**2 * (k2 / m2 + (k1 + k2) / m1 + c * d / both),
            h * (c / m2 + (c + d) / m1),
        ]
    )
