"""What follows from the state at a step's end: forces and absolute accelerations (eqs 1 and 2)."""

from __future__ import annotations

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.kernels.sources import jet_value


@borrowing_kernel
def derive(model, lanes, first, last):
    """Write the rows from CARRIAGE_ACCELERATION to GROUND_ACCELERATION."""
    for i in range(first, last):
        offset, w = lanes[at.X2, i] - lanes[at.X1, i], lanes[at.V2, i] - lanes[at.V1, i]
        springs, push = spring_force(lanes, offset, i), excitation(model, lanes, False, i)
        inner = interface_force(lanes, w, i) + springs
        x1, beta = lanes[at.X1, i], lanes[at.BETA, i]
        spring = lanes[at.K1, i] * (lanes[at.ALPHA, i] + beta * x1 * x1) * x1
        outer = push + lanes[at.FORCE, i] - lanes[at.D, i] * lanes[at.V1, i] - spring
        lanes[at.CARRIAGE_ACCELERATION, i] = (inner + outer) / lanes[at.M1, i]
        lanes[at.SPHERE_ACCELERATION, i] = -inner / lanes[at.M2, i]
        lanes[at.SPRING_FORCE, i], lanes[at.DISTURBANCE, i] = springs, push
        lanes[at.GROUND_ACCELERATION, i] = excitation(model, lanes, True, i)


@borrowing_kernel
def excitation(model, lanes, ground, i):
    """Return the disturbing force [N], or the ground's acceleration [m/s^2], at a substep's end."""
    total = 0.0
    for j in range(int(model[at.TONE_COUNT])):
        tone = at.TONES + at.TONE_ROWS * j
        if ((int(model[at.GROUND]) >> j) & 1 == 1) == ground:
            total += lanes[tone + at.AMPLITUDE, i] * lanes[tone + at.SINE, i]
    terms = int(model[at.TERMS])
    jet = int(model[at.JETS]) + (terms if ground else 0)
    return total + jet_value(lanes, jet, terms, 1.0, i)


@borrowing_kernel
def interface_force(lanes, w, i):
    """Return f(w) [N], eq. 9 of the paper."""
    vr = lanes[at.VR, i]
    if vr == 0.0:
        return lanes[at.C, i] * w
    if abs(w) <= vr:
        return lanes[at.MU1, i] * lanes[at.FN, i] / vr * w
    force = lanes[at.MU2, i] * lanes[at.FN, i] + lanes[at.CHI, i] * (abs(w) - vr)
    return force if w > 0.0 else -force


@borrowing_kernel
def spring_force(lanes, offset, i):
    """Return the force [N] of the sphere's springs on the carriage; a stretch of 0 without them."""
    k0, stretch, l0 = lanes[at.K0, i], lanes[at.STRETCH, i], lanes[at.L0, i]
    if k0 == 0.0:
        return 0.0
    shortened = offset / l0 if l0 > 0.0 else 0.0
    # The neo-Hookean pair without differences of nearly equal stretches; l0 -> infinity: eq. 15.
    rest = stretch * stretch - shortened * shortened
    return 2.0 * k0 * offset * (1.0 + 2.0 * stretch / (rest * rest))
