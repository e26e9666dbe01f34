"""Fixed-step methods on the smooth plants, kept to show what the others save."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jets import jet_value
from mm_gym.kernels.jit import kernel
from mm_gym.methods.taylor.kernel import coefficients, interface_and_springs, outer_forces
from mm_gym.methods.taylor.layout import BY_M1, BY_M2, SIZE

SUBSTEPS, IS_FINITE = at.MODEL_OWN, at.MODEL_OWN + 1


@kernel
def propagate_rk4(model, lanes, first, last):
    """Advance the lanes by one control step with the classical Runge-Kutta method (Kutta, 1901)."""
    substeps, finite = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0
    h, status = model[at.SAMPLE_INTERVAL] / substeps, at.OK
    p, y, stage, slope, total = np.empty(SIZE), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(first, last):
        coefficients(lanes, i, False, p)
        for row in range(4):
            y[row] = lanes[row, i]
        for k in range(substeps):
            total[:] = 0.0
            for s in range(4):
                share, weight = (0.0, 0.5, 0.5, 1.0)[s], (1.0, 2.0, 2.0, 1.0)[s] / 6.0
                for row in range(4):
                    stage[row] = y[row] + (share * h * slope[row] if s > 0 else 0.0)
                _field(model, lanes, i, p, stage, (k + share) * h, finite, slope)
                for row in range(4):
                    total[row] += weight * slope[row]
            for row in range(4):
                y[row] += h * total[row]
        status = max(status, _store(lanes, i, y))
    return status


@kernel
def propagate_semi_implicit_euler(model, lanes, first, last):
    """Advance the lanes by one control step: velocities, then positions with the new ones."""
    substeps, finite = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0
    h, status = model[at.SAMPLE_INTERVAL] / substeps, at.OK
    p, y, slope = np.empty(SIZE), np.empty(4), np.empty(4)
    for i in range(first, last):
        coefficients(lanes, i, False, p)
        for row in range(4):
            y[row] = lanes[row, i]
        for k in range(substeps):
            _field(model, lanes, i, p, y, k * h, finite, slope)
            y[2] += h * slope[2]
            y[3] += h * slope[3]
            y[0] += h * y[2]
            y[1] += h * y[3]
        status = max(status, _store(lanes, i, y))
    return status


@kernel
def _field(model, lanes, i, p, y, elapsed, finite, slope):
    """Write the time derivative of the state."""
    x1, offset, v1, v2 = y[0], y[1] - y[0], y[2], y[3]
    terms, part = int(model[at.TERMS]), elapsed / model[at.SAMPLE_INTERVAL]
    force = jet_value(lanes, int(model[at.JETS]), terms, part, i)
    ground = jet_value(lanes, int(model[at.JETS]) + terms, terms, part, i)
    for j in range(int(model[at.HARMONIC_COUNT])):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        turn = lanes[harmonic + at.FREQUENCY, i] * elapsed
        value = lanes[harmonic + at.SINE, i] * math.cos(turn) + lanes[
            harmonic + at.COSINE, i
        ] * math.sin(turn)
        value *= lanes[harmonic + at.AMPLITUDE, i]
        if (int(model[at.GROUND]) >> j) & 1:
            ground += value
        else:
            force += value
    inner = interface_and_springs(p, offset, v2 - v1, finite)
    slope[0], slope[1] = v1, v2
    slope[2] = (inner - outer_forces(p, x1, v1) + force) * p[BY_M1] - ground
    slope[3] = -inner * p[BY_M2] - ground


@kernel
def _store(lanes, i, y):
    """Write the state back if it is finite."""
    if not abs(y[0]) + abs(y[1]) + abs(y[2]) + abs(y[3]) < np.inf:
        return at.DIVERGED
    for row in range(4):
        lanes[row, i] = y[row]
    return at.OK
