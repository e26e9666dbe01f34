"""Transfer functions without dimension, and the criteria that are minimised over them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mm_gym.analysis.linear import Linear, characteristic
from mm_gym.arrays import Array
from mm_gym.step.channels import CHANNELS as ALL_CHANNELS

Polynomial = Array  # coefficients, of the highest power first

EXCITATIONS = ("force", "ground")

FREQUENCY_RATIOS = (0.002, 20.0)
"""Range of w2 / w1 that is searched where the springs do not bound it.

Of a sphere a hundred times as heavy as the carriage the best is near 0.01.
"""

DAMPING_RATIOS = (1e-6, 20.0)  # range of c / (2 m2 w1) that is searched


class Transfer(NamedTuple):
    """numerator / denominator in s / w1, both with the highest power first and no common zero at 0.

    A force F enters as F / k1 and the ground's acceleration a_g as a_g / w1^2; displacements come
    out as they are, velocities over w1, accelerations over w1^2 and forces over k1.
    """

    numerator: Polynomial
    denominator: Polynomial


def without_dimension(values: Linear) -> Linear:
    """Return the coefficients over m1, k1 and sqrt(k1 m1)."""
    m1, m2, k1, k2, c, d = values
    unit = np.sqrt(k1 * m1)
    return Linear(1.0, m2 / m1, 1.0, k2 / k1, c / unit, d / unit)


def transfer(values: Linear, excitation: str, channel: str) -> Transfer:
    """Return the transfer function to one of `CHANNELS`, of coefficients `without_dimension`."""
    x1, x2, absolute1, absolute2 = _numerators(values, excitation)
    offset = np.polyadd(x2, -x1).astype(np.float64)
    numerator = {
        "carriage_displacement": x1,
        "sphere_displacement": x2,
        "sphere_offset": offset,
        "carriage_velocity": np.append(x1, 0.0),
        "sphere_velocity": np.append(x2, 0.0),
        "slip_velocity": np.append(offset, 0.0),
        "carriage_acceleration": absolute1,
        "sphere_acceleration": absolute2,
        "spring_force": values.k2 * offset,
    }[channel]
    denominator = characteristic(values)
    while numerator[-1] == 0.0 and denominator[-1] == 0.0:  # of what never moves, one 0 stays
        numerator, denominator = numerator[: max(1, len(numerator) - 1)], denominator[:-1]
    return Transfer(numerator, denominator)


CHANNELS = (
    *("carriage_displacement", "sphere_displacement", "sphere_offset"),
    *("carriage_velocity", "sphere_velocity", "slip_velocity"),
    *("carriage_acceleration", "sphere_acceleration", "spring_force"),
)
"""Channels that depend on stiffness and damping."""


def _numerators(
    values: Linear, excitation: str
) -> tuple[Polynomial, Polynomial, Polynomial, Polynomial]:
    """Return numerators of x1, x2 and absolute accelerations: Cramer's rule on (1) and (2)."""
    m1, m2, k1, k2, c, d = values
    link, support = np.array([c, k2]), np.array([d, k1])
    sphere = np.array([m2, c, k2])
    carriage = np.array([m1, c + d, k1 + k2])
    if excitation == "force":
        return sphere, link, np.append(sphere, [0.0, 0.0]), np.append(link, [0.0, 0.0])
    # x1 and x2 relative to the ground; with the ground's own acceleration in the last two
    x1 = -np.polyadd(m1 * sphere, m2 * link).astype(np.float64)
    x2 = -np.polyadd(m2 * carriage, m1 * link).astype(np.float64)
    return x1, x2, np.convolve(support, sphere), np.convolve(support, link)


def si_factor(values: Linear, excitation: str, channel: str) -> float:
    """Return what an amplitude without dimension is multiplied by to be in SI units."""
    w1 = float(np.sqrt(values.k1 / values.m1))
    entering = 1.0 / values.k1 if excitation == "force" else 1.0 / w1**2
    unit = ALL_CHANNELS[channel].unit
    return entering * {"m": 1.0, "m/s": w1, "m/s^2": w1**2, "N": values.k1}[unit]


def si_unit(excitation: str, channel: str) -> str:
    """Return the SI unit of an amplitude."""
    unit = f"{ALL_CHANNELS[channel].unit} per {'N' if excitation == 'force' else 'm/s^2'}"
    return unit.replace("s^2", "s²")


NEWTON_STEPS = 6  # Newton steps from a root of the polynomial to a stationary frequency
ENOUGH = 1e-9  # relative step after which Newton's method stops: the next one is below round-off


class Peak(NamedTuple):
    """A frequency over w1 [-], 0 and infinity included, and the amplitude there."""

    frequency: float
    amplitude: float


def amplitude(transfer: Transfer, frequencies: Array) -> Array:
    """Return the amplitudes (n,) at frequencies (n,) over w1; infinite at undamped resonances."""
    s = 1j * frequencies
    with np.errstate(divide="ignore", invalid="ignore"):
        numerator = np.polyval(transfer.numerator, s)
        size = np.abs(numerator / np.polyval(transfer.denominator, s))
    return np.where(np.isnan(size), np.inf, size)


def stationary_points(transfer: Transfer) -> list[Peak]:
    """Return the frequencies at which the amplitude may be stationary, 0 and infinity included.

    With x = (w / w1)^2 the squared amplitude is a ratio of two polynomials P / Q; the roots of
    P' Q - P Q' and the eigenvalues' frequencies are where Newton's method starts from.
    """
    over, under = _squared(transfer.numerator), _squared(transfer.denominator)
    slope = np.polysub(np.polymul(np.polyder(over), under), np.polymul(over, np.polyder(under)))
    roots = np.roots(np.trim_zeros(slope, "f"))
    near = roots[(roots.real > 0.0) & (np.abs(roots.imag) <= roots.real)].real
    poles = np.roots(transfer.denominator)
    starts = np.concatenate([np.sqrt(near), np.abs(poles.imag[poles.imag > 0.0])])
    inner = _polished(transfer, starts)
    sizes = amplitude(transfer, np.append(0.0, inner))
    found = [Peak(0.0, float(sizes[0]))]
    found += [Peak(float(w), float(h)) for w, h in sorted(zip(inner, sizes[1:], strict=True))]
    numerator = np.trim_zeros(transfer.numerator, "f")
    missing = len(transfer.denominator) - len(numerator)
    last = 0.0 if missing > 0 else np.inf
    if missing == 0:
        last = float(abs(numerator[0] / transfer.denominator[0]))
    return [*found, Peak(np.inf, last)]


def largest_peak(
    transfer: Transfer, low: float = 0.0, high: float = np.inf, points: list[Peak] | None = None
) -> Peak:
    """Return the highest peak between two frequencies over w1, the ends included.

    The points are what `stationary_points` returns, if it is known.
    """
    if points is None:
        points = stationary_points(transfer)
    points = [*points, *_resonances(transfer)]
    inside = [peak for peak in points if low <= peak.frequency <= high]
    ends = np.array([end for end in (low, high) if 0.0 < end < np.inf])
    sizes = amplitude(transfer, ends)
    inside += [Peak(float(w), float(h)) for w, h in zip(ends, sizes, strict=True)]
    return max(inside, key=lambda peak: peak.amplitude)


def rough_peak(transfer: Transfer, frequencies: Array) -> float:
    """Return the largest amplitude at some frequencies over w1 and those of the eigenvalues."""
    poles = np.roots(transfer.denominator)
    if poles.real.max(initial=-np.inf) >= 0.0:
        return np.inf
    return float(amplitude(transfer, np.concatenate([frequencies, np.abs(poles)])).max())


def valley(transfer: Transfer) -> float:
    """Return the frequency over w1 of the lowest amplitude between the two highest peaks."""
    points = stationary_points(transfer)
    inner = [
        here
        for before, here, after in zip(points, points[1:], points[2:], strict=False)
        if here.amplitude >= max(before.amplitude, after.amplitude)
    ]
    if len(inner) < 2:  # noqa: PLR2004 - two peaks
        return max(points[:-1], key=lambda peak: peak.amplitude).frequency or 1.0
    highest = sorted(inner, key=lambda peak: -peak.amplitude)[:2]
    low, high = sorted(peak.frequency for peak in highest)
    between = [peak for peak in points if low < peak.frequency < high]
    if not between:
        return 0.5 * (low + high)
    return min(between, key=lambda peak: peak.amplitude).frequency


def variance(transfer: Transfer) -> float:
    """Return the variance of the output under white noise of intensity 1, or infinity.

    The integral of |G(i w)|^2 / (2 pi) over all frequencies; Astrom, Introduction to Stochastic
    Control Theory (1970), section 5.2, whose table is Routh's with one more row each.
    """
    a = transfer.denominator / transfer.denominator[0]
    b = np.trim_zeros(transfer.numerator, "f") / transfer.denominator[0]
    order = len(a) - 1
    if len(b) > order:
        return np.inf
    b = np.concatenate([np.zeros(order - len(b)), b])
    total = 0.0
    for _ in range(order):
        if not (a[0] > 0.0 and a[1] > 0.0):
            return np.inf  # an eigenvalue that does not decay
        alpha, beta = a[0] / a[1], b[0] / a[1]
        total += beta * beta / (2.0 * alpha)
        lower, rest = a[1:].copy(), b[1:].copy()  # the table's next rows
        lower[1::2] -= alpha * np.append(a[2:], 0.0)[1::2]
        rest[1::2] -= beta * a[3::2]
        a, b = lower, rest
    return float(total)


def abscissa(denominator: Array) -> float:
    """Return the largest real part of the roots."""
    return float(np.roots(denominator).real.max(initial=-np.inf))


def _resonances(transfer: Transfer) -> list[Peak]:
    """Return where the denominator has no real part, and the amplitudes there.

    With little damping that is at the peaks. They may be narrower than the spacing of doubles, so
    that the real part does not vanish at any of them.
    """
    even, odd = _parts(transfer.denominator)
    roots = np.roots(even)
    squares = roots[(roots.imag == 0.0) & (roots.real > 0.0)].real
    w = np.sqrt(squares)
    over = np.abs(np.polyval(transfer.numerator, 1j * w))
    with np.errstate(divide="ignore", invalid="ignore"):
        sizes = over / np.abs(w * np.polyval(odd, squares))
    return [Peak(*both) for both in zip(w.tolist(), sizes.tolist(), strict=True)]


def _parts(polynomial: Array) -> tuple[Array, Array]:
    """Return a and b of p(i w) = a(w^2) + i w b(w^2)."""
    ascending = polynomial[::-1]
    signs = (-1.0) ** np.arange(len(ascending))
    even, odd = ascending[0::2], ascending[1::2]
    return (even * signs[: len(even)])[::-1], (odd * signs[: len(odd)])[::-1]


def _squared(polynomial: Array) -> Array:
    """Return |p(i w)|^2 as a polynomial in w^2."""
    signs = (-1.0) ** np.arange(len(polynomial))
    # p(s) p(-s), up to a sign, has even powers of s only, and s^2 = -w^2.
    return np.convolve(polynomial, polynomial * signs)[::2] * signs


def _polished(transfer: Transfer, starts: Array) -> Array:
    """Return stationary frequencies by Newton's method, each where it is not worse than before."""
    w = starts.astype(np.float64)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            first, second = _slopes(transfer, w)
            step = first / second
            step = np.where(np.abs(step) < 0.1 * w, step, 0.0)  # also where it is not finite
            w = w - step
            if (np.abs(step) <= ENOUGH * w).all():
                break
    return w


def _slopes(transfer: Transfer, w: Array) -> tuple[Array, Array]:
    """Return the first and second derivative of the logarithm of the amplitude."""
    first = second = np.zeros(len(w), np.complex128)
    s = (1j * w).astype(np.complex128)
    for polynomial, sign in ((transfer.numerator, 1.0), (transfer.denominator, -1.0)):
        value, slope, curvature = (np.polyval(np.polyder(polynomial, k), s) for k in range(3))
        one = slope / value
        first = first + sign * 1j * one
        second = second - sign * (curvature / value - one * one)
    return first.real, second.real
