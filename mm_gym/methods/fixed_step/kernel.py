"""Fixed-step methods on the smooth plants, kept to show what the others save.

Lanes are taken LANES at a time, side by side through all substeps.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation.jets import jet_value
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.elementary import cosine_and_sine
from mm_gym.lanes.groups import read, write_state
from mm_gym.lanes.simd import LANES, element, everywhere, with_element
from mm_gym.lanes.simd_masks import none, where
from mm_gym.law.carriage_spring import escape_distance, has_escaped
from mm_gym.law.motion import control_forces, rates, read_coefficients

SUBSTEPS, IS_FINITE = layout.MODEL_OWN, layout.MODEL_OWN + 1


@borrowing_kernel
def propagate_rk4(model, lanes, first, last):
    """Advance the lanes by one sample interval with the classical method of Kutta (1901)."""
    prefer_widest_vectors()
    stay_apart()
    substeps, finite, status = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0, layout.OK
    h = model[layout.SAMPLE_INTERVAL] / substeps
    half, sixth = 0.5 * h, h / 6.0
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        p, (x1, x2, v1, v2) = _constants(model, lanes, i, count), _state(lanes, i, count)
        escape = _escape_distances(lanes, i, count, model[layout.SAMPLE_INTERVAL])
        may_escape = not none(escape < np.inf)
        for k in range(substeps):
            start, middle, end = (
                _excitation(model, lanes, i, count, k * h),
                _excitation(model, lanes, i, count, (k + 0.5) * h),
                _excitation(model, lanes, i, count, (k + 1.0) * h),
            )
            a1, a2 = _field(p, finite, start, x1, x2, v1, v2)
            p1, p2 = v1 + half * a1, v2 + half * a2
            b1, b2 = _field(p, finite, middle, x1 + half * v1, x2 + half * v2, p1, p2)
            q1, q2 = v1 + half * b1, v2 + half * b2
            c1, c2 = _field(p, finite, middle, x1 + half * p1, x2 + half * p2, q1, q2)
            r1, r2 = v1 + h * c1, v2 + h * c2
            d1, d2 = _field(p, finite, end, x1 + h * q1, x2 + h * q2, r1, r2)
            y1 = x1 + sixth * (v1 + 2.0 * (p1 + q1) + r1)
            y2 = x2 + sixth * (v2 + 2.0 * (p2 + q2) + r2)
            w1 = v1 + sixth * (a1 + 2.0 * (b1 + c1) + d1)
            w2 = v2 + sixth * (a2 + 2.0 * (b2 + c2) + d2)
            if may_escape:
                y1, y2, w1, w2 = _unless_escaped(escape, (x1, x2, v1, v2), (y1, y2, w1, w2))
            x1, x2, v1, v2 = y1, y2, w1, w2
        status = max(status, write_state(lanes, i, count, x1, x2, v1, v2))
        if may_escape:
            status = max(status, _status(escape, x1, v1, count))
    return status


@borrowing_kernel
def propagate_semi_implicit_euler(model, lanes, first, last):
    """Advance the lanes by a sample interval: velocities, then positions with the new ones."""
    prefer_widest_vectors()
    stay_apart()
    substeps, finite, status = int(model[SUBSTEPS]), model[IS_FINITE] > 0.0, layout.OK
    h = model[layout.SAMPLE_INTERVAL] / substeps
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        p, (x1, x2, v1, v2) = _constants(model, lanes, i, count), _state(lanes, i, count)
        escape = _escape_distances(lanes, i, count, model[layout.SAMPLE_INTERVAL])
        may_escape = not none(escape < np.inf)
        for k in range(substeps):
            a1, a2 = _field(p, finite, _excitation(model, lanes, i, count, k * h), x1, x2, v1, v2)
            w1, w2 = v1 + h * a1, v2 + h * a2
            y1, y2 = x1 + h * w1, x2 + h * w2
            if may_escape:
                y1, y2, w1, w2 = _unless_escaped(escape, (x1, x2, v1, v2), (y1, y2, w1, w2))
            x1, x2, v1, v2 = y1, y2, w1, w2
        status = max(status, write_state(lanes, i, count, x1, x2, v1, v2))
        if may_escape:
            status = max(status, _status(escape, x1, v1, count))
    return status


@inlined_kernel
def _escape_distances(lanes, i, count, duration):
    """Return the escape distances [m] of the lanes i .. i + count - 1, infinite where none is."""
    distances = everywhere(np.inf)
    for k in range(count):
        m1, k1 = lanes[layout.M1, i + k], lanes[layout.K1, i + k]
        alpha, beta = lanes[layout.ALPHA, i + k], lanes[layout.BETA, i + k]
        distances = with_element(distances, k, escape_distance(m1, k1, alpha, beta, duration))
    return distances


@inlined_kernel
def _unless_escaped(escape, before, after):
    """Return the state after a substep, or before it where the carriage has escaped by then."""
    x1, x2, v1, v2 = before
    y1, y2, w1, w2 = after
    gone = has_escaped(x1, v1, escape)
    return where(gone, x1, y1), where(gone, x2, y2), where(gone, v1, w1), where(gone, v2, w2)


@borrowing_kernel
def _status(escape, x1, v1, count):
    """Return the status of lanes of which some may have escaped."""
    for k in range(count):
        if has_escaped(element(x1, k), element(v1, k), element(escape, k)):
            return layout.ESCAPED
    return layout.OK


@inlined_kernel
def _state(lanes, i, count):
    """Return the state of the lanes i .. i + count - 1."""
    x1, x2 = read(lanes, layout.X1, i, count), read(lanes, layout.X2, i, count)
    return x1, x2, read(lanes, layout.V1, i, count), read(lanes, layout.V2, i, count)


@inlined_kernel
def _constants(model, lanes, i, count):
    """Return the coefficients of the lanes i .. i + count - 1, damping, and the forces held [N]."""
    p, held = read_coefficients(lanes, i, count), read(lanes, layout.FORCE, i, count)
    return p, read(lanes, layout.C, i, count), control_forces(model, held)


@inlined_kernel
def _field(p, finite, excitation, x1, x2, v1, v2):
    """Return the accelerations [m/s^2] under a force held and an excitation."""
    (force, ground), (own, c, (pair, held)) = excitation, p
    link = fma(c, v2 - v1, pair)
    return rates(own, finite, x1, x2 - x1, v1, link, held + force, ground)


@inlined_kernel
def _excitation(model, lanes, i, count, elapsed):
    """Return force [N] and acceleration of the ground [m/s^2] some time [s] into an interval."""
    force, ground = everywhere(0.0), everywhere(0.0)
    if model[layout.TERMS] > 0.0 or model[layout.HARMONIC_COUNT] > 0.0:
        for k in range(count):
            pushed, shaken = _excitation_of(model, lanes, elapsed, i + k)
            force, ground = with_element(force, k, pushed), with_element(ground, k, shaken)
    return force, ground


@borrowing_kernel
def _excitation_of(model, lanes, elapsed, i):
    """Return the same of one lane."""
    terms, part = int(model[layout.TERMS]), elapsed / model[layout.SAMPLE_INTERVAL]
    force = jet_value(lanes, int(model[layout.JETS]), terms, part, i)
    ground = jet_value(lanes, int(model[layout.JETS]) + terms, terms, part, i)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        c, s = cosine_and_sine(lanes[harmonic + layout.FREQUENCY, i] * elapsed)
        value = lanes[harmonic + layout.SINE, i] * c
        value += lanes[harmonic + layout.COSINE, i] * s
        value *= lanes[harmonic + layout.AMPLITUDE, i]
        if (int(model[layout.GROUND]) >> j) & 1:
            ground += value
        else:
            force += value
    return force, ground
