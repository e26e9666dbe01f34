"""The steady motion under dry friction to its first harmonic: friction as a damping of its own.

Jacobsen, *Steady forced vibration as influenced by damping*, Trans. ASME 52 (1930): at a slip of
amplitude V friction takes as much energy in a period as a damping c(V), and the response is that of
a linear system.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.law.dry_friction import kinetic_force, slip_intercept, stick_slope

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.analysis.values import Linear
    from mm_gym.scene.mechanics import DryFriction

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

SMALLEST, LARGEST = 1e-9, 1e9
"""Amplitudes of the slip velocity between which it is sought, over v_r and over that of a rigid
support."""

HALVINGS = 44
"""Of the logarithm of that range: to 1e-11."""


class Friction(NamedTuple):
    """Dry friction (4) of docs/model.md: slope in stick [N s/m], kinetic force [N], v_r, chi."""

    stick: float
    kinetic: float
    reference: float
    slip: float


def friction_of(law: DryFriction, normal: float) -> Friction:
    """Return the friction under a normal force [N]."""
    vr = law.reference_velocity
    stick = plain(stick_slope)(law.static_coefficient, normal, vr)
    kinetic = plain(kinetic_force)(law.kinetic_coefficient, normal)
    return Friction(float(stick), float(kinetic), vr, law.slip_damping)


def lanchester_friction(mass_ratio: float) -> float:
    """Return the best friction force of a sphere without springs over the force on the carriage.

    The result holds for the first harmonic, on a carriage without damping, with negligible creep
    and static friction. The curves of all dampings pass through the fixed point of the viscous
    damper. The least peak is therefore the same, (2 + mu) / mu. Friction whose equivalent damping
    there is optimal attains it.
    """
    return 0.5 * pi / sqrt(2.0 + mass_ratio)


def equivalent_damping(friction: Friction, speed: Array) -> Array:
    """Return the damping [N s/m] that takes the energy that friction does, of slip amplitudes."""
    angle = np.arcsin(np.minimum(friction.reference / speed, 1.0))  # at which stick ends
    stuck = 0.5 * angle - 0.25 * np.sin(2.0 * angle)
    intercept = plain(slip_intercept)(friction.kinetic, friction.slip, friction.reference)
    slipping = intercept * np.cos(angle) / speed + friction.slip * (0.25 * pi - stuck)
    return 4.0 / pi * (friction.stick * stuck + slipping)


def steady_state(
    values: Linear, friction: Friction, excitation: str, amplitude: float, frequencies: Array
) -> Complex:
    """Return the complex amplitudes (4, n) of x1, x2, v1 and v2 under amplitude * exp(i w t).

    Parameters
    ----------
    values
        Coefficients; the damping of the interface is replaced.
    friction
        The interface.
    excitation, amplitude
        "force" [N] or "ground" [m/s^2].
    frequencies
        (n,) w [rad/s].
    """
    w = frequencies
    force = amplitude * (1.0 if excitation == "force" else values.m1)
    low = np.full(len(w), np.log(SMALLEST * friction.reference))
    high = np.log(LARGEST * (force * w / values.k1 + friction.reference))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        c = equivalent_damping(friction, np.exp(middle))
        x1, x2 = _displacements(values, c, excitation, w)
        grows = np.log(amplitude * w * np.abs(x2 - x1)) > middle
        low, high = np.where(grows, middle, low), np.where(grows, high, middle)
    c = equivalent_damping(friction, np.exp(low))
    both = amplitude * np.array(_displacements(values, c, excitation, w))
    return np.concatenate([both, 1j * w * both])


def _displacements(
    values: Linear, damping: Array, excitation: str, w: Array
) -> tuple[Complex, Complex]:
    """Return x1 and x2 (n,) per unit of excitation, by Cramer's rule on (1) and (2)."""
    m1, m2, k1, k2, _, d = values
    s = 1j * w
    link = k2 + s * damping
    carriage, sphere = k1 + s * d - w**2 * m1 + link, link - w**2 * m2
    of_carriage, of_sphere = (1.0, 0.0) if excitation == "force" else (-m1, -m2)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / (carriage * sphere - link**2)
    x1 = (of_carriage * sphere + of_sphere * link) * over
    return x1, (of_sphere * carriage + of_carriage * link) * over
