"""Adaptive Taylor series (Jorba and Zou, Experimental Mathematics 14, 2005).

The field is polynomial but for the finite stretch, a quotient, so the series follows from
recurrences: Cauchy products for the cubic spring, division for the neo-Hookean pair. Its order
follows from the tolerance, each step from its last terms. With dry friction the first exit of
the slip velocity from its regime is found on the series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.jets import write_series
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, write_inverse_square
from mm_gym.lanes.memory import span
from mm_gym.lanes.simd import alike
from mm_gym.law.carriage_spring import escape_distance, has_escaped
from mm_gym.law.dry_friction import interface_line, slip_intercept
from mm_gym.law.events import NONE, gaps_of, gaps_on, regime_exit_within, sign_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness
from mm_gym.methods.taylor import layout as rows
from mm_gym.methods.taylor.step_size_kernel import FEWEST, allotted, is_enough, step_of

MOST_STEPS = 20_000
"""Series in one sample interval before giving up: some 0.01 s of work."""


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    status = layout.OK
    c = np.zeros(rows.SIZE)
    write_reciprocals(model, c)
    for i in range(first, last):
        coefficients(model, lanes, i, model[rows.HAS_FRICTION] > 0.0, c)
        status = max(status, _propagate_lane(model, lanes, i, c))
    return status


@borrowing_kernel
def shorten(model, piece):
    """Give a piece of a sample interval its part of the tolerance."""
    part = piece[layout.SAMPLE_INTERVAL] / model[layout.SAMPLE_INTERVAL]
    piece[rows.TOLERANCE] = model[rows.TOLERANCE] * part


@borrowing_kernel
def write_reciprocals(model, c):
    """Write 1 / n for every order n, and the length of a sample interval [s]."""
    c[rows.DURATION] = model[layout.SAMPLE_INTERVAL]
    for n in range(int(model[rows.ORDER])):
        c[rows.RECIPROCAL + n] = 1.0 / (n + 1.0)


@borrowing_kernel
def coefficients(model, lanes, i, friction, c):
    """Write what the equations of lane i need to c (rows.SIZE,), in SI units."""
    k1, k0, stretch = lanes[layout.K1, i], lanes[layout.K0, i], lanes[layout.STRETCH, i]
    c[rows.BY_M1], c[rows.BY_M2] = 1.0 / lanes[layout.M1, i], 1.0 / lanes[layout.M2, i]
    c[rows.K1], c[rows.BETA] = k1 * lanes[layout.ALPHA, i], k1 * lanes[layout.BETA, i]
    c[rows.D], c[rows.C] = lanes[layout.D, i], lanes[layout.C, i]
    c[rows.PAIR], c[rows.U] = control_forces(model, lanes[layout.FORCE, i])
    c[rows.K0], c[rows.L0], c[rows.STRETCH] = k0, lanes[layout.L0, i], stretch
    c[rows.K2] = stiffness(k0, stretch) if k0 > 0.0 else 0.0
    c[rows.ESCAPE] = escape_distance(
        lanes[layout.M1, i], k1, lanes[layout.ALPHA, i], lanes[layout.BETA, i], c[rows.DURATION]
    )
    c[rows.VR] = np.inf
    if friction:  # else these rows of lanes need not be read
        c[rows.VR], c[rows.CHI] = lanes[layout.VR, i], lanes[layout.CHI, i]
        c[rows.INTERCEPT] = slip_intercept(lanes[layout.KINETIC_FORCE, i], c[rows.CHI], c[rows.VR])


@borrowing_kernel
def _propagate_lane(model, lanes, i, c):
    """Advance one lane, series by series."""
    most, tolerance, duration = (
        int(model[rows.ORDER]),
        model[rows.TOLERANCE],
        model[layout.SAMPLE_INTERVAL],
    )
    cubic, finite, friction, vr = (
        model[rows.IS_CUBIC] > 0.0,
        model[rows.IS_FINITE] > 0.0,
        model[rows.HAS_FRICTION] > 0.0,
        c[rows.VR],
    )
    for row in range(4):
        c[rows.STATE + row] = lanes[row, i]
    w = c[rows.STATE + 4] = lanes[layout.V2, i] - lanes[layout.V1, i]
    regime = sign_of(vr, w)
    upper, lower = gaps_of(vr, w)
    elapsed = 0.0
    unit = (
        duration  # the series' unit of time: about the length of a step, so that no term overflows
    )
    for _ in range(MOST_STEPS):
        write_series(c, rows.WIDTH, model, lanes, i, elapsed, unit, most)
        remaining = (duration - elapsed) / unit
        part = allotted(tolerance, unit, duration)
        enough = part if remaining == 1.0 else -1.0
        order = _expand(c, cubic, finite, friction, regime, unit, most, enough)
        if order < FEWEST:
            return layout.COLLAPSED
        theta = 1.0 if order < most else min(step_of(c, c, part, order), remaining)
        direction = 0.0
        if friction:
            exit_at, direction = regime_exit_within(
                c, rows.W, rows.SCALED, order, theta, regime, upper, lower
            )
            theta = theta if exit_at == NONE else theta * exit_at
        if not _evaluate(c, friction, theta, order):
            return layout.DIVERGED
        escaped = has_escaped(c[rows.STATE], c[rows.STATE + 2], c[rows.ESCAPE])
        if direction != 0.0:
            regime = direction - regime
            c[rows.STATE + 4] = direction * vr
            upper, lower = gaps_on(vr, direction)
        else:
            upper, lower = gaps_of(vr, c[rows.STATE + 4])
        elapsed += theta * unit
        if escaped or (theta == remaining and direction == 0.0) or elapsed >= duration:
            for row in range(4):
                lanes[row, i] = c[rows.STATE + row]
            return layout.ESCAPED if escaped else layout.OK
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
    return layout.TOO_MANY_SERIES


@borrowing_kernel
def _expand(c, cubic, finite, friction, regime, unit, most, enough):
    """Write the series of the state; return its order, 0 if a spring collapsed.

    Term n is the state's n-th derivative times unit**n / n!. The order is the first at which the
    last terms are below the tolerance `enough` of the velocities, at most `most`, and even: two
    orders are worked out together, because positions follow from the velocities before them, so
    that what depends on positions is known for both.

    Parameters
    ----------
    c
        (rows.SIZE,) read: state, coefficients, and the series of force [N] and of ground
        acceleration [m/s^2]; written: all other series.
    cubic, finite, friction
        Whether the carriage's spring is cubic, the sphere's springs are of finite stretch, and
        there is dry friction.
    regime
        Direction of slip, or 0 for stick.
    unit
        Unit of time of the series [s].
    most, enough
        The largest order, and the tolerance; negative if the order is to be the largest.
    """
    x1, x2, v1, v2 = c[rows.STATE], c[rows.STATE + 1], c[rows.STATE + 2], c[rows.STATE + 3]
    w = c[rows.STATE + 4]
    # What a loop writes to the array it would read from it again: it keeps its own copies.
    k1, k2, beta = c[rows.K1], 0.0 if finite else c[rows.K2], c[rows.BETA]
    damping, slip = interface_line(regime, c[rows.C], c[rows.CHI], c[rows.INTERCEPT])
    plant = c[rows.BY_M1], c[rows.BY_M2], c[rows.D], damping
    held, between = c[rows.U], c[rows.PAIR]
    if finite:  # which has no k2 to add it to
        slip, between = slip + between, 0.0
    c[rows.X1], c[rows.X2], c[rows.V1], c[rows.V2], c[rows.W] = x1, x2, v1, v2, w
    for m in range(most // 2):
        n = m + m
        step, next_step = unit * c[rows.RECIPROCAL + n], unit * c[rows.RECIPROCAL + n + 1]
        next_x1, next_x2 = step * v1, step * v2
        c[rows.X1 + n + 1], c[rows.X2 + n + 1] = next_x1, next_x2
        cube = next_cube = 0.0
        if cubic:
            cube, next_cube = cubes(c, m, x1, next_x1)
        pair, next_pair = fma(k2, x2 - x1, between), k2 * (next_x2 - next_x1)
        if finite:
            if not (_stretch(c, n) and _stretch(c, n + 1)):
                return 0
            pair, next_pair = _pair(c, n), _pair(c, n + 1)
        inner, outer = pair + slip, fma(k1, x1, fma(beta, cube, -held))
        v1, v2, w = _accelerate(c, n, step, plant, inner, outer, (v1, v2, w), friction)
        x1, x2, outer = next_step * v1, next_step * v2, fma(k1, next_x1, beta * next_cube)
        velocities = v1, v2, w
        v1, v2, w = _accelerate(c, n + 1, next_step, plant, next_pair, outer, velocities, friction)
        c[rows.X1 + n + 2], c[rows.X2 + n + 2] = x1, x2
        held = slip = between = 0.0
        if enough > 0.0 and n + 2 >= FEWEST and is_enough(c, n + 2, enough):
            return n + 2
    return most


@inlined_kernel
def _accelerate(c, n, step, plant, inner, outer, velocities, friction):
    """Write and return term n + 1 of the velocities, given term n and the forces.

    Parameters
    ----------
    c
        (rows.SIZE,) read: the series of force and ground acceleration; written: those of v1, v2, w.
    step
        Unit of time over n + 1 [s].
    plant
        1 / m1 and 1 / m2 [1/kg]; damping of the carriage, and slope of the interface [N s/m].
    inner, outer
        Terms n of what else acts between the masses, and of what resists the carriage, but for the
        excitation [N].
    velocities
        Terms n of v1, v2 and w [m/s]; the last is read with friction only.
    friction
        Whether there is dry friction.
    """
    (by_m1, by_m2, d, damping), (v1, v2, w) = plant, velocities
    outer -= c[rows.FORCE + n]
    if friction:
        # Near a stiff stick the digits of v2 - v1 would cancel, so w has a series of its own.
        creep, outer = damping * w, outer + d * v1
        v1 = step * ((creep + inner - outer) * by_m1 - c[rows.GROUND + n])  # (1)
        v2 = step * (-(creep + inner) * by_m2 - c[rows.GROUND + n])  # (2)
        w = step * (outer * by_m1 - (inner + creep) * (by_m1 + by_m2))
        c[rows.W + n + 1] = w
    else:
        v1, v2 = accelerated(
            step, by_m1, by_m2, d, damping, inner, outer, c[rows.GROUND + n], v1, v2
        )
    c[rows.V1 + n + 1], c[rows.V2 + n + 1] = v1, v2
    return v1, v2, w


@inlined_kernel
def accelerated(step, by_m1, by_m2, d, damping, inner, outer, ground, v1, v2):
    """Return term n + 1 of the velocities, given term n, of a viscous interface.

    Parameters
    ----------
    step, inner, outer
        As for `_accelerate`; vectors of lanes too.
    by_m1, by_m2, d, damping
        What `plant` has there.
    ground
        Term n of the ground's acceleration [m/s^2].
    v1, v2
        Terms n of the velocities [m/s].
    """
    # (1) and (2) of docs/model.md. Each term waits for the velocities, and for nothing else: they
    # come last.
    on1, on2 = fma(inner - outer, by_m1, -ground), fma(-inner, by_m2, -ground)
    slip = v2 - v1
    v1 = step * fma(-(damping + d) * by_m1, v1, fma(damping * by_m1, v2, on1))
    return v1, step * fma(-damping * by_m2, slip, on2)


@inlined_kernel
def _pair(c, n):
    """Return term n of the force of the springs of finite stretch: (6) of docs/model.md."""
    offset = c[rows.X2 + n] - c[rows.X1 + n]
    return c[rows.K0] * fma(
        2.0, offset, c[rows.L0] * (c[rows.SHORT_INVERSE + n] - c[rows.LONG_INVERSE + n])
    )


@inlined_kernel
def cubes(c, m, newest, next_newest):
    """Return terms 2 m and 2 m + 1 of x1**3, and write those of x1**2, given those of x1.

    Products are summed from the middle outwards, because the newest terms are the last to be known;
    those of the square come in equal pairs.
    """
    n = m + m
    first = c[rows.X1]
    if m == 0:
        square = c[rows.SQUARE] = first * first
        c[rows.SQUARE + 1] = 2.0 * first * next_newest
        return square * first, 3.0 * square * next_newest
    middle, following, below = c[rows.X1 + m], c[rows.X1 + m + 1], c[rows.SQUARE + m]
    square, next_square = 0.5 * middle * middle, middle * following
    cube, next_cube = below * middle, below * following
    other = next_other = alike(first, 0.0)
    for j in span(1, m):
        low, high = np.uintp(m) - j, np.uintp(m) + j
        x, far, farther = c[low], c[high], c[high + rows.ONE]  # of x1: its row is the first
        below, above = c[rows.SQUARES + low], c[rows.SQUARES + high]
        square, next_square = fma(x, far, square), fma(x, farther, next_square)
        cube, next_cube = fma(below, far, cube), fma(below, farther, next_cube)
        other, next_other = fma(above, x, other), fma(above, c[low + rows.ONE], next_other)
    square = 2.0 * fma(first, newest, square)
    next_square = 2.0 * fma(first, next_newest, next_square)
    c[rows.SQUARE + n], c[rows.SQUARE + n + 1] = square, next_square
    below = c[rows.SQUARE]
    cube = fma(below, newest, cube) + fma(square, first, other)
    next_other = fma(next_square, first, fma(square, c[rows.X1 + 1], next_other))
    return cube, fma(below, next_newest, next_cube) + next_other


@borrowing_kernel
def _stretch(c, n):
    """Write term n of both sides' stretch l and of l**-2; False if collapsed."""
    for side in range(2):
        stretch, inverse = rows.LONG + side * rows.WIDTH, rows.LONG_INVERSE + side * rows.WIDTH
        c[stretch + n] = (1.0 - 2.0 * side) * (c[rows.X2 + n] - c[rows.X1 + n]) / c[rows.L0]
        if n == 0:
            c[stretch] += c[rows.STRETCH]
            if not c[stretch] > 0.0:
                return False
        write_inverse_square(c, stretch, inverse, n)
    return True


@borrowing_kernel
def _evaluate(c, friction, theta, order):
    """Advance the state by a time in units of the series; tell whether it is still finite."""
    x1 = x2 = v1 = v2 = w = 0.0
    for n in range(order, 0, -1):
        x1, x2 = fma(x1, theta, c[rows.X1 + n]), fma(x2, theta, c[rows.X2 + n])
        v1, v2 = fma(v1, theta, c[rows.V1 + n]), fma(v2, theta, c[rows.V2 + n])
        if friction:
            w = fma(w, theta, c[rows.W + n])
    c[rows.STATE] = fma(x1, theta, c[rows.STATE])
    c[rows.STATE + 1] = fma(x2, theta, c[rows.STATE + 1])
    c[rows.STATE + 2] = fma(v1, theta, c[rows.STATE + 2])
    c[rows.STATE + 3] = fma(v2, theta, c[rows.STATE + 3])
    c[rows.STATE + 4] = (
        fma(w, theta, c[rows.STATE + 4]) if friction else c[rows.STATE + 3] - c[rows.STATE + 2]
    )
    return (
        abs(c[rows.STATE])
        + abs(c[rows.STATE + 1])
        + abs(c[rows.STATE + 2])
        + abs(c[rows.STATE + 3])
        < np.inf
    )
