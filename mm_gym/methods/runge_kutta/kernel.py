"""Embedded Runge-Kutta steps for every law of motion, over vectors of lanes.

Lanes are taken LANES at a time through a few equal steps. A lane whose error estimate is above the
limit, or whose friction may change its regime, waits in a slot of another vector, in which each
lane has steps of its own; events are found for all of its lanes at once. What is still in doubt
after many steps is left to the Taylor series. A lane's result follows from its own numbers.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.elementary import on_circle
from mm_gym.lanes.groups import read, write_states
from mm_gym.lanes.simd import LANES, alike, element, everywhere, root, with_element
from mm_gym.lanes.simd_masks import all_hold, bits, larger, lowest, smaller, where
from mm_gym.lanes.simd_memory import rows_on_stack
from mm_gym.law.forces import slip_intercept, stiffness
from mm_gym.law.motion import Coefficients, is_resolved, rates
from mm_gym.methods.runge_kutta import layout as of
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as series

MOST_STEPS = 24.0
"""Steps of a waiting lane before the Taylor series takes over: their errors add up."""

_ALL = (1 << LANES) - 1
LEAST = 1.0 / 16.0
"""Part of the sample interval's error that any step may have, however short."""

NEWTON_STEPS = 5
"""For the time of an event, on the cubic: the step to it corrects what is left."""

_TO_QUARTERS = 2.0 / math.pi

_group, _waiting = rows_on_stack(of.SIZE), rows_on_stack(of.SIZE)


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    if not model[of.STEPS] > 0.0:
        return taylor.propagate(model, lanes, first, last)
    b, w, idle, status = _group(), _waiting(), _ALL, at.OK
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        _load(model, lanes, i, count, b)
        stopped = _advance(model, b)
        if stopped == 0 and count == LANES:
            write_states(lanes, i, b[0], b[1], b[2], b[3])
            continue
        for k in range(count):
            if (stopped >> k) & 1 == 0:
                for row in range(4):
                    lanes[row, i + k] = element(b[row], k)
                continue
            while idle == 0:
                idle, status = _walk(model, lanes, w, idle, status)
            _wait(model, b, k, w, idle, i + k)
            idle &= idle - 1
    while idle != _ALL:
        idle, status = _walk(model, lanes, w, idle, status)
    return status


@borrowing_kernel
def shorten(model, piece):
    """Give a piece of a sample interval its part of the tolerance."""
    taylor.shorten(model, piece)
    if model[of.STEPS] > 0.0:
        part = piece[at.SAMPLE_INTERVAL] / model[at.SAMPLE_INTERVAL]
        piece[of.LIMIT] = model[of.LIMIT] * part


@borrowing_kernel
def _load(model, lanes, i, count, b):
    """Load the state and the coefficients of a group of lanes."""
    for row in range(4):
        b[of.STATE + row] = read(lanes, row, i, count)
    stretch = read(lanes, at.STRETCH, i, count)
    k1, k0 = read(lanes, at.K1, i, count), read(lanes, at.K0, i, count)
    b[of.BY_M1] = 1.0 / read(lanes, at.M1, i, count)
    b[of.BY_M2] = 1.0 / read(lanes, at.M2, i, count)
    b[of.LINEAR] = k1 * read(lanes, at.ALPHA, i, count)
    b[of.CUBIC] = k1 * read(lanes, at.BETA, i, count)
    b[of.D] = read(lanes, at.D, i, count)
    b[of.SLOPE], b[of.INTERCEPT] = read(lanes, at.C, i, count), everywhere(0.0)
    if model[series.IS_FINITE] > 0.0:
        b[of.TWICE_K0] = k0 + k0
        b[of.BY_L0], b[of.STRETCH] = 1.0 / read(lanes, at.L0, i, count), stretch
    else:
        b[of.K2] = where(k0 > 0.0, stiffness(k0, stretch), 0.0)
    b[of.FORCE] = read(lanes, at.FORCE, i, count)
    if model[series.HAS_FRICTION] > 0.0:
        vr, chi = read(lanes, at.VR, i, count), read(lanes, at.CHI, i, count)
        kinetic = read(lanes, at.KINETIC_FORCE, i, count)
        b[of.VR], b[of.CREEP], b[of.CHI] = vr, b[of.SLOPE], chi
        b[of.SLIPPING] = slip_intercept(kinetic, chi, vr)
        slip = b[of.STATE + 3] - b[of.STATE + 2]
        zero, one = everywhere(0.0), everywhere(1.0)
        _enter(b, where(slip > vr, one, where(slip < -vr, -one, zero)))
    terms = 2 * int(model[at.TERMS])
    for n in range(terms):
        b[of.SOURCES + n] = read(lanes, int(model[at.JETS]) + n, i, count)
    for j in range(int(model[at.HARMONIC_COUNT])):
        row, harmonic = (
            of.SOURCES + terms + of.HARMONIC_ROWS * j,
            at.HARMONICS + at.HARMONIC_ROWS * j,
        )
        b[row] = read(lanes, harmonic + at.AMPLITUDE, i, count)
        b[row + 1] = read(lanes, harmonic + at.FREQUENCY, i, count)
        b[row + 2] = read(lanes, harmonic + at.COSINE, i, count)
        b[row + 3] = read(lanes, harmonic + at.SINE, i, count)


@inlined_kernel
def _enter(b, regime):
    """Write a regime, and the line that friction follows in it."""
    b[of.REGIME] = regime
    b[of.SLOPE] = where(regime == 0.0, b[of.CREEP], b[of.CHI])
    b[of.INTERCEPT] = regime * b[of.SLIPPING]


@borrowing_kernel
def _advance(model, b):
    """Advance a group by equal steps; return the bits of the lanes that stop on the way.

    STATE and ELAPSED are those where a lane stops, NEXT and TARGET are for its next step. It makes
    the step that it stopped at again and again, with the same result, while others go on.
    """
    count, friction = int(model[of.STEPS]), model[series.HAS_FRICTION] > 0.0
    length = model[at.SAMPLE_INTERVAL] / count
    b[of.LENGTH], b[of.NEXT] = everywhere(length), everywhere(0.5 * length)
    b[of.ELAPSED], b[of.TARGET], b[of.SHIFT] = everywhere(0.0), everywhere(0.0), everywhere(0.0)
    good = b[of.LENGTH] > 0.0
    for k in range(count):
        _step(model, b)
        good = b[of.GOOD] > 0.0
        if friction:
            _judge(model, b)
            good = good & (b[of.VERDICT] == of.STAYS)
        for row in range(4):
            b[of.STATE + row] = where(good, b[of.END + row], b[of.STATE + row])
        b[of.ELAPSED] = where(good, (k + 1) * length, b[of.ELAPSED])
    return _ALL - bits(good)


@borrowing_kernel
def _step(model, b):
    """Step from the state to the end, each lane by its length; tell whether the error is small."""
    prefer_widest_vectors()
    stay_apart()
    p = Coefficients(
        b[of.BY_M1],
        b[of.BY_M2],
        b[of.LINEAR],
        b[of.CUBIC],
        b[of.D],
        b[of.SLOPE],
        b[of.INTERCEPT],
        b[of.K2],
        b[of.TWICE_K0],
        b[of.BY_L0],
        b[of.STRETCH],
    )
    x1, x2, v1, v2 = b[of.STATE], b[of.STATE + 1], b[of.STATE + 2], b[of.STATE + 3]
    h, is_finite, is_excited = b[of.LENGTH], model[series.IS_FINITE] > 0.0, _is_excited(model)
    push, shake, slot, stages = b[of.FORCE], alike(h, 0.0), of.TABLEAU, int(model[of.STAGES])
    y1, y2, w1, w2 = x1, x2, v1, v2
    for i in range(stages + 1):
        c, slot = model[slot], slot + 1
        q1 = q2 = r1 = r2 = alike(h, 0.0)
        for j in range(i):
            velocity, position, slot = model[slot], model[slot + 1], slot + 2
            a1, a2 = b[of.FIRST + j], b[of.SECOND + j]
            q1, q2 = fma(velocity, a1, q1), fma(velocity, a2, q2)
            r1, r2 = fma(position, a1, r1), fma(position, a2, r2)
        w1, w2 = fma(h, q1, v1), fma(h, q2, v2)
        y1, y2 = fma(h, fma(h, r1, c * v1), x1), fma(h, fma(h, r2, c * v2), x2)
        if is_excited:
            push, shake = _excitation(model, b, fma(c, h, b[of.ELAPSED]))
        a1, a2 = rates(p, is_finite, y1, y2 - y1, w1, w2 - w1, push, shake)
        b[of.FIRST + i], b[of.SECOND + i] = a1, a2
    b[of.END], b[of.END + 1], b[of.END + 2], b[of.END + 3] = y1, y2, w1, w2
    far = larger(larger(abs(x1), abs(x2)), larger(abs(y1), abs(y2)))
    fast = larger(larger(abs(v1), abs(v2)), larger(abs(w1), abs(w2)))
    q1, q2, r1, r2 = _estimate(b, model, slot, stages)
    o1, o2, s1, s2 = _estimate(b, model, slot + 2 * (stages + 1), stages)
    change, shift = larger(abs(q1), abs(q2)) * h, larger(abs(r1), abs(r2)) * h * h
    other = larger(abs(o1), abs(o2)) * h
    if model[of.IS_COMBINED] > 0.0:  # Hairer, Norsett and Wanner (1993), II.10
        change = _combined(change, other)
        shift = _combined(shift, larger(abs(s1), abs(s2)) * h * h)
    limit = model[of.LIMIT] * larger(h * (1.0 / model[at.SAMPLE_INTERVAL]), alike(h, LEAST))
    good = (shift <= limit * far) & (change <= limit * fast)
    # One estimate can vanish by chance where steps are too long, two hardly. At a turning point the
    # speed is that of the oscillation.
    a1, a2, e1, e2 = b[of.FIRST], b[of.SECOND], b[of.FIRST + stages], b[of.SECOND + stages]
    steep = larger(larger(abs(a1), abs(a2)), larger(abs(e1), abs(e2)))
    good = good & (other * other <= model[of.COARSE] * fma(fast, fast, steep * far))
    if is_finite:
        good = good & is_resolved(p, x2 - x1, y2 - y1)
    b[of.GOOD] = where(good & (far + fast < np.inf), alike(h, 1.0), alike(h, 0.0))


@inlined_kernel
def _estimate(b, model, slot, stages):
    """Return an estimate of the errors of velocities over h, and of positions over h^2."""
    q1 = q2 = r1 = r2 = alike(b[of.LENGTH], 0.0)
    for j in range(stages + 1):
        a1, a2 = b[of.FIRST + j], b[of.SECOND + j]
        velocity, position = model[slot + 2 * j], model[slot + 2 * j + 1]
        q1, q2 = fma(velocity, a1, q1), fma(velocity, a2, q2)
        r1, r2 = fma(position, a1, r1), fma(position, a2, r2)
    return q1, q2, r1, r2


@inlined_kernel
def _combined(fifth, third):
    """Return an estimate of eighth order from those of the fifth and the third, all positive."""
    both = root(fma(fifth, fifth, 0.01 * third * third))
    return where(both > 0.0, fifth * fifth / both, both)


@inlined_kernel
def _is_excited(model):
    return model[at.TERMS] + model[at.HARMONIC_COUNT] > 0.0


@borrowing_kernel
def _excitation(model, b, time):
    """Return force [N] and ground acceleration [m/s^2] at a time [s] since the interval's start."""
    terms, fraction = int(model[at.TERMS]), time * (1.0 / model[at.SAMPLE_INTERVAL])
    push, shake = alike(time, 0.0), alike(time, 0.0)
    for n in range(terms - 1, -1, -1):
        push = fma(push, fraction, b[of.SOURCES + n])
        shake = fma(shake, fraction, b[of.SOURCES + terms + n])
    for j in range(int(model[at.HARMONIC_COUNT])):
        row = of.SOURCES + 2 * terms + of.HARMONIC_ROWS * j
        cosine, sine = on_circle(b[row + 1] * time * _TO_QUARTERS)
        value = b[row] * fma(b[row + 3], cosine, b[row + 2] * sine)
        if (int(model[at.GROUND]) >> j) & 1:
            shake = shake + value
        else:
            push = push + value
    return push + b[of.FORCE], shake


@borrowing_kernel
def _judge(model, b):
    """Tell whether the slip velocity leaves its regime in the step, and predict when and where.

    It is taken as the cubic of Hermite: its coefficients over a step, in Bernstein's form, bound
    it, and what changes their sign once has one root.
    """
    stay_apart()
    h, vr, regime = b[of.LENGTH], b[of.VR], b[of.REGIME]
    third = (1.0 / 3.0) * h
    c0, c3 = b[of.STATE + 3] - b[of.STATE + 2], b[of.END + 3] - b[of.END + 2]
    last = int(model[of.STAGES])
    c1 = fma(b[of.SECOND] - b[of.FIRST], third, c0)
    c2 = fma(b[of.FIRST + last] - b[of.SECOND + last], third, c3)
    bend = abs(fma(-2.0, c1, c0 + c2)) + abs(fma(-2.0, c2, c1 + c3))
    margin, zero, one = model[of.BEND] * bend, alike(h, 0.0), alike(h, 1.0)
    sticks = regime == 0.0
    side = where(sticks, where(c3 > 0.0, one, -one), regime)
    inwards, edge = where(sticks, -side, side), where(sticks, vr, -vr)
    g0 = larger(fma(inwards, c0, edge), zero)
    g1, g2, g3 = fma(inwards, c1, edge), fma(inwards, c2, edge), fma(inwards, c3, edge)
    # In stick the other boundary must be out of reach.
    other = vr + smaller(side * c1, smaller(side * c2, side * c3))
    clear = where(sticks, other, one) > where(sticks, margin, zero)
    stays = (smaller(g1, smaller(g2, g3)) > margin) & clear
    b[of.VERDICT] = where(stays, of.STAYS, alike(h, of.MAY_LEAVE))
    if all_hold(stays):
        return
    leaves = (g3 < -margin) & (larger(g1, -g2) >= 0.0) & clear
    b[of.VERDICT] = where(leaves, of.LEAVES, b[of.VERDICT])
    t = g0 / (g0 - g3)
    d1, d2, d3 = 3.0 * (g1 - g0), 3.0 * fma(-2.0, g1, g0 + g2), fma(3.0, g1 - g2, g3 - g0)
    low, high = zero, one
    for _ in range(NEWTON_STEPS):
        value = fma(fma(fma(d3, t, d2), t, d1), t, g0)
        slope = fma(fma(3.0 * d3, t, 2.0 * d2), t, d1)
        low, high = where(value >= 0.0, t, low), where(value < 0.0, t, high)
        t = t - value / slope
        t = where((t > low) & (t < high), t, 0.5 * (low + high))
    b[of.TARGET] = where(leaves, side, zero)
    b[of.NEXT] = where(leaves, t, 0.5) * h


@borrowing_kernel
def _wait(model, b, k, w, idle, lane):
    """Let lane k of a group wait in the first of the idle slots."""
    sources = 2 * int(model[at.TERMS]) + of.HARMONIC_ROWS * int(model[at.HARMONIC_COUNT])
    slot = lowest(idle)
    for row in range(of.SOURCES + sources):
        if row < of.END or row >= of.COEFFICIENTS:
            number = element(b[row], k)
            # All slots have numbers from the beginning, so that none costs time as a denormal one.
            w[row] = everywhere(number) if idle == _ALL else with_element(w[row], slot, number)
    w[of.LENGTH] = with_element(w[of.LENGTH], slot, element(b[of.NEXT], k))
    w[of.LANE] = with_element(w[of.LANE], slot, float(lane))
    w[of.COUNT] = with_element(w[of.COUNT], slot, 0.0)


@borrowing_kernel
def _walk(model, lanes, w, idle, status):
    """Let all lanes that wait make a step; return the idle slots and the status."""
    _step(model, w)
    if model[series.HAS_FRICTION] > 0.0:
        _follow(model, w)
    else:
        w[of.NEXT] = 0.5 * w[of.LENGTH]
    _conclude(model, w)
    busy = _ALL - idle
    while busy != 0:
        slot = lowest(busy)
        busy &= busy - 1
        outcome = element(w[of.OUTCOME], slot)
        if outcome != of.GOES_ON:
            lane = int(element(w[of.LANE], slot))
            if outcome == of.DONE:
                for row in range(4):
                    lanes[row, lane] = element(w[row], slot)
            else:
                status = max(status, taylor.propagate(model, lanes, lane, lane + 1))
            idle |= 1 << slot
    return idle, status


@borrowing_kernel
def _follow(model, w):
    """Accept steps in one regime and steps to its boundary; the latter enter the next regime.

    What a step to the boundary misses it by, its last accelerations correct.
    """
    target, h, last, zero = w[of.TARGET] + 0.0, w[of.LENGTH], int(model[of.STAGES]), everywhere(0.0)
    a1, a2 = w[of.FIRST + last], w[of.SECOND + last]
    x1, x2, v1, v2 = w[of.END], w[of.END + 1], w[of.END + 2], w[of.END + 3]
    _judge(model, w)
    to_boundary = target * target * w[of.GOOD]
    within = w[of.GOOD] - to_boundary
    # Outwards from stick, inwards from slip; else the boundary is passed for the second time.
    towards = where(w[of.REGIME] == 0.0, target, -target) * (a2 - a1) > 0.0
    missed = fma(target, w[of.VR], v1 - v2) / (a2 - a1)
    arrives = where(towards & (abs(missed) <= model[of.NEAR]), to_boundary, zero)
    shift = where(arrives > 0.0, missed, zero)
    w[of.END], w[of.END + 1] = _shifted(shift, x1, v1, a1), _shifted(shift, x2, v2, a2)
    w[of.END + 2], w[of.END + 3] = fma(shift, a1, v1), fma(shift, a2, v2)
    _enter(w, where(arrives > 0.0, target - w[of.REGIME], w[of.REGIME]))
    again = where(towards, h + missed, 0.5 * h)
    following = where(to_boundary > arrives, again, w[of.NEXT])
    w[of.NEXT] = where(w[of.GOOD] > 0.0, following, 0.5 * h)
    leaves = where(w[of.VERDICT] == of.LEAVES, within, zero)
    w[of.TARGET] = where(to_boundary > arrives, target, leaves * w[of.TARGET])
    w[of.GOOD] = where(w[of.VERDICT] == of.STAYS, within, zero) + arrives
    w[of.SHIFT] = shift


@inlined_kernel
def _shifted(time, x, v, a):
    """Return a position a short time later."""
    return fma(time, fma(0.5 * time, a, v), x)


@borrowing_kernel
def _conclude(model, w):
    """Make the accepted steps, and choose the lengths of the next ones."""
    h, shift, is_good = w[of.LENGTH], w[of.SHIFT], w[of.GOOD] > 0.0
    rest = model[at.SAMPLE_INTERVAL] - w[of.ELAPSED]
    is_last = is_good & (h >= rest) & (shift == 0.0)
    for row in range(4):
        w[row] = where(is_good, w[of.END + row], w[row])
    w[of.ELAPSED] = where(is_good, w[of.ELAPSED] + h + shift, w[of.ELAPSED])
    rest = model[at.SAMPLE_INTERVAL] - w[of.ELAPSED]
    # A step to an event was short for another reason than its error.
    longer = where(shift == 0.0, h + h, model[at.SAMPLE_INTERVAL] / model[of.STEPS])
    w[of.LENGTH] = smaller(where(is_good, longer, w[of.NEXT]), rest)
    w[of.COUNT] = w[of.COUNT] + 1.0
    lasts = (w[of.COUNT] < MOST_STEPS) & (w[of.LENGTH] > 0.0)
    outcome = where(lasts, of.GOES_ON, everywhere(of.GIVEN_UP))
    w[of.OUTCOME] = where(is_last, of.DONE, outcome)
