"""Variational equations of every plant with two masses, beside its motion, as Taylor series.

The motion's deviation from a change of the start or of a parameter obeys a linear equation along
the motion; both are expanded together. Where the friction's regime changes, a deviation moves the
time of the change, and with it the velocities: the saltation of Aizerman and Gantmakher (1958); see
Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems* (2004), section
7.1.

States are x1, the offset, v1 and the slip velocity w. The deviations of all columns stand side by
side, so that one vector holds a term of them.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.jets import write_series
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.bounds import fastest_harmonic, fastest_rate
from mm_gym.law.dry_friction import interface_line, slip_intercept
from mm_gym.law.events import NONE, gaps_of, gaps_on, regime_exit_within, sign_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness
from mm_gym.sensitivity import regime_kernel as regime
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.causes_kernel import cause
from mm_gym.sensitivity.columns_kernel import read_columns, take_impulses, write_columns
from mm_gym.sensitivity.generator_kernel import weights_of
from mm_gym.sensitivity.layout import (
    CAUSES,
    COLUMNS,
    FIRST_ROW,
    HAS_FRICTION,
    IS_CUBIC,
    IS_FINITE,
    IS_LINEAR,
    LAST_V1,
    LAST_V2,
    MOST_SERIES,
    TIME,
    WIDTH,
)
from mm_gym.sensitivity.sizes_kernel import is_enough, part_of_unit, write_size

LONGEST = 2.0
"""Length of the longest series, in units of the shortest time constant at its start."""

FEWEST = 8
"""Lowest order of a series."""


@kernel
def propagate(model, lanes, first, last):
    """Advance motion and deviations by one sample interval, or a part of it."""
    status, c, p = at.OK, np.zeros(of.SIZE), np.zeros(of.COEFFICIENTS)
    if model[IS_LINEAR] > 0.0:
        t, work = on_cache_line(regime.ROWS * LANES).reshape(regime.ROWS, LANES), np.zeros((1, 1))
        t[:] = 0.0
    else:
        t, work = np.zeros((of.ROWS, COLUMNS)), np.zeros((4, COLUMNS))
    weights = weights_of(of.ORDER + 1)
    for i in range(first, last):
        _load(model, lanes, i, p)
        status = max(status, _propagate_lane(model, lanes, i, c, p, t, work, weights))
    return status


@borrowing_kernel
def _load(model, lanes, i, p):
    """Write the coefficients of lane i."""
    p[of.M1], p[of.M2], p[of.K1], p[of.D] = (
        lanes[at.M1, i],
        lanes[at.M2, i],
        lanes[at.K1, i],
        lanes[at.D, i],
    )
    p[of.ALPHA], p[of.BETA] = lanes[at.ALPHA, i], lanes[at.BETA, i]
    p[of.BETWEEN], p[of.HELD] = control_forces(model, lanes[at.FORCE, i])
    p[of.K0], p[of.L0], p[of.STRETCH] = lanes[at.K0, i], lanes[at.L0, i], lanes[at.STRETCH, i]
    p[of.K2] = stiffness(p[of.K0], p[of.STRETCH]) if p[of.K0] > 0.0 else 0.0
    p[of.STICK], p[of.VR], p[of.CHI] = lanes[at.C, i], lanes[at.VR, i], lanes[at.CHI, i]
    p[of.FN], p[of.MU1], p[of.MU2] = lanes[at.FN, i], lanes[at.MU1, i], lanes[at.MU2, i]
    p[of.INTERCEPT] = slip_intercept(lanes[at.KINETIC_FORCE, i], p[of.CHI], p[of.VR])


@borrowing_kernel
def _propagate_lane(model, lanes, i, c, p, t, work, weights):
    """Advance one lane, series by series.

    Parameters
    ----------
    model, lanes, i
        (m,) read; (rows, count) read, and state and deviations written; the lane.
    c, p
        (of.SIZE,) written; (of.COEFFICIENTS,) read, but for the regime, written.
    t, work
        (of.ROWS, COLUMNS) and (4, COLUMNS), written: the deviations' series, and room. Where each
        regime is linear, t is (regime.ROWS, LANES).
    weights
        (of.ORDER + 1,) read: 1 / n!.

    Returns
    -------
    int
        Status.
    """
    own, duration = int(model[FIRST_ROW]), model[at.SAMPLE_INTERVAL]
    friction, linear, vr = model[HAS_FRICTION] > 0.0, model[IS_LINEAR] > 0.0, p[of.VR]
    part = 1 if linear else of.PART
    take_impulses(model, lanes, i, p)
    read_columns(model, lanes, i, t, part)
    x1, v1 = lanes[at.X1, i], lanes[at.V1, i]
    c[of.X1], c[of.V1], c[of.W] = x1, v1, lanes[at.V2, i] - v1
    c[of.OFFSET], p[of.REST] = _sum(lanes[at.X2, i], -x1)
    sign = sign_of(vr, c[of.W]) if friction else 0.0
    upper, lower = gaps_of(vr, c[of.W])
    elapsed = 0.0
    for _ in range(MOST_SERIES):
        p[of.REGIME] = sign
        p[of.DAMPING], p[of.SLIP] = interface_line(sign, p[of.STICK], p[of.CHI], p[of.INTERCEPT])
        rest = duration - elapsed
        rate = _rate(model, lanes, i, c, p)
        unit = min(rest, LONGEST / rate)
        is_last = unit == rest
        write_series(c, of.WIDTH, model, lanes, i, elapsed, unit, of.ORDER)
        if linear:
            order, theta = regime.expand_motion(model, c, p, unit, rate * unit), 1.0
        else:
            order, theta = _expand(model, lanes, i, c, p, t, work, elapsed, unit)
        if order == 0:
            return at.COLLAPSED
        direction = 0.0
        if friction:
            exit_at, direction = regime_exit_within(
                c, of.W, of.SCALED, order, theta, sign, upper, lower
            )
            theta = theta if exit_at == NONE else theta * exit_at
        if linear:
            regime.write_signals(model, lanes, i, c, p, t, elapsed, unit, theta, order)
            regime.advance(p, rows_of(t), weights, theta * unit, order)
        else:
            _evaluate_columns(t, theta, order)
        _evaluate(c, p, theta, order)
        if not abs(c[of.X1]) + abs(c[of.OFFSET]) + abs(c[of.V1]) + abs(c[of.W]) < np.inf:
            return at.DIVERGED
        elapsed += theta * unit
        if direction != 0.0:
            c[of.W] = direction * vr
            _jump(model, lanes, i, c, p, t[2 * part :: part], elapsed, sign, direction)
            sign = direction - sign
            upper, lower = gaps_on(vr, direction)
        else:
            upper, lower = gaps_of(vr, c[of.W])
        if (is_last and theta == 1.0 and direction == 0.0) or elapsed >= duration:
            break
    else:
        return at.TOO_MANY_SERIES
    lanes[at.X1, i], lanes[at.X2, i] = c[of.X1], c[of.X1] + c[of.OFFSET]
    lanes[at.V1, i], lanes[at.V2, i] = c[of.V1], c[of.V1] + c[of.W]
    lanes[own + LAST_V1, i], lanes[own + LAST_V2, i] = lanes[at.V1, i], lanes[at.V2, i]
    lanes[own + TIME, i] += duration
    write_columns(model, lanes, i, t, part)
    return at.OK


@borrowing_kernel
def _rate(model, lanes, i, c, p):
    """Return a bound of the rates [1/s] of the deviations at the start of a series.

    Parameters
    ----------
    model, lanes, i, c, p
        As for `_propagate_lane`; read.
    """
    k1, k2 = p[of.K1] * (p[of.ALPHA] + 3.0 * p[of.BETA] * c[of.X1] * c[of.X1]), p[of.K2]
    if model[IS_FINITE] > 0.0:
        short = c[of.OFFSET] / p[of.L0]
        k2 = p[of.K0] * (
            2.0 + 2.0 * (p[of.STRETCH] + short) ** -3 + 2.0 * (p[of.STRETCH] - short) ** -3
        )
    rate = fastest_rate(p[of.M1], p[of.M2], k1, abs(k2), p[of.DAMPING], p[of.D])
    return max(rate, fastest_harmonic(lanes[:, i], int(model[at.HARMONIC_COUNT])), 1e-300)


@borrowing_kernel
def _expand(model, lanes, i, c, p, t, work, elapsed, unit):
    """Write the series of motion and deviations; return their order, 0 if a spring collapsed.

    Also return the part of the unit within which the last terms are small enough.

    Parameters
    ----------
    model, lanes, i, c, p, t, work
        As for `_propagate_lane`.
    elapsed, unit
        Start of the series since that of the sample interval, and its unit of time [s].
    """
    prefer_widest_vectors()
    cubic, finite = model[IS_CUBIC] > 0.0, model[IS_FINITE] > 0.0
    by_m1, by_both = 1.0 / p[of.M1], 1.0 / p[of.M1] + 1.0 / p[of.M2]
    k1, beta, d, damping = p[of.K1] * p[of.ALPHA], p[of.K1] * p[of.BETA], p[of.D], p[of.DAMPING]
    excited = model[at.HARMONIC_COUNT] > 0.0 or model[at.TERMS] > 0.0
    inner, outer, kick, slide = work[0], work[1], work[2], work[3]
    held, slip = p[of.HELD], p[of.SLIP] + p[of.BETWEEN]
    write_size(c, t, unit, 0)
    for n in range(of.ORDER):
        step = unit / (n + 1.0)
        # The motion.
        if cubic:
            c[of.SQUARE + n] = _product(c, of.X1, of.X1, n)
            c[of.CUBE + n] = _product(c, of.SQUARE, of.X1, n)
        if finite:
            if not _write_pair(c, p, n):
                return 0, 0.0
        else:
            c[of.PAIR + n] = p[of.K2] * c[of.OFFSET + n]
        c[of.INNER + n] = fma(damping, c[of.W + n], c[of.PAIR + n]) + slip
        c[of.OUTER + n] = fma(k1, c[of.X1 + n], fma(d, c[of.V1 + n], -held))
        if cubic:
            c[of.OUTER + n] += beta * c[of.CUBE + n]
        ground = 0.0
        if excited:
            c[of.OUTER + n] -= c[of.FORCE + n]
            ground = c[of.GROUND + n]
        held = slip = 0.0
        c[of.X1 + n + 1], c[of.OFFSET + n + 1] = step * c[of.V1 + n], step * c[of.W + n]
        c[of.V1 + n + 1] = step * ((c[of.INNER + n] - c[of.OUTER + n]) * by_m1 - ground)  # (1)
        c[of.W + n + 1] = step * (
            c[of.OUTER + n] * by_m1 - c[of.INNER + n] * by_both
        )  # (2) less (1)
        # The deviations.
        for j in range(COLUMNS):
            inner[j] = damping * t[3 * of.PART + n, j]
            outer[j] = fma(k1, t[n, j], d * t[2 * of.PART + n, j])
            kick[j] = slide[j] = 0.0
        if finite:
            for m in range(n + 1):
                slope = c[of.OVER_OFFSET + m]
                for j in range(COLUMNS):
                    inner[j] = fma(slope, t[of.PART + n - m, j], inner[j])
        else:
            for j in range(COLUMNS):
                inner[j] = fma(p[of.K2], t[of.PART + n, j], inner[j])
        if cubic:
            for m in range(n + 1):
                slope = 3.0 * beta * c[of.SQUARE + m]
                for j in range(COLUMNS):
                    outer[j] = fma(slope, t[n - m, j], outer[j])
        for j in range(4, COLUMNS):
            if model[CAUSES + j] >= 0.0:
                push = cause(model, lanes, i, c, p, elapsed, unit, n, int(model[CAUSES + j]))
                inner[j] += push[0]
                outer[j] += push[1]
                kick[j], slide[j] = push[2], push[3]
        for j in range(COLUMNS):
            t[n + 1, j] = step * t[2 * of.PART + n, j]
            t[of.PART + n + 1, j] = step * t[3 * of.PART + n, j]
            t[2 * of.PART + n + 1, j] = step * fma(inner[j] - outer[j], by_m1, kick[j])
            t[3 * of.PART + n + 1, j] = step * (
                fma(outer[j], by_m1, -inner[j] * by_both) + slide[j]
            )
        write_size(c, t, unit, n + 1)
        if n + 1 >= FEWEST and is_enough(c, t, n + 1):
            return n + 1, 1.0
    return of.ORDER, part_of_unit(c, t)


@borrowing_kernel
def _product(c, a, b, n):
    """Return term n of the product of two series in c."""
    total = 0.0
    for m in range(n + 1):
        total = fma(c[a + m], c[b + n - m], total)
    return total


@borrowing_kernel
def _write_pair(c, p, n):
    """Write term n of the finite pair's force and of its slopes; False if a side collapsed.

    (6) of docs/model.md: k0 (2 offset + l0 (S**-2 - L**-2)), with the sides' stretches L and S.
    """
    k0, l0 = p[of.K0], p[of.L0]
    c[of.LONG + n], c[of.SHORT + n] = c[of.OFFSET + n] / l0, -c[of.OFFSET + n] / l0
    if n == 0:
        # Rounded once: of a side that is nearly gone no digits cancel.
        c[of.LONG] = (fma(p[of.STRETCH], l0, c[of.OFFSET]) + p[of.REST]) / l0
        c[of.SHORT] = (fma(p[of.STRETCH], l0, -c[of.OFFSET]) - p[of.REST]) / l0
        if not (c[of.LONG] > 0.0 and c[of.SHORT] > 0.0):
            return False
    for side in range(2):
        base = of.LONG + side * of.WIDTH
        _write_power(c, base, of.LONG2 + side * of.WIDTH, -2.0, n)
        _write_power(c, base, of.LONG3 + side * of.WIDTH, -3.0, n)
    c[of.PAIR + n] = k0 * fma(2.0, c[of.OFFSET + n], l0 * (c[of.SHORT2 + n] - c[of.LONG2 + n]))
    c[of.OVER_OFFSET + n] = (
        2.0 * k0 * ((1.0 if n == 0 else 0.0) + c[of.SHORT3 + n] + c[of.LONG3 + n])
    )
    c[of.OVER_STRETCH + n] = 2.0 * k0 * l0 * (c[of.LONG3 + n] - c[of.SHORT3 + n])
    return True


@borrowing_kernel
def _write_power(c, base, power, exponent, n):
    """Write term n of a power of a series: n q_0 u_n = sum (m a - (n - m)) q_m u_(n - m)."""
    if n == 0:
        c[power] = c[base] ** exponent
        return
    total = 0.0
    for m in range(1, n + 1):
        total += (m * exponent - (n - m)) * c[base + m] * c[power + n - m]
    c[power + n] = total / (n * c[base])


@borrowing_kernel
def _evaluate(c, p, theta, order):
    """Advance the motion by a part of the unit.

    What rounding leaves of the offset is kept: a spring that is shortened to a part e of its length
    pushes the sphere back with a stiffness that rounded offsets would make wrong by 1e-16 / e, and
    the deviations after that by 1e-16 / e**2.
    """
    for row in (of.X1, of.OFFSET, of.V1, of.W):
        total = 0.0
        for n in range(order, 0, -1):
            total = fma(total, theta, c[row + n])
        change = theta * total
        if row == of.OFFSET:
            c[row], p[of.REST] = _sum(c[row], change + p[of.REST])
        else:
            c[row] = fma(theta, total, c[row])


@borrowing_kernel
def _evaluate_columns(t, theta, order):
    """Advance the deviations by a part of the unit."""
    prefer_widest_vectors()
    for n in range(order - 1, -1, -1):
        for part in range(4):  # side by side: one hides the other's latency
            row = part * of.PART + n
            for j in range(COLUMNS):
                t[row, j] = fma(t[row + 1, j], theta, t[row, j])


@inlined_kernel
def _sum(a, b):
    """Return a + b, and what its rounding leaves (Knuth's TwoSum)."""
    total = a + b
    added = total - a
    return total, (a - (total - added)) + (b - added)


@borrowing_kernel
def _jump(model, lanes, i, c, p, velocities, elapsed, regime, direction):
    """Let the deviations jump where the regime changes: the saltation.

    A deviation of the slip velocity moves the change by minus itself over w'; until then the other
    regime's force acts.

    Parameters
    ----------
    model, lanes, i, c, p
        As for `_propagate_lane`: c has the motion at the change.
    velocities
        Deviations of v1 and of the slip velocity, the first two rows, written.
    elapsed
        Time of the change since the start of the sample interval [s].
    regime, direction
        The regime that ends, and the boundary.
    """
    write_series(c, of.WIDTH, model, lanes, i, elapsed, 1.0, 0)
    excited = model[at.HARMONIC_COUNT] > 0.0 or model[at.TERMS] > 0.0
    pair = p[of.K2] * c[of.OFFSET]
    if model[IS_FINITE] > 0.0:
        _write_pair(c, p, 0)
        pair = c[of.PAIR]
    x1 = c[of.X1]
    outer = p[of.K1] * (p[of.ALPHA] + p[of.BETA] * x1 * x1) * x1 + p[of.D] * c[of.V1] - p[of.HELD]
    if excited:
        outer -= c[of.FORCE]
    inner = p[of.DAMPING] * c[of.W] + p[of.SLIP] + pair + p[of.BETWEEN]
    by_m1, by_both = 1.0 / p[of.M1], 1.0 / p[of.M1] + 1.0 / p[of.M2]
    rate = outer * by_m1 - inner * by_both
    damping, slip = interface_line(direction - regime, p[of.STICK], p[of.CHI], p[of.INTERCEPT])
    step = p[of.DAMPING] * c[of.W] + p[of.SLIP] - (damping * c[of.W] + slip)
    for j in range(int(model[WIDTH])):
        late = -velocities[1, j]
        if model[CAUSES + j] == at.VR:
            late += direction
        late /= rate
        velocities[0, j] += step * by_m1 * late
        velocities[1, j] -= step * by_both * late
