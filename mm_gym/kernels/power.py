"""What flows in and out of a piecewise linear plant: exact integrals of eq. 11 of docs/model.md."""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import ladder
from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel

DISSIPATED, DISTURBANCE = 0, 1

MOST_INTERVALS = 1 << 24
"""Intervals tried in one control step before giving up."""


@kernel
def step_integrals(p, model, states, applied, jets, times, duration, work):
    """Write energies (steps, 2) [J], dissipated and disturbing, of each step from its own start.

    p (rows,) as `layout` has them, states (steps, 4), applied (steps, 2) and jets (steps, 2 terms)
    at the steps' starts, times (steps,) [s].
    """
    tones, terms, h = int(model[at.TONE_COUNT]), int(model[at.TERMS]), model[at.TIME_STEP]
    n, friction = ladder.size_of(tones, terms), p[at.VR] > 0.0
    regimes = 2 if friction else 1
    rungs, forms = np.zeros((regimes, 1, n, n)), np.zeros((regimes, 2, 1, n, n))
    rows, y = np.zeros((regimes, 2, n)), np.empty(n)
    k2 = -1.0
    for i in range(states.shape[0]):
        stiffness = ladder.stiffness_of(p[at.K0], applied[i, 1])
        if stiffness != k2:
            k2 = stiffness
            depth = ladder.halvings(ladder.fastest_rate(p, k2, tones, terms, h) * duration)
            if friction:
                depth = max(depth, ladder.FINEST)
                if depth > ladder.DEEPEST:
                    return at.TOO_MANY_EVENTS
            rungs = np.zeros((regimes, depth + 1, n, n))
            forms = np.zeros((regimes, 2, depth + 1, n, n))
            for k in range(regimes):
                _prepare(p, k2, model, duration, k == 1, rungs[k], forms[k], rows[k])
        z = ladder.start(p, states[i], applied[i, 0], tones, times[i], jets[i])
        if friction:
            status = _walk(p, k2, model, duration, rungs, forms, rows, z, y, work[i])
            if status != at.OK:
                return status
        else:
            for quantity in range(2):
                work[i, quantity] = ladder.quadratic(forms[0, quantity, 0], z)
    return at.OK


@kernel
def _prepare(p, k2, model, duration, in_slip, rungs, forms, rows):
    """Write one regime's rungs, its integrals of both powers, and its slip rows."""
    tones, ground, terms = int(model[at.TONE_COUNT]), int(model[at.GROUND]), int(model[at.TERMS])
    a = ladder.generator(p, k2, tones, ground, terms, model[at.TIME_STEP], in_slip)
    ladder.climb(a, duration, rungs)
    ladder.slip_rows(a, rows)
    weights = np.zeros((2, a.shape[0], a.shape[0]))
    _weigh(p, tones, ground, terms, in_slip, weights)
    for quantity in range(2):
        ladder.climb_forms(a, weights[quantity], duration, rungs, forms[quantity])


@kernel
def _weigh(p, tones, ground, terms, in_slip, weights):
    """Write the quadratic forms of both powers: d v1^2 + f w, and p v1 - a_g (m1 v1 + m2 v2)."""
    n = weights.shape[1]
    m1, m2, vr = ladder.carriage_mass(p), p[at.M2], p[at.VR] if in_slip else 0.0
    share = m2 / (m1 + m2)
    v1, w, f = np.zeros(n), np.zeros(n), np.zeros(n)
    v1[ladder.COMMON], v1[ladder.SLIP], v1[ladder.SIGN] = 1.0, -share, -share * vr
    w[ladder.SLIP], w[ladder.SIGN] = 1.0, vr
    f[ladder.SLIP] = p[at.CHI] if in_slip else ladder.damping_of(p)
    f[ladder.SIGN] = p[at.MU2] * p[at.FN] if in_slip else 0.0
    _add_outer(weights[DISSIPATED], p[at.D], v1, v1)
    _add_outer(weights[DISSIPATED], 1.0, f, w)
    common = np.zeros(n)
    common[ladder.COMMON] = 1.0
    for j in range(tones):
        push = np.zeros(n)
        push[ladder.TONES + 2 * j + 1] = 1.0
        if (ground >> j) & 1:
            _add_outer(weights[DISTURBANCE], -(m1 + m2), push, common)
        else:
            _add_outer(weights[DISTURBANCE], 1.0, push, v1)
    if terms > 0:
        push, shake = np.zeros(n), np.zeros(n)
        push[ladder.TONES + 2 * tones] = shake[ladder.TONES + 2 * tones + terms] = 1.0
        _add_outer(weights[DISTURBANCE], 1.0, push, v1)
        _add_outer(weights[DISTURBANCE], -(m1 + m2), shake, common)


@kernel
def _add_outer(weight, factor, a, b):
    """Add the symmetric part of factor a b'."""
    for i in range(a.shape[0]):
        for j in range(a.shape[0]):
            weight[i, j] += 0.5 * factor * (a[i] * b[j] + a[j] * b[i])


@kernel
def _walk(p, k2, model, duration, rungs, forms, rows, z, y, work):
    """Add up both powers over one step, interval by interval between the regimes' changes."""
    tones, ground, terms = int(model[at.TONE_COUNT]), int(model[at.GROUND]), int(model[at.TERMS])
    depth, h = rungs.shape[1] - 1, model[at.TIME_STEP]
    bounds, before = np.empty((2, 2)), np.empty(z.shape[0])
    for regime in range(2):
        bounds[regime, 0], bounds[regime, 1] = ladder.bound_motion(
            p, k2, z, tones, ground, terms, h, duration, regime == 1
        )
    position, rung, end = 0, 0, 1 << depth
    work[0] = work[1] = 0.0
    for _ in range(MOST_INTERVALS):
        regime = 0 if z[ladder.SIGN] == 0.0 else 1
        for k in range(z.shape[0]):
            before[k] = z[k]
        if not ladder.attempt(p[at.VR], rungs, rows, bounds, z, y, rung, duration):
            rung += 1
            continue
        for quantity in range(2):
            work[quantity] += ladder.quadratic(forms[regime, quantity, rung], before)
        position += 1 << (depth - rung)
        rung = ladder.next_rung(position, rung, depth)
        if position == end:
            return at.OK
    return at.TOO_MANY_EVENTS
