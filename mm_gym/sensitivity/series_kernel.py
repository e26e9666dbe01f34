"""Motion and deviations of plants with friction or nonlinear springs: Taylor series with tangents.

The equations of motion are expanded over numbers with tangents (`mm_gym.lanes.tangents`), so that
the deviations of all columns come with the motion. Where friction changes its regime, so do they:
a deviation moves the time of the change, and until then the other regime's force acts. That is the
saltation of Aizerman and Gantmakher (1958); see Leine and Nijmeijer, *Dynamics and Bifurcations of
Non-Smooth Mechanical Systems* (2004), section 7.1.

States are x1, the offset, v1 and the slip velocity w.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.jets import add_harmonic, add_jets
from mm_gym.excitation.sources import ROWS_OF_HARMONIC, is_excited
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.extended import total
from mm_gym.lanes.simd import alike, element
from mm_gym.lanes.simd_masks import larger, none
from mm_gym.lanes.simd_memory import from_row, rows_on_stack
from mm_gym.lanes.tangents import slopes_of, tangent, tangents_of, value_of
from mm_gym.law.dry_friction import kinetic_force, slip_intercept, stick_slope
from mm_gym.law.events import NONE, gaps_of, gaps_on, regime_exit_within, sign_of
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness
from mm_gym.methods.taylor.layout import HAS_FRICTION, IS_CUBIC, IS_FINITE
from mm_gym.sensitivity.columns_kernel import read_harmonic, read_rows, read_state, write_state
from mm_gym.sensitivity.layout import MOST_SERIES, WIDTH

ORDER, FEWEST = 28, 8
"""Highest and lowest order of a series."""

_ENOUGH = 2.0**-44, 4
"""Size of the last terms, relative to the largest of the others, and how many of them are looked
at: in a series of alternating or rare terms some are small by chance."""

_LEADING, _ROUNDS = 5, 3

LONGER, SHORTER = 1.5, 2.0**-20
"""Factors of the next series' unit of time: where fewer terms were enough, and the least one."""

# Rows of c: series of the state, of x1**2, of what excites carriage and ground as
# `excitation.jets` writes it, of the offset over l0, and of both sides' stretch**-2.
_LENGTH = ORDER + 4
_X1, _OFFSET, V1, W, _SQUARE, FORCE, GROUND, _SHIFT, _LONG, _SHORT = (
    _LENGTH * k for k in range(10)
)
# Behind them a lane's rows up to the harmonics, a harmonic, and what the equations read of them:
# forces per m1.
LANE = 10 * _LENGTH
_HARMONIC = LANE + layout.HARMONICS
_BY_M1, _RATIO, _K1, _BETA, _D, _PAIR, _HELD, _K2, _TWICE_K0, _PULL, _BY_L0 = (
    _HARMONIC + ROWS_OF_HARMONIC + k for k in range(11)
)
# Of the interface: slope in stick, slope and force at w = 0 in slip, slope and force now.
_STICK, _CHI, _INTERCEPT, SLOPE, SLIP = (_BY_L0 + 1 + k for k in range(5))
# Of both sides of a finite pair, 1 / stretch; what rounding leaves of the offset [m].
_BY_LONG, _BY_SHORT, _REST, _END = (SLIP + 1 + k for k in range(4))

_numbers = rows_on_stack(2 * _END)


@borrowing_kernel
def _load(model, lanes, i, c):
    """Load a lane's state and parameters, and what the equations read of these."""
    prefer_widest_vectors()
    lane = from_row(c, LANE)
    read_rows(model, lanes, i, 0, layout.HARMONICS, lane, 0)
    read_state(model, lanes, i, 4, lane)
    x1, v1 = lane[layout.X1], lane[layout.V1]
    c[_X1], c[V1], c[W] = x1, v1, lane[layout.V2] - v1
    c[_OFFSET] = lane[layout.X2] - x1
    _, c[_REST] = total(value_of(lane[layout.X2]), -value_of(x1))
    by_m1 = 1.0 / lane[layout.M1]
    c[_BY_M1], c[_RATIO] = by_m1, 1.0 + lane[layout.M1] / lane[layout.M2]
    k1 = lane[layout.K1] * by_m1
    c[_K1], c[_BETA] = k1 * lane[layout.ALPHA], k1 * lane[layout.BETA]
    c[_D] = lane[layout.D] * by_m1
    pair, held = control_forces(model, lane[layout.FORCE])
    c[_PAIR], c[_HELD] = pair * by_m1, held * by_m1
    k0, stretch = lane[layout.K0] * by_m1, lane[layout.STRETCH]
    c[_K2] = 0.0
    if model[IS_FINITE] > 0.0:
        c[_TWICE_K0], c[_PULL], c[_BY_L0] = k0 + k0, k0 * lane[layout.L0], 1.0 / lane[layout.L0]
    elif value_of(k0) > 0.0:
        c[_K2] = stiffness(k0, stretch)
    c[_STICK] = lane[layout.C] * by_m1
    if model[HAS_FRICTION] > 0.0:
        vr, normal = lane[layout.VR], lane[layout.FN]
        c[_STICK] = stick_slope(lane[layout.MU1], normal, vr) * by_m1
        c[_CHI] = lane[layout.CHI] * by_m1
        kinetic = kinetic_force(lane[layout.MU2], normal)
        c[_INTERCEPT] = slip_intercept(kinetic, lane[layout.CHI], vr) * by_m1


@inlined_kernel
def _enter(c, regime):
    """Write slope and force at w = 0 of the interface in a regime: (3), (4)."""
    c[SLOPE], c[SLIP] = c[_STICK], 0.0
    if regime != 0.0:
        c[SLOPE], c[SLIP] = c[_CHI], c[_INTERCEPT] * regime


@inlined_kernel
def _link(c):
    """Return the force of the interface per m1 [m/s^2]."""
    return value_of(c[SLOPE]) * value_of(c[W]) + value_of(c[SLIP])


@borrowing_kernel
def _write_excitation(model, lanes, i, c, elapsed, unit):
    """Write the series of the force on the carriage and of the ground's acceleration."""
    for n in range(ORDER + 1):
        c[FORCE + n] = c[GROUND + n] = 0.0
    force, ground, harmonic = from_row(c, FORCE), from_row(c, GROUND), from_row(c, _HARMONIC)
    add_jets(force, ground, model, lanes, i, elapsed, unit, ORDER)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        read_harmonic(model, lanes, i, j, harmonic)
        shakes = (int(model[layout.GROUND]) >> j) & 1
        wave = harmonic[0], harmonic[1], harmonic[2], harmonic[3]
        add_harmonic(ground if shakes else force, wave, elapsed, unit, ORDER)


@inlined_kernel
def _expand(model, c, unit, enough):
    """Write the series in powers of time over a unit [s]; return their order, 0 if collapsed."""
    prefer_widest_vectors()
    cubic, finite, excited = model[IS_CUBIC] > 0.0, model[IS_FINITE] > 0.0, is_excited(model)
    k1, beta, d, k2, ratio = c[_K1], c[_BETA], c[_D], c[_K2], c[_RATIO]
    damping, slip, held, by_m1 = c[SLOPE], c[SLIP], c[_HELD], c[_BY_M1]
    x1, offset, v1, w = c[_X1], c[_OFFSET], c[V1], c[W]
    most = _first_size(c, unit)
    for n in range(ORDER):
        step = unit / (n + 1.0)
        if finite:
            if not _stretch(c, offset, n):
                return 0
            inner = fma(c[_TWICE_K0], offset, c[_PULL] * (c[_SHORT + n] - c[_LONG + n]))  # (6)
        else:
            inner = k2 * offset  # (5)
        inner, outer = fma(damping, w, inner), fma(k1, x1, d * v1)
        if n == 0:
            inner, outer = inner + slip + c[_PAIR], outer - held
        if cubic:
            outer = fma(beta, _cube(c, n), outer)
        if excited:
            outer = outer - c[FORCE + n] * by_m1
        x1, offset = v1 * step, w * step
        v1, w = (inner - outer) * step, (outer - ratio * inner) * step  # (1), (2) less (1)
        if excited:
            v1 = v1 - c[GROUND + n] * step
        c[_X1 + n + 1], c[_OFFSET + n + 1], c[V1 + n + 1], c[W + n + 1] = x1, offset, v1, w
        if n >= enough[1]:
            most = _larger(most, _size(c, n + 1 - enough[1]))
        if n + 1 >= FEWEST and _is_enough(c, n + 1, most, enough):
            return n + 1
    return ORDER


@inlined_kernel
def _stretch(c, offset, n):
    """Write term n of both sides' stretch**-2, given that of the offset; False if collapsed.

    From q u' = -2 q' u with u = q**-2: n q_0 u_n = -sum (n + j) q_j u_(n - j).
    """
    c[_SHIFT + n] = offset * c[_BY_L0]
    if n == 0:
        lane = from_row(c, LANE)
        stretch, l0, rest = lane[layout.STRETCH], lane[layout.L0], value_of(c[_REST])
        # Rounded once: of a side that is nearly gone no digits cancel.
        long = (fma(stretch, l0, offset) + rest) * c[_BY_L0]
        short = (fma(stretch, l0, -offset) - rest) * c[_BY_L0]
        if not (long > 0.0 and short > 0.0):
            return False
        c[_BY_LONG], c[_BY_SHORT] = 1.0 / long, 1.0 / short
        c[_LONG], c[_SHORT] = c[_BY_LONG] * c[_BY_LONG], c[_BY_SHORT] * c[_BY_SHORT]
        return True
    of_long = of_short = alike(offset, 0.0)
    for j in range(1, n + 1):
        shift = c[_SHIFT + j] * float(n + j)
        of_long = fma(shift, c[_LONG + n - j], of_long)
        of_short = fma(shift, c[_SHORT + n - j], of_short)
    c[_LONG + n] = of_long * c[_BY_LONG] * (-1.0 / n)
    c[_SHORT + n] = of_short * c[_BY_SHORT] * (1.0 / n)
    return True


@inlined_kernel
def _cube(c, n):
    """Return term n of x1**3, and write that of x1**2, of which terms come in equal pairs."""
    square = cube = alike(c[_X1], 0.0)
    for m in range((n + 1) // 2):
        square = fma(c[_X1 + m], c[_X1 + n - m], square)
    square = square * 2.0
    if n % 2 == 0:
        square = fma(c[_X1 + n // 2], c[_X1 + n // 2], square)
    c[_SQUARE + n] = square
    for m in range(n + 1):
        cube = fma(c[_SQUARE + m], c[_X1 + n - m], cube)
    return cube


@inlined_kernel
def _magnitude(x):
    """Return the magnitudes of value and slopes, as a number of the same kind."""
    return tangent(abs(value_of(x)), abs(slopes_of(x)))


@inlined_kernel
def _larger(x, y):
    """Return the larger ones of two numbers' values and slopes."""
    return tangent(max(value_of(x), value_of(y)), larger(slopes_of(x), slopes_of(y)))


@inlined_kernel
def _size(c, n):
    """Return the size of terms n [m/s]: those of positions follow from those of velocities."""
    return _larger(_magnitude(c[V1 + n]), _magnitude(c[W + n]))


@inlined_kernel
def _first_size(c, unit):
    """Return the size of the first terms, positions over the unit of time [m/s]."""
    positions = _larger(_magnitude(c[_X1]), _magnitude(c[_OFFSET]))
    return _larger(_size(c, 0), positions * (1.0 / unit))


@inlined_kernel
def _last(c, order, count):
    """Return the size of the largest of the last terms [m/s], of which there are at least four."""
    one, other = _larger(_size(c, order), _size(c, order - 1)), _size(c, order - 2)
    size = _larger(one, _larger(other, _size(c, order - 3)))
    for n in range(4, count):
        size = _larger(size, _size(c, order - n))
    return size


@inlined_kernel
def _is_enough(c, order, most, enough):
    """Tell whether the last terms of the motion and of every column are below the cut-off."""
    cut_off, count = enough
    if not value_of(_last(c, order, count)) <= cut_off * value_of(most):
        return False
    return none(slopes_of(_last(c, order, count)) > cut_off * slopes_of(most))


@inlined_kernel
def _part_of_unit(model, c, unit, enough):
    """Return the part of the unit within which the last terms are below the cut-off.

    Relative to the leading terms there: beyond the radius of convergence the others grow.
    """
    part, last, first = 1.0, _last(c, ORDER, enough[1]), _first_size(c, unit)
    most = first
    for n in range(1, ORDER - enough[1] + 1):
        most = _larger(most, _size(c, n))
    for _ in range(_ROUNDS):
        lead, power = first, part
        for n in range(1, _LEADING):
            lead, power = _larger(lead, _size(c, n) * power), power * part
        part = _part_of(value_of(last), value_of(lead), value_of(most), enough)
        for j in range(int(model[WIDTH])):
            sizes = element(slopes_of(last), j), element(slopes_of(lead), j)
            part = min(part, _part_of(*sizes, element(slopes_of(most), j), enough))
    return part


@inlined_kernel
def _part_of(last, lead, most, enough):
    """Return the same of one column, given its last terms, leading ones and largest [m/s]."""
    scale = enough[0] * (lead if lead > 0.0 else most)
    if last <= scale:
        return 1.0
    return 0.9 * (scale / last) ** (1.0 / (ORDER - enough[1] + 1.0))


@borrowing_kernel
def _evaluate(c, theta, order):
    """Advance the state by a part of the unit.

    What rounding leaves of the offset is kept: a spring that is shortened to a part e of its length
    pushes the sphere back with a stiffness that rounded offsets would make wrong by 1e-16 / e, and
    the deviations after that by 1e-16 / e**2.
    """
    prefer_widest_vectors()
    x1, offset, v1, w = c[_X1 + order], c[_OFFSET + order], c[V1 + order], c[W + order]
    for n in range(order - 1, 0, -1):  # side by side: one hides the other's latency
        x1, offset = fma(x1, theta, c[_X1 + n]), fma(offset, theta, c[_OFFSET + n])
        v1, w = fma(v1, theta, c[V1 + n]), fma(w, theta, c[W + n])
    c[_X1], c[V1], c[W] = fma(x1, theta, c[_X1]), fma(v1, theta, c[V1]), fma(w, theta, c[W])
    change = offset * theta
    value, c[_REST] = total(value_of(c[_OFFSET]), value_of(change) + value_of(c[_REST]))
    c[_OFFSET] = tangent(value, slopes_of(c[_OFFSET]) + slopes_of(change))


@inlined_kernel
def _slope(terms, theta, order):
    """Return the derivative of a series over time in its unit."""
    slope = 0.0
    for n in range(order, 0, -1):
        slope = slope * theta + n * terms[n]
    return slope


@borrowing_kernel
def _jump(c, boundary, rate, regime):
    """Enter a regime at a slip velocity [m/s] that had a rate [m/s^2], and jump: the saltation."""
    late = (boundary - c[W]) / rate
    before = _link(c)
    _enter(c, regime)
    step = late * (before - _link(c))
    c[V1] = c[V1] + step
    c[W] = tangent(value_of(boundary), slopes_of(c[W] - c[_RATIO] * step))


def propagating(note, enough=_ENOUGH):
    """Return a kernel that advances motion and deviations by a sample interval, or a part of it.

    For each series it calls `note(model, lanes, i, c, (unit, theta, order))`: theta is the part of
    the unit [s] that is taken. Of `enough` see above.
    """

    @borrowing_kernel
    def advance(model, lanes, i, c, slip):
        """Advance one lane, series by series, with room for those of the slip velocity."""
        prefer_widest_vectors()
        friction, lane = model[HAS_FRICTION] > 0.0, from_row(c, LANE)
        vr = value_of(lane[layout.VR]) if friction else np.inf
        regime = sign_of(vr, value_of(c[W]))
        upper, lower = gaps_of(vr, value_of(c[W]))
        elapsed, unit, duration = 0.0, model[layout.SAMPLE_INTERVAL], model[layout.SAMPLE_INTERVAL]
        _enter(c, regime)
        for _ in range(MOST_SERIES):
            unit = min(unit, duration - elapsed)
            is_last = unit == duration - elapsed
            if is_excited(model):
                _write_excitation(model, lanes, i, c, elapsed, unit)
            order = _expand(model, c, unit, enough)
            if order == 0:
                return layout.COLLAPSED
            theta, direction = 1.0, 0.0
            if order == ORDER:
                theta = _part_of_unit(model, c, unit, enough)
            if friction:
                for n in range(order + 1):
                    slip[n] = value_of(c[W + n])
                exit_at, direction = regime_exit_within(
                    slip, 0, _LENGTH, order, theta, regime, upper, lower
                )
                theta = theta if exit_at == NONE else theta * exit_at
            note(model, lanes, i, c, (unit, theta, order))
            _evaluate(c, theta, order)
            size = abs(value_of(c[_X1])) + abs(value_of(c[_OFFSET]))
            if not size + abs(value_of(c[V1])) + abs(value_of(c[W])) < np.inf:
                return layout.DIVERGED
            elapsed += theta * unit
            if direction != 0.0:
                rate, regime = _slope(slip, theta, order) / unit, direction - regime
                _jump(c, lane[layout.VR] * direction, rate, regime)
                upper, lower = gaps_on(vr, direction)
            else:
                upper, lower = gaps_of(vr, value_of(c[W]))
                if is_last and theta == 1.0:
                    break
            if elapsed >= duration:
                break
            if order < ORDER:
                unit *= LONGER
            elif direction == 0.0:
                unit *= max(theta, SHORTER)
        else:
            return layout.TOO_MANY_SERIES
        lane[layout.X1], lane[layout.X2] = c[_X1], c[_X1] + c[_OFFSET]
        lane[layout.V1], lane[layout.V2] = c[V1], c[V1] + c[W]
        write_state(model, lanes, i, 4, lane)
        return layout.OK

    @borrowing_kernel
    def advance_all(model, lanes, slip, first, last):
        c, status = tangents_of(_numbers()), layout.OK
        for i in range(first, last):
            _load(model, lanes, i, c)
            status = max(status, advance(model, lanes, i, c, slip))
        return status

    @kernel
    def propagate(model, lanes, first, last):
        return advance_all(model, lanes, np.empty(2 * _LENGTH), first, last)

    return propagate


@inlined_kernel
def _pass_over(model, lanes, i, c, series):
    """Note nothing of a series."""


propagate = propagating(_pass_over)
