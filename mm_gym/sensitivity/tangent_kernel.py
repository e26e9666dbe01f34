"""Motion and deviations of a plant in value form: Runge-Kutta steps over numbers with tangents.

The stages are those of `mm_gym.methods.runge_kutta`. A lane's tangents are its deviations by its
state, and by what causes others; steps are as short as the worst of them needs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation.kinds import has_corners
from mm_gym.excitation.sources import ROWS_OF_HARMONIC
from mm_gym.lanes import layout
from mm_gym.lanes.simd import element, everywhere, near_root, with_element
from mm_gym.lanes.simd_masks import larger, smaller
from mm_gym.lanes.simd_memory import from_row, rows_on_stack
from mm_gym.lanes.tangents import slopes_of, tangent, tangents_of, value_of
from mm_gym.law.interface import (
    Interface,
    Law,
    force_of,
    own_at,
    own_states_of,
    parameters_of,
    rates_of,
    resolves,
    springs_of,
    states_of,
)
from mm_gym.law.motion import coefficients, control_forces
from mm_gym.law.springs import stiffness
from mm_gym.methods.runge_kutta import kernel as runge_kutta
from mm_gym.methods.runge_kutta import layout as slots
from mm_gym.methods.runge_kutta.tableau_kernel import estimated
from mm_gym.sensitivity.columns_kernel import read_harmonic, read_rows, read_state, write_state
from mm_gym.sensitivity.layout import WIDTH
from mm_gym.sensitivity.step_kernel import beginning_with, step_by
from mm_gym.step.crossing import by_pieces

MOST_STEPS = 100_000

SHORTEST = 2.0**-40
"""Part of the sample interval in which no step is made again: slopes may jump where the slip
velocity changes its sign."""

UNRESOLVED = 256.0
"""What a step's error over its limit is taken for where it may miss something: half the step is
next."""

# Behind the rows of a step, those of a lane up to the harmonics.
_numbers = rows_on_stack(2 * (slots.SIZE + layout.HARMONICS))


def step_with(interface: Law) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return the kernel of a control step with deviations, and the one that propagates.

    See `step_kernel.step_by`.
    """

    @borrowing_kernel
    def propagate(model, lanes, first, last):
        b, status = tangents_of(_numbers()), layout.OK
        for i in range(first, last):
            status = max(status, _propagate_lane(interface, model, lanes, i, b))
        return status

    begin = beginning_with(states_of(interface))
    return step_by(by_pieces(has_corners, runge_kutta.shorten), begin), propagate


def slopes_with(interface: Interface) -> Callable[..., None]:
    """Return the kernel of an interface's force, springs and rates, with their slopes."""

    @borrowing_kernel
    def slopes(p, held, point, found):
        """Write force [N], springs' share [N] and the own states' rates, with their slopes.

        Parameters
        ----------
        p, held
            (parameters,) read, and which of them an actuator holds, -1 for none.
        point
            (4,) read: offset [m], slip velocity [m/s] and own states.
        found
            (4, 6) written: the value of each, the slopes over the point, and over what is held.
        """
        b = tangents_of(_numbers())
        for k in range(p.shape[0]):
            b[k] = p[k]
        if held >= 0:
            b[held] = tangent(p[held], with_element(everywhere(0.0), 4, 1.0))
        for k in range(4):
            b[slots.PARAMETERS + k] = tangent(point[k], with_element(everywhere(0.0), k, 1.0))
        offset, slip = b[slots.PARAMETERS], b[slots.PARAMETERS + 1]
        own = b[slots.PARAMETERS + 2], b[slots.PARAMETERS + 3]
        first, second = rates_of(interface, b, offset, slip, own)
        force = force_of(interface, b, offset, slip, own)
        each = force, springs_of(interface, b, offset, slip, own), first, second
        for k in range(4):
            found[k, 0] = value_of(each[k])
            for j in range(5):
                found[k, 1 + j] = element(slopes_of(each[k]), j)

    return slopes


@borrowing_kernel
def _propagate_lane(interface, model, lanes, i, b):
    """Advance a lane by one sample interval, or a part of it; return its status."""
    interval, h = model[layout.SAMPLE_INTERVAL], model[layout.SAMPLE_INTERVAL] / model[slots.STEPS]
    last = slots.KICKS + 2 * int(model[slots.STAGES])
    _load(interface, model, lanes, i, b)
    runge_kutta.set_length(b, h)
    b[slots.ELAPSED] = 0.0
    elapsed, is_new = 0.0, True
    for _ in range(MOST_STEPS):
        if is_new:
            kicks = runge_kutta.first_kicks(interface, model, b)
            runge_kutta.write_kicks(interface, b, slots.KICKS, kicks)
            is_new = False
        for k in range(int(model[slots.STAGES])):
            runge_kutta.pass_stage(interface, model, b, k)
        error = _error(interface, model, b, h)
        if not error < np.inf:
            factor = runge_kutta.SHORTER
        else:
            root = element(near_root(everywhere(1.0), everywhere(max(error, 1e-30)), 3), 0)
            factor = min(max(runge_kutta.SAFETY * root, runge_kutta.SHORTER), runge_kutta.LONGER)
        is_shortest = h <= SHORTEST * interval and error < np.inf
        if is_shortest:
            factor = max(factor, 2.0)
        if error <= 1.0 or is_shortest:
            for row in range(states_of(interface)):
                b[row] = b[slots.END + row]
            if h >= interval - elapsed:
                write_state(model, lanes, i, states_of(interface), b)
                return layout.OK
            elapsed += h
            b[slots.ELAPSED] = elapsed
            for row in range(2):
                b[slots.KICKS + row] = b[last + row]
            for row in range(slots.OWN_KICKS, slots.OWN_KICKS + own_states_of(interface)):
                b[row] = b[last + row - slots.KICKS]
        elif not h > 0.0:
            break
        following = min(h * factor, interval - elapsed)
        for first in (slots.KICKS, slots.OWN_KICKS):
            for row in range(first, first + 2):
                b[row] = b[row] * (following / h)
        h = following
        runge_kutta.set_length(b, h)
    return layout.TOO_MANY_STEPS


@borrowing_kernel
def _load(interface, model, lanes, i, b):
    """Load a lane's motion, its deviations, and its parameters."""
    lane = from_row(b, slots.SIZE)
    read_rows(model, lanes, i, 0, layout.HARMONICS, lane, 0)
    read_state(model, lanes, i, states_of(interface), b)
    p = coefficients(
        lane[layout.M1],
        lane[layout.M2],
        lane[layout.K1],
        lane[layout.ALPHA],
        lane[layout.BETA],
        lane[layout.D],
        stiffness(lane[layout.K0], lane[layout.STRETCH]),
        lane[layout.K0],
        1.0 / lane[layout.L0],
        lane[layout.STRETCH],
    )
    runge_kutta.write_coefficients(b, p)
    b[slots.PAIR], b[slots.FORCE] = control_forces(model, lane[layout.FORCE])
    own, terms = parameters_of(interface), 2 * int(model[layout.TERMS])
    read_rows(model, lanes, i, int(model[layout.INTERFACE]), own, from_row(b, slots.PARAMETERS), 0)
    read_rows(model, lanes, i, int(model[layout.JETS]), terms, from_row(b, slots.SOURCES), 0)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        place = slots.SOURCES + terms + ROWS_OF_HARMONIC * j
        read_harmonic(model, lanes, i, j, from_row(b, place))


@borrowing_kernel
def _error(interface, model, b, h):
    """Return the largest estimate of a step's error, of motion and deviations, over its limit."""
    number = int(model[slots.SUM]) + int(model[slots.STAGES])
    zero, error = tangent(0.0, everywhere(0.0)), tangent(0.0, everywhere(0.0))
    far, fast = _farthest(b, (layout.X1, layout.X2)), _farthest(b, (layout.V1, layout.V2))
    p = from_row(b, slots.PARAMETERS)
    rates = rates_of(interface, p, far, fast, (zero, zero))
    q1, q2, r1, r2 = estimated(b, number, zero)
    o1, o2, s1, s2 = estimated(b, number + 1, zero)
    rounded = _rounded(interface, b, far, fast)
    error = _over(model, h, (q1, q2), (o1, o2), (layout.V1, layout.V2), b, error, rounded, zero)
    ways, others = (h * r1, h * r2), (h * s1, h * s2)
    error = _over(model, h, ways, others, (layout.X1, layout.X2), b, error, h * rounded, zero)
    moves = larger(_size(b, (layout.X1, layout.X2)), _size(b, (layout.V1, layout.V2)))
    own = runge_kutta.own_errors(interface, b, number, zero)
    other = runge_kutta.own_errors(interface, b, number + 1, zero)
    for k in range(own_states_of(interface)):
        row, lost = slots.OWN + k, (h * runge_kutta.ROUND_OFF) * rates[k]
        ways, others = (own[k], own[k]), (other[k], other[k])
        error = _over(model, h, ways, others, (row, row), b, error, moves, lost)
    largest = value_of(error)
    slips = b[3] - b[2], b[slots.END + 3] - b[slots.END + 2]
    if not resolves(interface, p, slips[0], slips[1], runge_kutta.LONGEST_WAY_OF_BOTH):
        largest = max(largest, UNRESOLVED)
    for j in range(int(model[WIDTH])):
        largest = max(largest, element(slopes_of(error), j))
    return largest


@inlined_kernel
def _rounded(interface, b, far, fast):
    """Return what rounding leaves of a velocity's deviations that an own state balances.

    For example z of hysteresis loses by the yield displacement what the force gains by it. Where
    both masses move almost alike, few digits are left of the slip velocity that deviations follow.
    """
    if own_states_of(interface) == 0:
        return everywhere(0.0)
    offset, slip, p = b[1] - b[0], b[3] - b[2], from_row(b, slots.PARAMETERS)
    first, second = own_at(interface, b, slots.OWN)
    still = everywhere(0.0)
    frozen = tangent(value_of(first), still), tangent(value_of(second), still)
    given = slopes_of(force_of(interface, p, offset, slip, (first, second)))
    given = given - slopes_of(force_of(interface, p, offset, slip, frozen))
    zero = tangent(0.0, still)
    alike = slopes_of(force_of(interface, p, far, fast, (zero, zero)))
    by_mass = value_of(b[slots.BY_M1]) + value_of(b[slots.BY_M2])
    return (abs(given) + abs(alike)) * (runge_kutta.ROUND_OFF * by_mass)


@inlined_kernel
def _farthest(b, rows):
    """Return the largest magnitude of two rows in a step, without deviations."""
    found = 0.0
    for row in rows:
        found = max(found, abs(value_of(b[row])), abs(value_of(b[slots.END + row])))
    return tangent(found, everywhere(0.0))


@inlined_kernel
def _size(b, rows):
    """Return how large the deviations of two rows are over the motion in them."""
    scale, width = 0.0, everywhere(0.0)
    for side in range(2):
        start, end = b[rows[side]], b[slots.END + rows[side]]
        scale = max(scale, abs(value_of(start)), abs(value_of(end)))
        width = larger(width, larger(abs(slopes_of(start)), abs(slopes_of(end))))
    return width * (1.0 / scale if scale > 0.0 else 0.0)


@inlined_kernel
def _over(model, h, fifth, third, rows, b, error, least, lost):
    """Return the larger of an error over its limit and of that of two rows, of which is the scale.

    Positions are compared with positions, velocities with velocities, each column by itself. An own
    state that is saturated forgets its deviations: they count as far as those of the motion, over
    it, which are `least`. Of the motion `least` is what rounding leaves of the deviations, and
    `lost` of an own state what it leaves where both masses move almost alike.
    """
    limit = model[slots.LIMIT] * max(h / model[layout.SAMPLE_INTERVAL], runge_kutta.LEAST_ALONE)
    limit = max(limit, runge_kutta.ROUND_OFF)
    value, slopes = value_of(error), slopes_of(error)
    scale, width = 0.0, everywhere(runge_kutta.TINY)  # where there is no deviation at all
    for side in range(2):
        start, end = b[rows[side]], b[slots.END + rows[side]]
        scale = max(scale, abs(value_of(start)), abs(value_of(end)))
        width = larger(width, larger(abs(slopes_of(start)), abs(slopes_of(end))))
    if rows[0] >= slots.OWN:  # it passes 0 by itself: what it changes by in the interval counts too
        part = model[layout.SAMPLE_INTERVAL] / h
        kick = b[slots.OWN_KICKS + rows[0] - slots.OWN]
        scale = max(scale, abs(value_of(kick)) * part + abs(value_of(lost)) / limit)
        width = larger(larger(width, abs(slopes_of(kick)) * part), least * scale)
        width = width + abs(slopes_of(lost)) * (1.0 / limit)
    else:
        width = width + least * (1.0 / limit)
    if rows[0] == layout.V1:  # what rounding leaves of balanced forces
        forces = abs(value_of(b[slots.FORCE])) + abs(value_of(b[slots.PAIR]))
        forces += abs(value_of(b[slots.LINEAR]) * value_of(b[0]))
        scale += runge_kutta.ROUND_OFF * forces * value_of(b[slots.BY_M1]) / limit
    for side in range(2):
        one, two = abs(value_of(fifth[side])), abs(value_of(third[side]))
        if model[slots.IS_COMBINED] > 0.0 and two > 0.0:
            one = one * min(1.0, 10.0 * one / two)
        ratio = one / (limit * scale) if one != 0.0 else 0.0
        value = max(value, ratio)  # also if it is not a number
        wide, other = abs(slopes_of(fifth[side])), abs(slopes_of(third[side]))
        if model[slots.IS_COMBINED] > 0.0:
            wide = wide * smaller(everywhere(1.0), 10.0 * wide / other)
        slopes = larger(slopes, wide / (limit * width))
    return tangent(value, slopes)
