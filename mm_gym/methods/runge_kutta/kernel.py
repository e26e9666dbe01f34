"""Embedded Runge-Kutta steps for every law of motion, over vectors of lanes.

They are compiled for each law, and have code for nothing else.

Lanes are taken some vectors at a time, which go through the stages of a step side by side. Each
lane has steps of its own: their lengths follow from its error estimates, and from when friction
changes its regime. When most of the lanes have arrived, the others wait in the slots of another
group until these are full. What is still in doubt after many steps is left to the Taylor series. A
lane's result follows from its own numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation import sources
from mm_gym.excitation.sources import excitation, load_sources, rows_of_sources
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write, write_states
from mm_gym.lanes.simd import LANES, alike, everywhere, near_root, rough_quotient, rough_root
from mm_gym.lanes.simd_masks import (
    all_hold,
    bits,
    how_many,
    larger,
    lowest,
    none,
    smaller,
    where,
)
from mm_gym.lanes.simd_memory import from_row, lane_copier, rows_on_stack
from mm_gym.law.dry_friction import slip_intercept
from mm_gym.law.interface import (
    Law,
    force_of,
    has_friction,
    is_excited,
    is_finite,
    is_line,
    own_at,
    own_states_of,
    parameters_of,
    rates_of,
    resolves,
    state_row,
    states_of,
)
from mm_gym.law.motion import Coefficients, control_forces, rates, read_coefficients
from mm_gym.law.springs import is_resolved
from mm_gym.methods.runge_kutta import layout as slots
from mm_gym.methods.runge_kutta.tableau_kernel import estimated, summed
from mm_gym.methods.taylor import kernel as taylor
from mm_gym.methods.taylor import layout as series

if TYPE_CHECKING:
    from collections.abc import Callable

VECTORS = 2
"""Vectors of a group: the arithmetic of one hides the latency of another's."""

MOST_STEPS = 24.0
"""Steps of a lane before the Taylor series takes over: their errors add up."""

MOST_STEPS_ALONE = 20_000.0
"""Steps of a lane before giving up, where there is no series."""

TINY = 1e-300
"""Added to what errors are divided by: at rest both are 0."""

LEAST = 1.0 / 16.0
"""Part of the sample interval's error that any step may have, however short."""

LEAST_ALONE = 1.0 / 256.0
"""The same where there is no series, and so may be more steps."""

ROUND_OFF = 2.0**-50
"""Smallest relative error that a step is asked for: estimates have that much of rounding."""

LONGEST_WAY, LONGEST_WAY_OF_BOTH = 2.0, 0.5
"""Of a step along what an interface's force bends over; with two estimates, which smaller errors
need."""

SAFETY, LONGER, SHORTER = 0.9, 4.0, 0.125
"""Of the next step: what is left of the length that would just do, and its limits."""

NEARLY_COLLAPSED = 0.99
"""Part of the way to the collapse of a spring, from which steps that are too many are its."""

REMAINDER, ASTRAY, ASLANT = 1.0 / 16.0, 2.0, 0.25
"""Largest error of a velocity between the ends of a step. Of Hermite's cubic, h^4 / 384 of the
fourth derivative: of what a slip velocity may differ from it, and of the way, over h, by which its
integral misses the end, h^5 / 720. Of the polynomial of fifth degree: of what this differs from the
cubic, and of what its slope misses an early stage by, of which the error is a sixth."""

KNOWN = 3.0
"""How much larger it may be than the estimated error of a whole step, which says less."""

EARLY, LATE = 5, 9
"""Stages of the pair of eighth order that are exact to the fifth, at 1 / 3 and at 0.6 of a step."""

_GROUP = VECTORS * LANES
_ALL = (1 << _GROUP) - 1
_copy_lane = lane_copier(slots.MOVED)
_group, _waiting = rows_on_stack(VECTORS * slots.SIZE), rows_on_stack(VECTORS * slots.SIZE)


def propagate_with(law: Law) -> Callable[..., int]:
    """Return the kernel of a law of motion."""

    @borrowing_kernel
    def propagate(model, lanes, first, last):
        """Advance the lanes by one sample interval; force and stretch are held over it."""
        if model[slots.STEPS] > 0.0:
            return _propagate(law, model, lanes, first, last)
        # It has no plan for an interval of this length.
        if is_line(law):
            return taylor.propagate(model, lanes, first, last)
        return layout.TOO_MANY_STEPS

    return propagate


@inlined_kernel
def _propagate(law, model, lanes, first, last):
    """Advance the lanes by one sample interval."""
    b, w, idle, status = _group(), _waiting(), _ALL, layout.OK
    for i in range(first, last, _GROUP):
        count = min(_GROUP, last - i)
        for k in range(0, count, LANES):
            _load(law, model, lanes, i + k, min(LANES, count - k), _vector_of(b, k))
        everyone = busy = (1 << count) - 1
        while 2 * how_many(busy) > count:
            _walk(law, model, b, count)
            busy = everyone & _those(b, count, slots.GOES_ON)
        for k in range(0, count, LANES):
            _store(law, model, lanes, i + k, min(LANES, count - k), _vector_of(b, k))
        busy = everyone - (everyone & _those(b, count, slots.DONE))
        while busy != 0:
            while idle == 0:
                idle, status = _empty(law, model, lanes, w, idle, status)
            slot, k = lowest(idle), lowest(busy)
            if idle == _ALL:  # numbers in all slots, so that none costs time as a denormal one
                for other in range(_GROUP - 1, 0, -1):
                    _move(law, model, b, k, w, other)
            _move(law, model, b, k, w, slot)
            _vector_of(w, slot)[slots.LANE, slot % LANES] = i + k
            idle, busy = idle & (idle - 1), busy & (busy - 1)
    while idle != _ALL:
        idle, status = _empty(law, model, lanes, w, idle, status)
    return status


@borrowing_kernel
def shorten(model, piece):
    """Give a piece of a sample interval its part of the tolerance."""
    taylor.shorten(model, piece)
    if model[slots.STEPS] > 0.0:
        part = piece[layout.SAMPLE_INTERVAL] / model[layout.SAMPLE_INTERVAL]
        piece[slots.LIMIT] = model[slots.LIMIT] * part


@inlined_kernel
def _vector_of(group, k):
    """Return the rows of the vector in a group that lane k is in."""
    return from_row(group, k // LANES * slots.SIZE)


@inlined_kernel
def _those(group, count, outcome):
    """Return the bits of the lanes of a group with an outcome."""
    found = 0
    for k in range(0, count, LANES):
        found |= bits(_vector_of(group, k)[slots.OUTCOME] == outcome) << k
    return found


@borrowing_kernel
def _load(law, model, lanes, i, count, b):
    """Load the state and the coefficients of a vector of lanes."""
    states = states_of(law)
    for k in range(states):
        b[slots.STATE + k] = read(lanes, state_row(model, k, states), i, count)
    write_coefficients(b, read_coefficients(lanes, i, count))
    b[slots.PAIR], b[slots.FORCE] = control_forces(model, read(lanes, layout.FORCE, i, count))
    if is_line(law):
        b[slots.SLOPE], b[slots.INTERCEPT] = read(lanes, layout.C, i, count), b[slots.PAIR]
    else:
        for k in range(parameters_of(law)):
            b[slots.PARAMETERS + k] = read(lanes, int(model[layout.INTERFACE]) + k, i, count)
    if has_friction(law):
        vr, chi = read(lanes, layout.VR, i, count), read(lanes, layout.CHI, i, count)
        kinetic = read(lanes, layout.KINETIC_FORCE, i, count)
        b[slots.VR], b[slots.CREEP], b[slots.CHI] = vr, b[slots.SLOPE], chi
        b[slots.SLIPPING] = slip_intercept(kinetic, chi, vr)
        slip = b[slots.STATE + 3] - b[slots.STATE + 2]
        zero, one = everywhere(0.0), everywhere(1.0)
        _enter(b, where(slip > vr, one, where(slip < -vr, -one, zero)))
    if _is_excited(law, model):
        load_sources(model, lanes, i, count, b, slots.SOURCES)
    b[slots.OUTCOME] = everywhere(slots.GOES_ON)
    for row in (slots.ELAPSED, slots.COUNT, slots.TARGET, slots.NEXT, slots.SHIFT, slots.ARRIVES):
        b[row] = everywhere(0.0)
    set_length(b, everywhere(model[layout.SAMPLE_INTERVAL] / model[slots.STEPS]))
    write_kicks(law, b, slots.KICKS, first_kicks(law, model, b))


@borrowing_kernel
def _store(law, model, lanes, i, count, b):
    """Write the states of those lanes of a vector that are done."""
    done = b[slots.OUTCOME] == slots.DONE
    states, first = states_of(law), 0
    if count == LANES and all_hold(done):
        write_states(lanes, i, b[0], b[1], b[2], b[3])
        first = slots.OWN
    for k in range(first, states):
        row = state_row(model, k, states)
        write(lanes, row, i, count, where(done, b[k], read(lanes, row, i, count)))


@inlined_kernel
def write_coefficients(b, p):
    """Write `law.motion.Coefficients`, numbers of any kind."""
    b[slots.ONE_BY_M1], b[slots.ONE_BY_M2], b[slots.LINEAR] = p.by_m1, p.by_m2, p.linear
    b[slots.CUBIC], b[slots.D], b[slots.K2] = p.cubic, p.d, p.k2
    b[slots.TWICE_K0], b[slots.BY_L0], b[slots.STRETCH] = p.twice_k0, p.by_l0, p.stretch


@inlined_kernel
def set_length(b, h):
    """Write the length of the next step [s]."""
    b[slots.LENGTH], b[slots.BY_M1], b[slots.BY_M2] = (
        h,
        h * b[slots.ONE_BY_M1],
        h * b[slots.ONE_BY_M2],
    )


@inlined_kernel
def _enter(b, regime):
    """Write a regime, and the line that friction follows in it."""
    b[slots.REGIME] = regime
    b[slots.SLOPE] = where(regime == 0.0, b[slots.CREEP], b[slots.CHI])
    b[slots.INTERCEPT] = fma(regime, b[slots.SLIPPING], b[slots.PAIR])


@borrowing_kernel
def _move(law, model, b, k, w, slot):
    """Copy lane k of a group to a slot of another."""
    one, other = _vector_of(b, k), _vector_of(w, slot)
    k, slot = k % LANES, slot % LANES
    _copy_lane(one, k, other, slot)
    if _is_excited(law, model):
        for row in range(slots.SOURCES, slots.SOURCES + rows_of_sources(model)):
            other[row, slot] = one[row, k]
    for row in range(own_states_of(law)):
        other[slots.OWN_KICKS + row, slot] = one[slots.OWN_KICKS + row, k]
    for row in range(parameters_of(law)):
        other[slots.PARAMETERS + row, slot] = one[slots.PARAMETERS + row, k]


@borrowing_kernel
def _empty(law, model, lanes, w, idle, status):
    """Let all lanes that wait make a step; return the idle slots and the status."""
    _walk(law, model, w, _GROUP)
    busy = _ALL - idle
    done = busy - (busy & _those(w, _GROUP, slots.GOES_ON))
    idle |= done
    while done != 0:
        slot = lowest(done)
        done &= done - 1
        own, k = _vector_of(w, slot), slot % LANES
        lane = int(own[slots.LANE, k])
        if own[slots.OUTCOME, k] == slots.DONE:
            for row in range(states_of(law)):
                lanes[state_row(model, row, states_of(law)), lane] = own[row, k]
        elif is_line(law):
            status = max(status, taylor.propagate(model, lanes, lane, lane + 1))
        elif _is_finite(law, model) and _collapses(own, k):
            status = max(status, layout.COLLAPSED)
        else:
            status = max(status, layout.TOO_MANY_STEPS)
    return idle, status


@inlined_kernel
def _collapses(own, k):
    """Tell whether a lane's offset has shortened a spring of finite stretch to next to nothing."""
    shortened = abs(own[1, k] - own[0, k]) * own[slots.BY_L0, k]
    return not shortened < NEARLY_COLLAPSED * own[slots.STRETCH, k]


@borrowing_kernel
def _walk(law, model, group, count):
    """Let the lanes of a group that go on make a step, each by its length."""
    _pass_stages(law, model, group, count)
    for k in range(0, count, LANES):
        b = _vector_of(group, k)
        _assess(law, model, b)
        if has_friction(law):
            _follow(model, b)
        _conclude(law, model, b)


@inlined_kernel
def _coefficients(b):
    """Return what the law of motion reads, with the masses for accelerations times h."""
    return Coefficients(
        b[slots.BY_M1],
        b[slots.BY_M2],
        b[slots.LINEAR],
        b[slots.CUBIC],
        b[slots.D],
        b[slots.K2],
        b[slots.TWICE_K0],
        b[slots.BY_L0],
        b[slots.STRETCH],
    )


@inlined_kernel
def _is_finite(law, model):
    """Tell whether springs are of finite stretch: the model decides where they may be."""
    return is_finite(law) and (is_line(law) or model[series.IS_FINITE] > 0.0)


@inlined_kernel
def _is_excited(law, model):
    """Tell whether anything changes within a sample interval, in the same way."""
    return is_excited(law) and (is_line(law) or sources.is_excited(model))


@inlined_kernel
def _kicks(law, model, b, time, x1, x2, v1, v2, own):
    """Return the accelerations at a time [s] since the interval's start, times the step's length.

    So they are added to velocities as they are; and the same of the interface's own states.
    """
    push, shake = b[slots.FORCE], alike(time, 0.0)
    if _is_excited(law, model):
        force, shake = excitation(model, b, slots.SOURCES, time)
        push, shake = push + force, shake * b[slots.LENGTH]
    p, offset, slip = _parameters(b), x2 - x1, v2 - v1
    link = force_of(law, p, offset, slip, own)
    if not is_line(law):  # whose intercept has it
        link = link + b[slots.PAIR]
    a1, a2 = rates(_coefficients(b), _is_finite(law, model), x1, offset, v1, link, push, shake)
    first, second = rates_of(law, p, offset, slip, own)
    return a1, a2, b[slots.LENGTH] * first, b[slots.LENGTH] * second


@inlined_kernel
def write_kicks(law, b, row, kicks):
    """Write what `_kicks` returns, for a stage by the row of its first."""
    b[row], b[row + 1] = kicks[0], kicks[1]
    for k in range(own_states_of(law)):
        b[row + slots.OWN_KICKS - slots.KICKS + k] = kicks[2 + k]


@inlined_kernel
def _parameters(b):
    """Return the rows of the interface's parameters."""
    return from_row(b, slots.PARAMETERS)


@inlined_kernel
def first_kicks(law, model, b):
    """Return them where the step begins."""
    own = own_at(law, b, slots.OWN)
    return _kicks(law, model, b, b[slots.ELAPSED], b[0], b[1], b[2], b[3], own)


@borrowing_kernel
def _pass_stages(law, model, group, count):
    """Work out the stages behind the first."""
    prefer_widest_vectors()
    stay_apart()
    for i in range(int(model[slots.STAGES])):
        for k in range(0, count, LANES):
            pass_stage(law, model, _vector_of(group, k), i)


@inlined_kernel
def pass_stage(law, model, b, i):
    """Work out a stage, and take it for the step's end."""
    h, number = b[slots.LENGTH], int(model[slots.SUM]) + i
    w1, w2, r1, r2 = summed(b, number, b[2], b[3])
    y1, y2 = fma(h, r1, b[0]), fma(h, r2, b[1])
    time, kick = fma(model[slots.TIMES + i], h, b[slots.ELAPSED]), slots.KICKS + 2 * (i + 1)
    own = own_at(law, b, slots.OWN)
    if own_states_of(law) > 0:
        first, second, _, _ = summed(_own_kicks(b), number, own[0], own[1])
        own = first, (second if own_states_of(law) > 1 else own[1])
    for k in range(own_states_of(law)):
        b[slots.END + slots.OWN + k] = own[k]
    if i + 1 == int(model[slots.STAGES]):
        b[slots.END], b[slots.END + 1], b[slots.END + 2], b[slots.END + 3] = y1, y2, w1, w2
    write_kicks(law, b, kick, _kicks(law, model, b, time, y1, y2, w1, w2, own))


@inlined_kernel
def _own_kicks(b):
    """Return the rows in which the interface's own states change as velocities do."""
    return from_row(b, slots.OWN_KICKS - slots.KICKS)


@inlined_kernel
def own_errors(law, b, number, zero):
    """Return an estimate of the errors of the interface's own states."""
    if own_states_of(law) == 0:
        return zero, zero
    first, second, _, _ = estimated(_own_kicks(b), number, zero)
    return first, (second if own_states_of(law) > 1 else zero)


@borrowing_kernel
def _assess(law, model, b):
    """Tell whether a step's error is small, and by what factor the next may be longer."""
    prefer_widest_vectors()
    stay_apart()
    x1, x2, v1, v2, h = b[0], b[1], b[2], b[3], b[slots.LENGTH]
    y1, y2, w1, w2 = b[slots.END], b[slots.END + 1], b[slots.END + 2], b[slots.END + 3]
    far = larger(larger(abs(x1), abs(x2)), larger(abs(y1), abs(y2)))
    fast = larger(larger(abs(v1), abs(v2)), larger(abs(w1), abs(w2)))
    stages = int(model[slots.STAGES])
    estimates = int(model[slots.SUM]) + stages
    zero = everywhere(0.0)
    q1, q2, r1, r2 = estimated(b, estimates, zero)
    o1, o2, s1, s2 = estimated(b, estimates + 1, zero)
    change, shift = larger(abs(q1), abs(q2)), larger(abs(r1), abs(r2)) * h
    other = larger(abs(o1), abs(o2))
    least = LEAST if is_line(law) else LEAST_ALONE
    limit = model[slots.LIMIT] * larger(h * (1.0 / model[layout.SAMPLE_INTERVAL]), alike(h, least))
    if not is_line(law):  # else what rounding leaves of balanced forces is left to the series
        limit = larger(limit, alike(h, ROUND_OFF))
        forces = fma(abs(b[slots.LINEAR]), far, abs(b[slots.FORCE]) + abs(b[slots.PAIR]))
        fast = fma(ROUND_OFF * forces, b[slots.BY_M1] / limit, fast)
    most, most_shift = limit * fast, limit * far
    # Hairer, Norsett and Wanner (1993), II.10: for forces that bend as springs do.
    if model[slots.IS_COMBINED] > 0.0 and is_line(law):
        change, most = _combined(change, other, most)
        shift, most_shift = _combined(shift, larger(abs(s1), abs(s2)) * h, most_shift)
    good = (shift <= most_shift) & (change <= most)
    # One estimate can vanish by chance where steps are too long, two hardly. At a turning point the
    # speed is that of the oscillation.
    last = slots.KICKS + 2 * stages
    a1, a2, e1, e2 = b[slots.KICKS], b[slots.KICKS + 1], b[last], b[last + 1]
    steep = larger(larger(abs(a1), abs(a2)), larger(abs(e1), abs(e2)))
    coarse = model[slots.COARSE] * fma(fast * fast, h, steep * far)
    good = good & (other * other * h <= coarse)
    if _is_finite(law, model):
        good = good & is_resolved(b[slots.BY_L0], b[slots.STRETCH], x2 - x1, y2 - y1)
    good = good & (far + fast < np.inf)
    slips = b[slots.STATE + 3] - b[slots.STATE + 2], b[slots.END + 3] - b[slots.END + 2]
    way = LONGEST_WAY_OF_BOTH if model[slots.IS_COMBINED] > 0.0 else LONGEST_WAY
    good = good & resolves(law, _parameters(b), slips[0], slips[1], way)
    slid = own_errors(law, b, estimates, zero)
    rounded = rates_of(law, _parameters(b), far, fast, (zero, zero))
    for k in range(own_states_of(law)):
        moved = abs(b[slots.OWN_KICKS + k]) * (model[layout.SAMPLE_INTERVAL] / h)
        # Where both masses move almost alike, little is left of the digits of the slip velocity.
        moved = fma(abs(rounded[k]), h * ROUND_OFF / limit, moved)
        own = larger(larger(abs(b[slots.OWN + k]), abs(b[slots.END + slots.OWN + k])), moved)
        good = good & (abs(slid[k]) <= limit * own)
        change = larger(change, abs(slid[k]) * (fast / (own + TINY)))
    b[slots.GOOD] = where(good, alike(h, 1.0), alike(h, 0.0))
    b[slots.FACTOR] = alike(
        h, LONGER
    )  # a number, where nothing reads it: a denormal one costs time
    if all_hold(good) and all_hold(h >= model[layout.SAMPLE_INTERVAL] - b[slots.ELAPSED]):
        return
    roots = int(model[slots.ROOTS])
    factor = near_root(most_shift + TINY, shift, roots)
    factor = smaller(factor, near_root(most + TINY, change, roots))
    # The second estimate falls with the fourth power at least.
    factor = SAFETY * smaller(factor, near_root(coarse + TINY, other * other * h, 3))
    low, high = alike(h, SHORTER), alike(h, LONGER)
    longer, shorter = smaller(high, factor), larger(low, factor)
    b[slots.FACTOR] = where(good, longer, where(factor < SAFETY, shorter, alike(h, 0.5)))


@inlined_kernel
def _combined(fifth, third, most):
    """Return an estimate of eighth order, and the most that it may be, both times `third`.

    It follows from those of the fifth and the third, all positive.
    """
    third = third + TINY
    return fifth * smaller(third, 10.0 * fifth), most * third


@inlined_kernel
def _cubic(model, b, k):
    """Return the velocity of mass k over a step as the cubic of Hermite, in Bernstein's form."""
    last, third = slots.KICKS + 2 * int(model[slots.STAGES]), 1.0 / 3.0
    before, after = b[slots.STATE + 2 + k], b[slots.END + 2 + k]
    return (
        before,
        fma(b[slots.KICKS + k], third, before),
        fma(b[last + k], -third, after),
        after,
    )


@inlined_kernel
def _bend(c0, c1, c2, c3):
    """Return how far such a cubic is from a line: with it goes what it differs from the motion."""
    return abs(fma(-2.0, c1, c0 + c2)) + abs(fma(-2.0, c2, c1 + c3))


@inlined_kernel
def _powers(model, b, k, by_h):
    """Return the velocity of mass k as coefficients of powers, and a bound of its error.

    It is the cubic. If a stage in between is exact to the fifth order, it is the polynomial of
    fifth degree that has its slope as well and adds up to the way, (t (1 - t))^2 (u + w t) more.
    """
    h, last = b[slots.LENGTH], slots.KICKS + 2 * int(model[slots.STAGES]) + k
    c0, d1, c3 = b[slots.STATE + 2 + k], b[slots.KICKS + k], b[slots.END + 2 + k]
    change = c3 - c0
    d2, d3 = fma(3.0, change, -fma(2.0, d1, b[last])), fma(-2.0, change, d1 + b[last])
    way = fma(0.25, d3, fma(1.0 / 3.0, d2, fma(0.5, d1, c0)))
    astray = fma(by_h, b[slots.END + k] - b[slots.STATE + k], -way)
    part = REMAINDER * model[slots.BEND] * (h * h)
    if not model[slots.IS_COMBINED] > 0.0:
        bend = (1.0 / 3.0) * (abs(d2) + abs(fma(3.0, d3, d2)))
        zero = alike(h, 0.0)
        return (c0, d1, d2, d3, zero, zero), larger(part * bend, ASTRAY * abs(astray))
    late = b[slots.KICKS + 2 * LATE + k] - fma(fma(3.0 * 0.6, d3, 2.0 * d2), 0.6, d1)
    u = (-125.0 / 12.0) * late  # t^3 (1 - t)^2 has no slope there
    w = fma(60.0, astray, -2.0 * u)
    early = b[slots.KICKS + 2 * EARLY + k] - fma(1.0 / 3.0, fma(2.0, d2, d3), d1)
    early = early - fma(8.0 / 81.0, w, (4.0 / 27.0) * u)
    powers = c0, d1, d2 + u, d3 + fma(-2.0, u, w), fma(-2.0, w, u), w
    return powers, larger((1.0 / 16.0) * part * (abs(u) + abs(w)), ASLANT * abs(early))


@inlined_kernel
def _between(model, powers, t):
    """Return such a polynomial and its integral at a part t of the step."""
    d0, d1, d2, d3, d4, d5 = powers
    last, way = d3, 0.25 * d3
    if model[slots.IS_COMBINED] > 0.0:  # else d4 and d5 are 0
        last = fma(fma(d5, t, d4), t, d3)
        way = fma(fma(d5 * (1.0 / 6.0), t, d4 * 0.2), t, way)
    value = fma(fma(fma(last, t, d2), t, d1), t, d0)
    return value, t * fma(fma(fma(way, t, d2 * (1.0 / 3.0)), t, 0.5 * d1), t, d0)


@borrowing_kernel
def _judge(model, b):
    """Tell whether the slip velocity leaves its regime in the step, and predict when and where.

    It is taken as the cubic of Hermite: its coefficients over a step, in Bernstein's form, bound
    it, and what changes their sign once has one root.
    """
    stay_apart()
    h, vr, regime = b[slots.LENGTH], b[slots.VR], b[slots.REGIME]
    (p0, p1, p2, p3), (q0, q1, q2, q3) = _cubic(model, b, 0), _cubic(model, b, 1)
    c0, c1, c2, c3 = q0 - p0, q1 - p1, q2 - p2, q3 - p3
    zero, one = alike(h, 0.0), alike(h, 1.0)
    margin = smaller(model[slots.BEND] * (h * h), one) * _bend(c0, c1, c2, c3)
    sticks = regime == 0.0
    side = where(sticks, where(c3 > 0.0, one, -one), regime)
    inwards, edge = where(sticks, -side, side), where(sticks, vr, -vr)
    g0 = larger(fma(inwards, c0, edge), zero)
    g1, g2, g3 = fma(inwards, c1, edge), fma(inwards, c2, edge), fma(inwards, c3, edge)
    # In stick the other boundary must be out of reach.
    other = vr + smaller(side * c1, smaller(side * c2, side * c3))
    clear = where(sticks, other, one) > where(sticks, margin, zero)
    stays = (smaller(g1, smaller(g2, g3)) > margin) & clear
    b[slots.VERDICT] = where(stays, slots.STAYS, alike(h, slots.MAY_LEAVE))
    if all_hold(stays):
        return
    leaves = (g3 < -margin) & (larger(g1, -g2) >= 0.0) & clear
    b[slots.VERDICT] = where(leaves, slots.LEAVES, b[slots.VERDICT])
    d1, d2, d3 = 3.0 * (g1 - g0), 3.0 * fma(-2.0, g1, g0 + g2), fma(3.0, g1 - g2, g3 - g0)
    # From the root of the parabola with the same ends and first slope, in the form without loss.
    rise, square = d1 > 0.0, g3 - g0 - d1
    wide = rough_root(larger(fma(d1, d1, -4.0 * g0 * square), zero))
    t = rough_quotient(where(rise, d1 + wide, g0 + g0), where(rise, -2.0 * square, wide - d1))
    for _ in range(1 if model[slots.IS_COMBINED] > 0.0 else 2):
        slope = fma(fma(3.0 * d3, t, 2.0 * d2), t, d1)
        following = t - rough_quotient(fma(fma(fma(d3, t, d2), t, d1), t, g0), slope)
        t = where((following > 0.0) & (following < 1.0), following, t)
    b[slots.SIDE], b[slots.TIME] = side, where(leaves, t, 0.5)


@borrowing_kernel
def _follow(model, b):
    """Accept steps in one regime and steps to its boundary; the latter enter the next regime.

    What a step to the boundary misses it by, its last accelerations correct.
    """
    target, h, zero = b[slots.TARGET] + 0.0, b[slots.LENGTH], everywhere(0.0)
    _judge(model, b)
    stays = b[slots.VERDICT] == slots.STAYS
    b[slots.SHIFT], b[slots.NEXT], b[slots.ARRIVES] = zero, zero, zero
    if all_hold(stays) and none(target * target > 0.0):
        return
    last = slots.KICKS + 2 * int(model[slots.STAGES])
    k1, k2 = b[last], b[last + 1]
    x1, x2, v1, v2 = b[slots.END], b[slots.END + 1], b[slots.END + 2], b[slots.END + 3]
    to_boundary = target * target * b[slots.GOOD]
    within = b[slots.GOOD] - to_boundary
    # Outwards from stick, inwards from slip; else the boundary is passed for the second time.
    towards = where(b[slots.REGIME] == 0.0, target, -target) * (k2 - k1) > 0.0
    missed = fma(target, b[slots.VR], v1 - v2) / (k2 - k1)
    arrives = where(towards & (h * abs(missed) <= model[slots.NEAR]), to_boundary, zero)
    shift = where(arrives > 0.0, missed, zero)
    b[slots.END] = fma(h * shift, fma(0.5 * shift, k1, v1), x1)
    b[slots.END + 1] = fma(h * shift, fma(0.5 * shift, k2, v2), x2)
    b[slots.END + 2], b[slots.END + 3] = fma(shift, k1, v1), fma(shift, k2, v2)
    _enter(b, where(arrives > 0.0, target - b[slots.REGIME], b[slots.REGIME]))
    again = where(towards, 1.0 + missed, alike(h, 0.5))
    following = h * where(to_boundary > arrives, again, b[slots.TIME])
    b[slots.NEXT] = where(b[slots.GOOD] > 0.0, following, zero)
    leaves = (b[slots.VERDICT] == slots.LEAVES) & (within > 0.0)
    b[slots.TARGET] = where(to_boundary > arrives, target, where(leaves, b[slots.SIDE], zero))
    b[slots.GOOD] = where(stays, within, zero) + arrives
    b[slots.SHIFT], b[slots.ARRIVES] = h * shift, arrives
    if not none(leaves):
        _cut(model, b, leaves)


@borrowing_kernel
def _cut(model, b, leaves):
    """End steps where they leave their regime, if the velocities are known well enough there."""
    h, time, side = b[slots.LENGTH], b[slots.TIME], b[slots.SIDE]
    by_h = 1.0 / h
    first, error1 = _powers(model, b, 0, by_h)
    second, error2 = _powers(model, b, 1, by_h)
    error = larger(error1, error2)
    (p0, p1, p2, p3, p4, p5), (q0, q1, q2, q3, q4, q5) = first, second
    if model[slots.IS_COMBINED] > 0.0:  # the time is that of the cubic
        d1, d2, d3, d4, d5 = q1 - p1, q2 - p2, q3 - p3, q4 - p4, q5 - p5
        slip = fma(fma(fma(fma(fma(d5, time, d4), time, d3), time, d2), time, d1), time, q0 - p0)
        rate = fma(5.0 * d5, time, 4.0 * d4)
        rate = fma(fma(fma(rate, time, 3.0 * d3), time, 2.0 * d2), time, d1)
        following = time - rough_quotient(fma(-side, b[slots.VR], slip), rate)
        time = where((following > 0.0) & (following < 1.0), following, time)
    v1, way1 = _between(model, first, time)
    v2, way2 = _between(model, second, time)
    near = 4.0 * time * (1.0 - time)  # both ends are exact, and the slopes there
    missed = abs(fma(side, b[slots.VR], v1 - v2))
    missed = fma(near * near, error, missed)
    x1, x2, y1, y2 = b[slots.STATE], b[slots.STATE + 1], b[slots.END], b[slots.END + 1]
    far = larger(larger(abs(x1), abs(x2)), larger(abs(y1), abs(y2)))
    fast = larger(larger(abs(p0), abs(q0)), larger(abs(b[slots.END + 2]), abs(b[slots.END + 3])))
    limit = KNOWN * model[slots.LIMIT] * (h * (1.0 / model[layout.SAMPLE_INTERVAL]))
    exact = leaves & (missed <= limit * fast) & (h * error <= limit * far)
    one, zero = alike(h, 1.0), alike(h, 0.0)
    b[slots.END] = where(exact, fma(h, way1, x1), b[slots.END])
    b[slots.END + 1] = where(exact, fma(h, way2, x2), b[slots.END + 1])
    b[slots.END + 2], b[slots.END + 3] = (
        where(exact, v1, b[slots.END + 2]),
        where(exact, v2, b[slots.END + 3]),
    )
    _enter(b, where(exact, side - b[slots.REGIME], b[slots.REGIME]))
    b[slots.GOOD], b[slots.ARRIVES] = (
        where(exact, one, b[slots.GOOD]),
        where(exact, one, b[slots.ARRIVES]),
    )
    b[slots.SHIFT] = where(exact, fma(time, h, -h), b[slots.SHIFT])
    b[slots.NEXT], b[slots.TARGET] = (
        where(exact, zero, b[slots.NEXT]),
        where(exact, zero, b[slots.TARGET]),
    )


@borrowing_kernel
def _conclude(law, model, b):
    """Make the accepted steps, and choose the lengths of the next ones."""
    # A copy: as plain Python rows are lent, and the length is written below.
    h, shift, interval = b[slots.LENGTH] + 0.0, b[slots.SHIFT], model[layout.SAMPLE_INTERVAL]
    good = (b[slots.OUTCOME] == slots.GOES_ON) & (b[slots.GOOD] > 0.0)
    is_last = good & (h >= interval - b[slots.ELAPSED]) & (shift == 0.0)
    for row in range(states_of(law)):
        b[row] = where(good, b[slots.END + row], b[row])
    b[slots.OUTCOME] = where(is_last, slots.DONE, b[slots.OUTCOME])
    if none(b[slots.OUTCOME] == slots.GOES_ON):
        return
    b[slots.ELAPSED] = where(good, b[slots.ELAPSED] + h + shift, b[slots.ELAPSED])
    rest, enters = interval - b[slots.ELAPSED], b[slots.ARRIVES] > 0.0
    # A step to an event was short for another reason than its error.
    longer = where(enters, interval / model[slots.STEPS], h * b[slots.FACTOR])
    longer = where(longer + longer < rest, longer, where(longer < rest, 0.5 * rest, rest))
    shorter = where(b[slots.NEXT] > 0.0, b[slots.NEXT], h * b[slots.FACTOR])
    length = smaller(where(good, longer, shorter), rest)
    set_length(b, where(b[slots.OUTCOME] == slots.GOES_ON, length, h))
    last, scale = slots.KICKS + 2 * int(model[slots.STAGES]), b[slots.LENGTH] / h
    for row in range(2):
        b[slots.KICKS + row] = where(good, b[last + row], b[slots.KICKS + row]) * scale
    for row in range(slots.OWN_KICKS, slots.OWN_KICKS + own_states_of(law)):
        b[row] = where(good, b[last + row - slots.KICKS], b[row]) * scale
    if not none(enters):
        a1, a2, _, _ = first_kicks(law, model, b)
        b[slots.KICKS] = where(enters, a1, b[slots.KICKS])
        b[slots.KICKS + 1] = where(enters, a2, b[slots.KICKS + 1])
    b[slots.COUNT] = b[slots.COUNT] + 1.0
    most = MOST_STEPS if is_line(law) else MOST_STEPS_ALONE
    lasts = (b[slots.COUNT] < most) & (b[slots.LENGTH] > 0.0)
    outcome = where(lasts, slots.GOES_ON, everywhere(slots.GIVEN_UP))
    b[slots.OUTCOME] = where(b[slots.OUTCOME] == slots.GOES_ON, outcome, b[slots.OUTCOME])
