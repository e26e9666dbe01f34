"""Fixed-step methods on the smooth plants, kept to show what the others save."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jets import jet_value
from mm_gym.kernels.jit import kernel
from mm_gym.kernels.laws import (
    carriage_force,
    escape_distance,
    has_escaped,
    pair_force,
    stiffness,
)

SUBSTEPS, IS_FINITE = at.MODEL_OWN, at.MODEL_OWN + 1

# Coefficients of one lane.
_BY_M1, _BY_M2, _K1, _ALPHA, _BETA, _D, _C, _K2, _K0, _L0, _STRETCH, _FORCE = range(12)
_ESCAPE, _SIZE = 12, 13


@kernel
def propagate_rk4(model, lanes, first, last):
    """Advance the lanes by one sample interval with the classical method of Kutta (1901)."""
    substeps, finite = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0
    h, status = model[at.SAMPLE_INTERVAL] / substeps, at.OK
    p, y, stage, slope, total = np.empty(_SIZE), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(first, last):
        _load(lanes, i, model[at.SAMPLE_INTERVAL], p)
        for row in range(4):
            y[row] = lanes[row, i]
        for k in range(substeps):
            total[:] = 0.0
            for s in range(4):
                part, weight = (0.0, 0.5, 0.5, 1.0)[s], (1.0, 2.0, 2.0, 1.0)[s] / 6.0
                for row in range(4):
                    stage[row] = y[row] + (part * h * slope[row] if s > 0 else 0.0)
                _field(model, lanes, i, p, stage, (k + part) * h, finite, slope)
                for row in range(4):
                    total[row] += weight * slope[row]
            for row in range(4):
                y[row] += h * total[row]
            if has_escaped(y[0], y[2], p[_ESCAPE]):
                break
        status = max(status, _store(lanes, i, y, p[_ESCAPE]))
    return status


@kernel
def propagate_semi_implicit_euler(model, lanes, first, last):
    """Advance the lanes by a sample interval: velocities, then positions with the new ones."""
    substeps, finite = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0
    h, status = model[at.SAMPLE_INTERVAL] / substeps, at.OK
    p, y, slope = np.empty(_SIZE), np.empty(4), np.empty(4)
    for i in range(first, last):
        _load(lanes, i, model[at.SAMPLE_INTERVAL], p)
        for row in range(4):
            y[row] = lanes[row, i]
        for k in range(substeps):
            _field(model, lanes, i, p, y, k * h, finite, slope)
            y[2] += h * slope[2]
            y[3] += h * slope[3]
            y[0] += h * y[2]
            y[1] += h * y[3]
            if has_escaped(y[0], y[2], p[_ESCAPE]):
                break
        status = max(status, _store(lanes, i, y, p[_ESCAPE]))
    return status


@kernel
def _load(lanes, i, duration, p):
    """Write what the equations of lane i need to p (_SIZE,), in SI units, over a duration [s]."""
    p[_BY_M1], p[_BY_M2] = 1.0 / lanes[at.M1, i], 1.0 / lanes[at.M2, i]
    p[_K1], p[_ALPHA], p[_BETA] = lanes[at.K1, i], lanes[at.ALPHA, i], lanes[at.BETA, i]
    p[_D], p[_C], p[_FORCE] = lanes[at.D, i], lanes[at.C, i], lanes[at.FORCE, i]
    p[_K0], p[_L0], p[_STRETCH] = lanes[at.K0, i], lanes[at.L0, i], lanes[at.STRETCH, i]
    p[_K2] = stiffness(p[_K0], p[_STRETCH])
    p[_ESCAPE] = escape_distance(lanes[at.M1, i], p[_K1], p[_ALPHA], p[_BETA], duration)


@kernel
def _field(model, lanes, i, p, y, elapsed, finite, slope):
    """Write the time derivative of the state.

    Parameters
    ----------
    model, lanes, i
        (m,) and (rows, count), read: what excites lane i.
    p
        (_SIZE,) read: coefficients of the lane.
    y
        (4,) read: x1, x2 [m], v1, v2 [m/s].
    elapsed
        Time [s] since the start of the sample interval.
    finite
        Whether the springs are of finite stretch.
    slope
        (4,) written [m/s, m/s^2].
    """
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
    springs = pair_force(p[_K0], p[_L0], p[_STRETCH], offset) if finite else p[_K2] * offset
    inner = p[_C] * (v2 - v1) + springs  # (3) of docs/model.md: smooth plants have no friction
    outer = carriage_force(p[_K1], p[_ALPHA], p[_BETA], x1) + p[_D] * v1 - p[_FORCE]
    slope[0], slope[1] = v1, v2
    slope[2] = (inner - outer + force) * p[_BY_M1] - ground  # (1)
    slope[3] = -inner * p[_BY_M2] - ground  # (2)


@kernel
def _store(lanes, i, y, escape):
    """Write the state back if it is finite; return the status."""
    if not abs(y[0]) + abs(y[1]) + abs(y[2]) + abs(y[3]) < np.inf:
        return at.DIVERGED
    for row in range(4):
        lanes[row, i] = y[row]
    return at.ESCAPED if has_escaped(y[0], y[2], escape) else at.OK
