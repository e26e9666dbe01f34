"""Energy rates of a piecewise linear plant, integrated exactly: (11) of docs/model.md.

Arguments in common are those of `step_integrals` and of `piecewise_linear_kernel`.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.lanes import layout
from mm_gym.law.springs import stiffness
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy import precise_integration_kernel as precise

DISSIPATED, DISTURBANCE = 0, 1

MOST_INTERVALS = 1 << 18
"""Intervals tried in one sample interval before giving up: series take less time then."""


@kernel
def step_integrals(p, model, states, applied, jets, times, duration, work):
    """Write what is dissipated in each sample interval, and what disturbances add; return a status.

    Parameters
    ----------
    p
        (rows,) read: the lane of the episode.
    model
        (m,) read.
    states, applied, jets
        (n, 4), (n, 2) or (n, 3), and (n, 2 terms), read: state [m, m/s]; force [N], stretch, and
        damping [N s/m] if it is actuated; coefficients of the excitation at the intervals' starts.
    times, duration
        (n,) read: the intervals' starts [s], and the length of what is looked at from there [s].
    work
        (n, 2) written [J].
    """
    harmonics, terms = int(model[layout.HARMONIC_COUNT]), int(model[layout.TERMS])
    h = model[layout.SAMPLE_INTERVAL]
    n, friction = piecewise.size_of(harmonics, terms), p[layout.VR] > 0.0
    regimes = 2 if friction else 1
    levels, forms = np.zeros((regimes, 1, n, n)), np.zeros((regimes, 2, 1, n, n))
    rows, y = np.zeros((regimes, 2, n)), np.empty(n)
    k2, share, damped = -1.0, piecewise.force_share(model, p), int(model[layout.DAMPED])
    p = p.copy()
    for i in range(states.shape[0]):
        present = stiffness(p[layout.K0], applied[i, 1])
        changes = present != k2
        if damped > 0:
            changes |= p[damped] != applied[i, 2]
            p[damped] = applied[i, 2]
        if changes:
            k2 = present
            depth = precise.halvings(piecewise.fastest_rate(p, k2, harmonics, terms, h) * duration)
            if friction:
                depth = max(depth, piecewise.FINEST)
                if depth > piecewise.DEEPEST:
                    return layout.TOO_MANY_EVENTS
            levels = np.zeros((regimes, depth + 1, n, n))
            forms = np.zeros((regimes, 2, depth + 1, n, n))
            for k in range(regimes):
                _prepare(p, k2, model, duration, k == 1, levels[k], forms[k], rows[k])
        force = share * applied[i, 0]
        z = piecewise.start(p, states[i], force, harmonics, times[i], jets[i])
        if friction:
            status = _walk(p, k2, model, duration, levels, forms, rows, z, y, work[i])
            if status != layout.OK:
                return status
        else:
            for quantity in range(2):
                work[i, quantity] = piecewise.quadratic(forms[0, quantity, 0], z)
    return layout.OK


@kernel
def _prepare(p, k2, model, duration, in_slip, levels, forms, rows):
    """Write one regime's levels, its integrals of both energy rates, and its slip rows."""
    harmonics, ground = int(model[layout.HARMONIC_COUNT]), int(model[layout.GROUND])
    terms = int(model[layout.TERMS])
    a = piecewise.generator(p, k2, harmonics, ground, terms, model[layout.SAMPLE_INTERVAL], in_slip)
    if model[layout.BETWEEN] > 0.0:  # both masses together feel nothing of the force
        a[piecewise.COMMON, piecewise.FORCE] = 0.0
    precise.double_up(a, duration, levels)
    piecewise.slip_rows(a, rows)
    weights = np.zeros((2, a.shape[0], a.shape[0]))
    _weigh(p, harmonics, ground, terms, in_slip, weights)
    for quantity in range(2):
        precise.double_forms_up(a, weights[quantity], duration, levels, forms[quantity])


@kernel
def _weigh(p, harmonics, ground, terms, in_slip, weights):
    """Write the quadratic forms (2, n, n) of both energy rates [W], the terms of (11).

    d v1^2 + f w, and p v1 - a_g (m1 v1 + m2 v2).
    """
    n = weights.shape[1]
    m1, m2, vr = piecewise.carriage_mass(p), p[layout.M2], p[layout.VR] if in_slip else 0.0
    part = m2 / (m1 + m2)
    v1, w, f = np.zeros(n), np.zeros(n), np.zeros(n)
    v1[piecewise.COMMON], v1[piecewise.SLIP], v1[piecewise.SIGN] = 1.0, -part, -part * vr
    w[piecewise.SLIP], w[piecewise.SIGN] = 1.0, vr
    f[piecewise.SLIP] = p[layout.CHI] if in_slip else p[layout.C]
    f[piecewise.SIGN] = p[layout.KINETIC_FORCE] if in_slip else 0.0
    _add_outer(weights[DISSIPATED], p[layout.D], v1, v1)
    _add_outer(weights[DISSIPATED], 1.0, f, w)
    common = np.zeros(n)
    common[piecewise.COMMON] = 1.0
    for j in range(harmonics):
        push = np.zeros(n)
        push[piecewise.HARMONICS + 2 * j + 1] = 1.0
        if (ground >> j) & 1:
            _add_outer(weights[DISTURBANCE], -(m1 + m2), push, common)
        else:
            _add_outer(weights[DISTURBANCE], 1.0, push, v1)
    if terms > 0:
        push, shake = np.zeros(n), np.zeros(n)
        jets = piecewise.HARMONICS + 2 * harmonics
        push[jets] = shake[jets + terms] = 1.0
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
    """Add up both energy rates over one step, interval by interval between changes of regime."""
    harmonics, ground = int(model[layout.HARMONIC_COUNT]), int(model[layout.GROUND])
    terms = int(model[layout.TERMS])
    depth, h = levels.shape[1] - 1, model[layout.SAMPLE_INTERVAL]
    bounds, before = np.empty((2, 2)), np.empty(z.shape[0])
    for regime in range(2):
        bounds[regime, 0], bounds[regime, 1] = piecewise.bound_motion(
            p, k2, z, harmonics, ground, terms, h, duration, regime == 1
        )
    position, level, end = 0, 0, 1 << depth
    work[0] = work[1] = 0.0
    for _ in range(MOST_INTERVALS):
        regime = 0 if z[piecewise.SIGN] == 0.0 else 1
        for k in range(z.shape[0]):
            before[k] = z[k]
        if not piecewise.attempt(p[layout.VR], levels, rows, bounds, z, y, level, duration):
            level += 1
            continue
        for quantity in range(2):
            work[quantity] += piecewise.quadratic(forms[regime, quantity, level], before)
        position += 1 << (depth - level)
        level = piecewise.next_level(position, level, depth)
        if position == end:
            return layout.OK
    return layout.TOO_MANY_EVENTS
