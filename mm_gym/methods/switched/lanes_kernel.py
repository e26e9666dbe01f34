"""The series of `series_kernel` on LANES lanes at a time, each with parameters of its own.

Every lane goes on by pieces: to the end of what is left of the sample interval, or as far as a
series goes, where the slip velocity w provably stays in its regime; else to the first crossing;
else, where neither is proved, it tries half the piece. Lanes that need too many pieces are left to
`series_kernel`.

A lane's arithmetic and decisions depend neither on its neighbours nor on their number.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.excitation.sources import MOST_ROWS, is_excited, load_sources, series_of_sources
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write, write_states
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, alike, everywhere
from mm_gym.lanes.simd_masks import all_hold, bits, larger, lowest, none, smaller, where
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.dry_friction import slip_intercept
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness
from mm_gym.methods.switched import series_kernel

WIDTH = 32
"""More than the degree of any series."""

ROUND_OFF = 2.0**-54
"""Error of an instant, as a fraction of a piece, that changes nothing."""

SPARE, SPARE_EACH = 32, 8
"""Pieces that may be tried for the sake of crossings: in a sample interval, and more for each of
its pieces."""

_ROUGH_DEGREE, _ROUGH_STEPS, _STEPS = 6, 2, 8  # of the search for a crossing

# Slots of the model behind the degree: the longest piece [s] in stick, and in slip behind it; the
# pieces that may be tried, 0 if lanes are followed alone; and 1 / n from n = 1 on.
LONGEST, MOST_PIECES, RECIPROCALS = (series_kernel.DEGREE + k for k in (1, 3, 4))
END = RECIPROCALS + WIDTH

# Rows of vectors: the series of v1 and w, of the carriage's force and of the ground's acceleration,
# and what the last two follow from.
_V1, _W, _FORCE, _GROUND, _SOURCES = (WIDTH * k for k in range(5))
_SIZE = _SOURCES + MOST_ROWS

_READ = (
    *(layout.X1, layout.X2, layout.V1, layout.V2, layout.FORCE, layout.M1, layout.M2, layout.K1),
    *(layout.ALPHA, layout.D, layout.K0, layout.STRETCH, layout.C, layout.CHI, layout.VR),
    layout.KINETIC_FORCE,
)
"""Rows of lanes that are read where nothing excites them."""


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    if model[MOST_PIECES] == 0.0:
        return series_kernel.propagate(model, lanes, first, last)
    status, b = layout.OK, rows_of(on_cache_line(_SIZE * LANES))
    for i in range(first, last, LANES):
        left = _advance(model, lanes, b, i, min(LANES, last - i))
        while left != 0:
            lane = i + lowest(left)
            left &= left - 1
            status = max(status, series_kernel.propagate(model, lanes, lane, lane + 1))
    return status


@kernel
def advance(model, lanes, which):
    """Advance the lanes listed by one sample interval, in which nothing excites them.

    Parameters
    ----------
    which
        (n,) int64, read: the lanes. Those that are left as they were are written to its beginning.

    Returns
    -------
    int
        How many these are.
    """
    few, b, left = np.empty((lanes.shape[0], LANES)), rows_of(on_cache_line(_SIZE * LANES)), 0
    for start in range(0, which.size, LANES):
        count = min(LANES, which.size - start)
        for row in _READ:
            for k in range(count):
                few[row, k] = lanes[row, which[start + k]]
        stay = _advance(model, few, b, 0, count)
        for k in range(count):
            lane = which[start + k]
            for row in range(4):
                lanes[row, lane] = few[row, k]
            which[left] = lane
            left += (stay >> k) & 1
    return left


@borrowing_kernel
def _advance(model, lanes, b, i, count):
    """Advance the lanes i .. i + count - 1; return the bits of those that are left as they were."""
    prefer_widest_vectors()
    stay_apart()
    interval, degree = model[layout.SAMPLE_INTERVAL], int(model[series_kernel.DEGREE])
    p, vr = _parameters(model, lanes, i, count)
    x1, v1 = read(lanes, layout.X1, i, count), read(lanes, layout.V1, i, count)
    offset, w = read(lanes, layout.X2, i, count) - x1, read(lanes, layout.V2, i, count) - v1
    zero, one = everywhere(0.0), everywhere(1.0)
    regime = where(w > vr, one, where(w < -vr, -one, zero))
    rest = everywhere(interval)
    unit, excited = smaller(rest, _longest(model, regime)), is_excited(model)
    if excited:
        load_sources(model, lanes, i, count, b, _SOURCES)
    for _ in range(int(model[MOST_PIECES])):
        if excited:
            piece, targets = (interval - rest, unit), (_FORCE, _GROUND)
            series_of_sources(model, b, _SOURCES, piece, targets, degree)
        z, regime, rest, unit = _take(model, b, p, vr, (x1, offset, v1, w), regime, rest, unit)
        x1, offset, v1, w = z
        if none(rest > 0.0):
            break
    if count == LANES and none(rest > 0.0):
        write_states(lanes, i, x1, x1 + offset, v1, v1 + w)
        return 0
    left = bits(rest > 0.0) & ((1 << count) - 1)
    state = x1, x1 + offset, v1, v1 + w
    for row in range(4):
        value = where(rest > 0.0, read(lanes, row, i, count), state[row])
        write(lanes, row, i, count, value)
    return left


@inlined_kernel
def _longest(model, regime):
    """Return the longest piece [s] in a regime."""
    return where(regime == 0.0, model[LONGEST], alike(regime, model[LONGEST + 1]))


@inlined_kernel
def _parameters(model, lanes, i, count):
    """Return what the equations need, over m1 but for the ratio of both masses, and v_r [m/s]."""
    by_m1 = 1.0 / read(lanes, layout.M1, i, count)
    k1 = by_m1 * (read(lanes, layout.K1, i, count) * read(lanes, layout.ALPHA, i, count))
    k2 = by_m1 * stiffness(read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count))
    vr, chi = read(lanes, layout.VR, i, count), read(lanes, layout.CHI, i, count)
    intercept = slip_intercept(read(lanes, layout.KINETIC_FORCE, i, count), chi, vr)
    pair, held = control_forces(model, by_m1 * read(lanes, layout.FORCE, i, count))
    ratio = 1.0 + read(lanes, layout.M1, i, count) / read(lanes, layout.M2, i, count)
    springs = k1, by_m1 * read(lanes, layout.D, i, count), k2, ratio
    lines = by_m1 * read(lanes, layout.C, i, count), by_m1 * chi, by_m1 * intercept
    return (springs, lines, (pair, held, by_m1)), vr


@inlined_kernel
def _take(model, b, p, vr, z, regime, rest, unit):
    """Advance by a piece, or halve it.

    Returns
    -------
    tuple
        The state x1, x2 - x1, v1, w [m, m/s]; the regime; what is left of the sample interval, and
        the next piece [s]. A lane of which nothing is left does not move.
    """
    w, degree = z[3], int(model[series_kernel.DEGREE])
    (y1, y2, u1), change, bend = _expand(model, b, p, z, regime, unit)
    zero, one = everywhere(0.0), everywhere(1.0)
    sticks = regime == 0.0
    side = where(sticks, where(w + change > 0.0, -one, one), regime)
    # The gap to the nearest boundary is edge + side w, that to the other one is span less that.
    edge, span = where(sticks, vr, -vr), where(sticks, 2.0 * vr, everywhere(np.inf))
    gap, room = fma(side, w, edge), 0.5 * bend
    following = fma(side, change, gap)
    both = gap + following
    stays = (following >= 0.0) & (both >= room) & (2.0 * span - both >= room)
    u2, passed, next_unit = w + change, unit, rest
    if not all_hold(stays):
        t = _exit(b, degree, (side, gap, following), (room, span))
        t = where(stays, -one, t)
        crosses, fraction = t >= 0.0, where(t > 0.0, t, zero)
        e1, e2, s1 = _evaluate(model, b, z, unit, fraction)  # where nothing is proved, z itself
        y1, y2, u1 = where(stays, y1, e1), where(stays, y2, e2), where(stays, u1, s1)
        u2 = where(stays, u2, where(crosses, -edge * side, w))
        regime = where(crosses, where(sticks, -side, zero), regime)
        passed = where(stays, unit, fraction * unit)
        next_unit = where(stays, rest, where(crosses, rest, 0.5 * unit))
    rest = rest - passed
    unit = smaller(smaller(next_unit, _longest(model, regime)), rest)
    return (y1, y2, u1, u2), regime, rest, unit


@inlined_kernel
def _expand(model, b, p, z, regime, unit):
    """Write the series of v1 and w; return what both add to a state in a unit of time [s].

    Returns
    -------
    tuple
        x1, x2 - x1 and v1 a unit later; the change of w, and a bound of unit**2 |w''| [m/s].
    """
    (x1, offset, v1, w), degree = z, int(model[series_kernel.DEGREE])
    (k1, d, k2, ratio), (stick, chi, intercept), (pair, push, by_m1) = p
    slope, excited = where(regime == 0.0, stick, chi), is_excited(model)
    between, zero = fma(regime, intercept, pair), everywhere(0.0)
    y1, y2, u1, change, bend, ground = x1, offset, v1, zero, zero, zero
    b[_V1], b[_W] = v1, w
    for n in range(degree):
        step = unit * model[RECIPROCALS + n]
        if excited:
            push, ground = fma(by_m1, b[_FORCE + n], push), b[_GROUND + n]
        inner = fma(slope, w, fma(k2, offset, between))
        outer = fma(d, v1, fma(k1, x1, -push))
        x1, offset = step * v1, step * w
        # (1) of docs/model.md; (2) less (1), and not v2 - v1: near a stiff stick its digits would
        # cancel.
        v1, w = step * (inner - outer - ground), step * fma(-ratio, inner, outer)
        between, push = zero, zero
        y1, y2, u1, change = y1 + x1, y2 + offset, u1 + v1, change + w
        bend = fma(n * (n + 1.0), abs(w), bend)
        b[_V1 + n + 1], b[_W + n + 1] = v1, w
    return (y1, y2, u1), change, bend


@inlined_kernel
def _evaluate(model, b, z, unit, t):
    """Return x1, x2 - x1 and v1 at a part t of a unit of time, from the series of v1 and w."""
    x1 = offset = v1 = everywhere(0.0)
    degree = int(model[series_kernel.DEGREE])
    for n in range(degree, 0, -1):
        v, over = b[_V1 + n], model[RECIPROCALS + n]
        x1, offset = fma(x1, t, over * v), fma(offset, t, over * b[_W + n])
        v1 = fma(v1, t, v)
    time = unit * t
    x1, offset = fma(x1, t, z[2]), fma(offset, t, z[3])
    return fma(time, x1, z[0]), fma(time, offset, z[1]), fma(v1, t, z[2])


@inlined_kernel
def _change_and_rate(b, t, degree):
    """Return the change of w from now to t, and its derivative there, by the terms up to degree."""
    value = rate = alike(t, 0.0)
    for n in range(degree, 0, -1):
        rate = fma(rate, t, value)
        value = fma(value, t, b[_W + n])
    return value * t, fma(rate, t, value)


@inlined_kernel
def _exit(b, degree, gaps, bounds):
    """Return the first exit from the regime, as a part of the piece, or -1 where none is proved.

    Parameters
    ----------
    b, degree
        (_SIZE, LANES) read: the series; their degree.
    gaps
        Side of the boundary, and the gaps to it [m/s] now and after the piece.
    bounds
        That of h**2 |w''| / 2, and the distance of the regime's boundaries [m/s].
    """
    (side, gap, following), (bend, span) = gaps, bounds
    t, nothing, whole = gap / (gap - following), everywhere(0.0), everywhere(1.0)
    for _ in range(_ROUGH_STEPS):
        change, rate = _change_and_rate(b, t, min(degree, _ROUGH_DEGREE))
        t = smaller(larger(nothing, t - fma(side, change, gap) / (side * rate)), whole)
    moves, slope = where(following < 0.0, whole, 0.0), nothing
    for _ in range(_STEPS):
        change, rate = _change_and_rate(b, t, degree)
        rate = side * rate
        reached = t - fma(side, change, gap) / rate
        inside = (reached >= 0.0) & (reached <= whole)
        step = reached - t
        is_root = inside & (bend * (step * step) <= ROUND_OFF * abs(rate))  # of what is left
        slope = where(moves > 0.0, rate, slope)
        t = where(moves > 0.0, smaller(larger(nothing, reached), whole), t)
        moves = where(is_root, nothing, moves)
        if none(moves > 0.0):
            break
    # It is the first one if the gap falls all the way, or is too large to vanish before.
    bent = bend * t
    first = larger(larger(gap - bent * t, -slope - 2.0 * bent), -side * b[_W + 1] - 2.0 * bent)
    proved = (first >= 0.0) & (slope < 0.0) & (2.0 * span - gap >= bent * t)
    return where(proved & (following < 0.0) & (moves == 0.0), t, -1.0)
