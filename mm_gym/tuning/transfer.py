"""The transfer functions that are tuned, as ratios of polynomials without dimension."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.analysis.values import Linear, characteristic
from mm_gym.errors import DesignError, suggest
from mm_gym.step.channels import CHANNELS as ALL_CHANNELS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Polynomial = NDArray[np.float64]

EXCITATIONS = ("force", "ground")


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
    """Return the transfer function from an excitation to a channel.

    Parameters
    ----------
    values
        Coefficients without dimension, see `without_dimension`.
    excitation
        "force" or "ground".
    channel
        One of `CHANNELS`.
    """
    x1, x2, absolute1, absolute2 = _numerators(values, excitation)
    offset = _sum(x2, -x1)
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
    while numerator[-1] == 0.0 and denominator[-1] == 0.0 and len(numerator) > 1:
        numerator, denominator = numerator[:-1], denominator[:-1]
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
    """Return the numerators of x1, x2 and of the absolute accelerations of both masses.

    Cramer's rule on (1) and (2) of docs/model.md.
    """
    m1, m2, k1, k2, c, d = values
    link, support = np.array([c, k2]), np.array([d, k1])
    sphere = np.array([m2, c, k2])
    carriage = np.array([m1, c + d, k1 + k2])
    if excitation == "force":
        return sphere, link, np.append(sphere, [0.0, 0.0]), np.append(link, [0.0, 0.0])
    # x1 and x2 relative to the ground; with the ground's own acceleration in the last two
    x1, x2 = -_sum(m1 * sphere, m2 * link), -_sum(m2 * carriage, m1 * link)
    return x1, x2, np.convolve(support, sphere), np.convolve(support, link)


def _sum(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return the sum of two polynomials, which may have different degrees."""
    size = max(len(a), len(b))
    total = np.zeros(size)
    total[size - len(a) :] += a
    total[size - len(b) :] += b
    return total


def check_path(excitation: str, channel: str) -> None:
    """Raise `DesignError` for an excitation or a channel that nothing can be tuned for."""
    for name, value, allowed in (
        ("excitation", excitation, EXCITATIONS),
        ("channel", channel, CHANNELS),
    ):
        if value not in allowed:
            msg = f"{name}: got {value!r}{suggest(value, allowed)}; allowed: {', '.join(allowed)}"
            raise DesignError(msg)


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
