"""What flows in and out of a piecewise linear plant: exact integrals of eq. 11 of docs/model.md."""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel
from mm_gym.simulation.energy import precise_integration_kernel as precise

DISSIPATED, DISTURBANCE = 0, 1

MOST_INTERVALS = 1 << 24
"""Intervals tried in one control step before giving up."""


@kernel
def step_integrals(p, model, states, applied, jets, times, duration, work):
    """Write energies (steps, 2) [J], dissipated and disturbing, of each step from its own start.

    p (rows,) as `layout` has them, states (steps, 4), applied (steps, 2) and jets (steps, 2 terms)
    at the steps' starts, times (steps,) [s].
    """
    harmonics, terms, h = (
        int(model[at.HARMONIC_COUNT]),
        int(model[at.TERMS]),
        model[at.SAMPLE_INTERVAL],
    )
    n, friction = precise.size_of(harmonics, terms), p[at.VR] > 0.0
    regimes = 2 if friction else 1
    levels, forms = np.zeros((regimes, 1, n, n)), np.zeros((regimes, 2, 1, n, n))
    rows, y = np.zeros((regimes, 2, n)), np.empty(n)
    k2 = -1.0
    for i in range(states.shape[0]):
        stiffness = precise.stiffness_of(p[at.K0], applied[i, 1])
        if stiffness != k2:
            k2 = stiffness
            depth = precise.halvings(precise.fastest_rate(p, k2, harmonics, terms, h) * duration)
            if friction:
                depth = max(depth, precise.FINEST)
                if depth > precise.DEEPEST:
                    return at.TOO_MANY_EVENTS
            levels = np.zeros((regimes, depth + 1, n, n))
            forms = np.zeros((regimes, 2, depth + 1, n, n))
            for k in range(regimes):
                _prepare(p, k2, model, duration, k == 1, levels[k], forms[k], rows[k])
        z = precise.start(p, states[i], applied[i, 0], harmonics, times[i], jets[i])
        if friction:
            status = _walk(p, k2, model, duration, levels, forms, rows, z, y, work[i])
            if status != at.OK:
                return status
        else:
            for quantity in range(2):
                work[i, quantity] = precise.quadratic(forms[0, quantity, 0], z)
    return at.OK


@kernel
def _prepare(p, k2, model, duration, in_slip, levels, forms, rows):
    """Write one regime's levels, its integrals of both powers, and its slip rows."""
    harmonics, ground, terms = (
        int(model[at.HARMONIC_COUNT]),
        int(model[at.GROUND]),
        int(model[at.TERMS]),
    )
    a = precise.generator(p, k2, harmonics, ground, terms, model[at.SAMPLE_INTERVAL], in_slip)
    precise.double_up(a, duration, levels)
    precise.slip_rows(a, rows)
    weights = np.zeros((2, a.shape[0], a.shape[0]))
    _weigh(p, harmonics, ground, terms, in_slip, weights)
    for quantity in range(2):
        precise.double_forms_up(a, weights[quantity], duration, levels, forms[quantity])


@kernel
def _weigh(p, harmonics, ground, terms, in_slip, weights):
    """Write the quadratic forms of both powers: d v1^2 + f w, and p v1 - a_g (m1 v1 + m2 v2)."""
    n = weights.shape[1]
    m1, m2, vr = precise.carriage_mass(p), p[at.M2], p[at.VR] if in_slip else 0.0
    share = m2 / (m1 + m2)
    v1, w, f = np.zeros(n), np.zeros(n), np.zeros(n)
    v1[precise.COMMON], v1[precise.SLIP], v1[precise.SIGN] = 1.0, -share, -share * vr
    w[precise.SLIP], w[precise.SIGN] = 1.0, vr
    f[precise.SLIP] = p[at.CHI] if in_slip else precise.damping_of(p)
    f[precise.SIGN] = p[at.MU2] * p[at.FN] if in_slip else 0.0
    _add_outer(weights[DISSIPATED], p[at.D], v1, v1)
    _add_outer(weights[DISSIPATED], 1.0, f, w)
    common = np.zeros(n)
    common[precise.COMMON] = 1.0
    for j in range(harmonics):
        push = np.zeros(n)
        push[precise.HARMONICS + 2 * j + 1] = 1.0
        if (ground >> j) & 1:
            _add_outer(weights[DISTURBANCE], -(m1 + m2), push, common)
        else:
            _add_outer(weights[DISTURBANCE], 1.0, push, v1)
    if terms > 0:
        push, shake = np.zeros(n), np.zeros(n)
        push[precise.HARMONICS + 2 * harmonics] = shake[
            precise.HARMONICS + 2 * harmonics + terms
        ] = 1.0
        _add_outer(weights[DISTURBANCE], 1.0, push, v1)
        _add_outer(weights[DISTURBANCE], -(m1 + m2), shake, common)


@kernel
def _add_outer(weight, factor, a, b):
    """Add the symmetric part of factor a b'."""
    for i in range(a.shape[0]):
        for j in range(a.shape[0]):
            weight[i, j] += 0.5 * factor * (a[i] * b[j] + a[j] * b[i])


@kernel
def _walk(p, k2, model, duration, levels, forms, rows, z, y, work):
    """Add up both powers over one step, interval by interval between the regimes' changes."""
    harmonics, ground, terms = (
        int(model[at.HARMONIC_COUNT]),
        int(model[at.GROUND]),
        int(model[at.TERMS]),
    )
    depth, h = levels.shape[1] - 1, model[at.SAMPLE_INTERVAL]
    bounds, before = np.empty((2, 2)), np.empty(z.shape[0])
    for regime in range(2):
        bounds[regime, 0], bounds[regime, 1] = precise.bound_motion(
            p, k2, z, harmonics, ground, terms, h, duration, regime == 1
        )
    position, level, end = 0, 0, 1 << depth
    work[0] = work[1] = 0.0
    for _ in range(MOST_INTERVALS):
        regime = 0 if z[precise.SIGN] == 0.0 else 1
        for k in range(z.shape[0]):
            before[k] = z[k]
        if not precise.attempt(p[at.VR], levels, rows, bounds, z, y, level, duration):
            level += 1
            continue
        for quantity in range(2):
            work[quantity] += precise.quadratic(forms[regime, quantity, level], before)
        position += 1 << (depth - level)
        level = precise.next_level(position, level, depth)
        if position == end:
            return at.OK
    return at.TOO_MANY_EVENTS
