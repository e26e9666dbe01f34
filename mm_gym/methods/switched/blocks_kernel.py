"""Lanes that may leave their regime, many at a time, for sample intervals of a single level.

Each regime has the Taylor series of v1 and w = v2 - v1; the positions follow by integration. A lane
goes piece by piece: to the end of the sample interval where w provably stays in its regime, else to
the first crossing, else, where neither is proved, on a halved piece. Lanes wait in two lists, for
sticking and for slipping ones, so that those of a vector have the same equations.

A lane's arithmetic and decisions depend neither on its neighbours nor on their number.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES, alike
from mm_gym.lanes.simd_masks import larger, none, smaller, where
from mm_gym.lanes.simd_memory import load, rows_of
from mm_gym.law.events import sign_of
from mm_gym.methods.switched import layout as slots

MOST_PIECES = 32
"""Pieces of a sample interval that are tried here; `mm_gym.methods.switched.kernel` tries more."""

MOST_HALVINGS = 12
"""Halvings of a piece that are tried here."""

ROUND_OFF = 2.0**-54
"""Error of an instant, as a fraction of the sample interval, that changes nothing."""

_ROUGH_DEGREE, _ROUGH_STEPS, _STEPS = 6, 2, 8

# Rows of a waiting lane: its state, the direction of slip and the force held [N]; what is left of
# the sample interval, as a fraction, negative where it has to be followed elsewhere; the number of
# its pieces; its number.
_X1, _OFFSET, _V1, _W, _SIGN, _HELD, _REST, _PIECES, _LANE, _ROWS = range(10)

# Rows of vectors: those of the lanes, then the series of v1 and w.
WIDTH = 32
SERIES_V1, SERIES_W, _SIZE = _ROWS, _ROWS + WIDTH, _ROWS + 2 * WIDTH


@kernel
def advance(model, lanes, which):
    """Advance the lanes listed by one sample interval.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) read, and the state written.
    which
        (n,) int64, read: the lanes. Those that are not followed here are written to its beginning.

    Returns
    -------
    int
        How many these are; their state is unchanged.
    """
    room = on_cache_line(_SIZE * LANES + 2 * _ROWS * (which.size + LANES))
    waiting = room[_SIZE * LANES :].reshape(2, _ROWS, which.size + LANES)
    return _advance(model, lanes, which, waiting, room[: _SIZE * LANES])


@borrowing_kernel
def _advance(model, lanes, which, waiting, b):
    """Advance the lanes listed, see `advance`, with room for both lists and for the vectors."""
    waiting[:, _REST] = 0.0  # reading on behind a list finds lanes that are done
    counts = _wait(model[slots.VR], lanes, which, waiting)
    left = kind = 0
    while counts[0] + counts[1] > 0:
        if counts[kind] == 0:
            kind = 1 - kind
        count = min(counts[kind], LANES)
        first = counts[kind] - count
        counts = (counts[0], first) if kind else (first, counts[1])
        _take_piece(model, waiting[kind], rows_of(b), kind, first)
        counts, left = _leave(lanes, waiting, counts, b, count, which, left)
    return left


@borrowing_kernel
def _wait(vr, lanes, which, waiting):
    """Put the lanes listed into the list of their regime; return how many each has."""
    sticking = slipping = 0
    for i in which:
        x1, v1 = lanes[layout.X1, i], lanes[layout.V1, i]
        w = lanes[layout.V2, i] - v1
        s = sign_of(vr, w)
        kind = int(s != 0.0)
        own, k = waiting[kind], slipping if kind else sticking
        own[_X1, k], own[_OFFSET, k], own[_V1, k], own[_W, k] = x1, lanes[layout.X2, i] - x1, v1, w
        own[_SIGN, k], own[_HELD, k], own[_REST, k] = s, lanes[layout.FORCE, i], 1.0
        own[_PIECES, k], own[_LANE, k] = 0.0, i
        slipping += kind
        sticking += 1 - kind
    return sticking, slipping


@borrowing_kernel
def _leave(lanes, waiting, counts, b, count, which, left):
    """Write the state of lanes whose interval is done; let the others wait for their next piece.

    Parameters
    ----------
    lanes
        (rows, count) written: the state.
    waiting, counts
        (2, _ROWS, n) written: both lists; how many lanes each has.
    b
        (_SIZE * LANES,) read: the lanes.
    count
        How many they are.
    which, left
        (n,) int64, written: the lanes that are not followed here; their number.

    Returns
    -------
    tuple
        Both counts, and the number of lanes that are not followed here.
    """
    sticking, slipping = counts
    for i in range(count):
        rest, lane = b[_REST * LANES + i], int(b[_LANE * LANES + i])
        if rest == 0.0:
            x1, v1 = b[_X1 * LANES + i], b[_V1 * LANES + i]
            lanes[layout.X1, lane], lanes[layout.X2, lane] = x1, x1 + b[_OFFSET * LANES + i]
            lanes[layout.V1, lane], lanes[layout.V2, lane] = v1, v1 + b[_W * LANES + i]
        elif rest < 0.0 or b[_PIECES * LANES + i] >= MOST_PIECES:
            which[left] = lane
            left += 1
        else:
            kind = int(b[_SIGN * LANES + i] != 0.0)
            own, k = waiting[kind], slipping if kind else sticking
            for row in range(_ROWS):
                own[row, k] = b[row * LANES + i]
            slipping += kind
            sticking += 1 - kind
    return (sticking, slipping), left


@borrowing_kernel
def _take_piece(model, waiting, b, kind, first):
    """Advance a vector of lanes of one regime by a piece each.

    Parameters
    ----------
    waiting
        (_ROWS, n) read: the lanes of a list.
    b
        (_SIZE, LANES) written: the lanes.
    kind
        Whether they slip: 0 or 1.
    first
        The lanes first .. first + LANES - 1 of the list.
    """
    prefer_widest_vectors()
    degree, vr = int(model[slots.TERMS]), model[slots.VR]
    # The gap to the nearest boundary is edge + side w, that to the other one is span less that.
    edge, span = (vr, 2.0 * vr) if kind == 0 else (-vr, np.inf)
    z = (
        load(waiting, _X1, first),
        load(waiting, _OFFSET, first),
        load(waiting, _V1, first),
        load(waiting, _W, first),
        load(waiting, _SIGN, first),
        load(waiting, _HELD, first),
    )
    w, sign, rest = z[3], z[4], load(waiting, _REST, first)
    terms = int(model[slots.STICK_SERIES if kind == 0 else slots.SLIP_SERIES])
    _expand(model, terms, b, z, degree)
    bend = _bend(model, int(model[slots.STICK if kind == 0 else slots.SLIP]), b, z)
    zero, length = alike(rest, 0.0), rest
    piece, turn, reached = where(rest > 0.0, -1.0, zero), zero, zero
    for _ in range(MOST_HALVINGS):
        change, _rate = _change_and_rate(b, length, degree)
        side = sign if kind == 1 else where(w + change > 0.0, alike(w, -1.0), 1.0)
        gap = fma(side, w, edge)
        following, room = fma(side, change, gap), bend * length * length
        both = gap + following
        stays = (following >= 0.0) & (both >= room) & (2.0 * span - both >= room)
        found, turned = where(stays, length, -1.0), zero
        if not none((following < 0.0) & (piece < 0.0)):
            exit_at = exit_of(b, degree, (side, gap, following), (bend, span), length)
            found = where(exit_at >= 0.0, exit_at, found)
            turned = where(exit_at >= 0.0, side, turned)
        turn, reached = where(piece < 0.0, turned, turn), where(piece < 0.0, w + change, reached)
        piece = where(piece < 0.0, found, piece)
        if none(piece < 0.0):
            break
        length = 0.5 * length
    x1, offset, v1 = _evaluate(model, terms, b, z, piece, degree)
    crosses = abs(turn) > 0.0
    b[_X1], b[_OFFSET], b[_V1] = x1, offset, v1
    b[_W] = where(crosses, -edge * turn, reached)
    b[_SIGN] = where(crosses, -turn if kind == 0 else zero, sign)
    b[_HELD], b[_REST] = z[5], where(piece < 0.0, piece, rest - piece)
    b[_PIECES], b[_LANE] = load(waiting, _PIECES, first) + 1.0, load(waiting, _LANE, first)


@inlined_kernel
def _expand(model, k, b, z, degree):
    """Write the series of v1 and w, in powers of t over the sample interval.

    Parameters
    ----------
    model, k
        (m,) read; the slot where the regime's terms begin.
    b
        (_SIZE, LANES) written: both series.
    z
        Six vectors: x1, x2 - x1 [m], v1, w [m/s], direction of slip, force held [N].
    """
    ratio, v_before, w_before = model[k + slots.RATIO], z[2], z[3]
    outer = fma(model[k], z[0], fma(model[k + 1], z[2], -model[k + 2] * z[5]))
    held = fma(model[k + 5], z[4], model[k + 6] * z[5])
    inner = fma(model[k + 3], z[1], fma(model[k + 4], z[3], held))
    v, w = inner - outer, fma(-ratio, inner, outer)
    b[SERIES_V1], b[SERIES_W], b[SERIES_V1 + 1], b[SERIES_W + 1] = v_before, w_before, v, w
    for n in range(1, degree):
        own = k + slots.NEXT + slots.TERM * n
        outer = fma(model[own + 1], v, model[own] * v_before)
        inner = fma(model[own + 3], w, model[own + 2] * w_before)
        v_before, w_before, v, w = v, w, inner - outer, fma(-ratio, inner, outer)
        b[SERIES_V1 + n + 1], b[SERIES_W + n + 1] = v, w


@inlined_kernel
def _row(model, k, z):
    """Return six coefficients times the inputs."""
    first = fma(model[k], z[0], fma(model[k + 1], z[1], model[k + 2] * z[2]))
    return first + fma(model[k + 3], z[3], fma(model[k + 4], z[4], model[k + 5] * z[5]))


@inlined_kernel
def _bend(model, k, b, z):
    """Return the bound of h**2 |w''| / 2 over a sample interval h that begins now [m/s]."""
    sizes = (abs(z[0]), abs(z[1]), abs(z[2]), abs(z[3]), abs(z[4]), abs(z[5]))
    half_square = 0.5 * model[slots.WHOLE] * model[slots.WHOLE]
    second = abs(b[SERIES_W + 2]) * (model[k + slots.GAIN_OF_SECOND] / half_square)
    return _row(model, k + slots.GAINS, sizes) + second


@inlined_kernel
def _change_and_rate(b, t, degree):
    """Return the change of w from now to t, and its derivative there, by the terms up to degree."""
    value = rate = alike(t, 0.0)
    for n in range(degree, 0, -1):
        rate = fma(rate, t, value)
        value = fma(value, t, b[SERIES_W + n])
    return value * t, fma(rate, t, value)


@inlined_kernel
def exit_of(b, degree, gaps, bounds, length):
    """Return the first exit from the regime within a length, or -1 where none is proved.

    Parameters
    ----------
    b, degree
        (_SIZE, LANES) read: the series; their degree.
    gaps
        Side of the boundary, and the gaps to it [m/s] now and after the length.
    bounds
        That of h**2 |w''| / 2, and the distance of the regime's boundaries [m/s].
    length
        As a fraction of the sample interval.
    """
    (side, gap, following), (bend, span) = gaps, bounds
    t, nothing = length * (gap / (gap - following)), alike(length, 0.0)
    for _ in range(_ROUGH_STEPS):
        change, rate = _change_and_rate(b, t, min(degree, _ROUGH_DEGREE))
        t = smaller(larger(nothing, t - fma(side, change, gap) / (side * rate)), length)
    moves, slope = where(following < 0.0, alike(length, 1.0), 0.0), nothing
    for _ in range(_STEPS):
        change, rate = _change_and_rate(b, t, degree)
        rate = side * rate
        reached = t - fma(side, change, gap) / rate
        inside = (reached >= 0.0) & (reached <= length)
        step = reached - t
        is_root = inside & (bend * (step * step) <= ROUND_OFF * abs(rate))  # of what is left
        slope = where(moves > 0.0, rate, slope)
        t = where(moves > 0.0, smaller(larger(nothing, reached), length), t)
        moves = where(is_root, nothing, moves)
        if none(moves > 0.0):
            break
    # It is the first one if the gap falls all the way, or is too large to vanish before.
    bent = bend * t
    first = larger(
        larger(gap - bent * t, -slope - 2.0 * bent), -side * b[SERIES_W + 1] - 2.0 * bent
    )
    proved = (first >= 0.0) & (slope < 0.0) & (2.0 * span - gap >= bent * t)
    return where(proved & (following < 0.0) & (moves == 0.0), t, -1.0)


@inlined_kernel
def _evaluate(model, k, b, z, t, degree):
    """Return x1, x2 - x1 and v1 at t.

    Parameters
    ----------
    b
        (_SIZE, LANES) read: the series.
    t
        As a fraction of the sample interval.
    """
    x1 = offset = v1 = alike(t, 0.0)
    for n in range(degree, 0, -1):
        v, over = b[SERIES_V1 + n], model[k + slots.NEXT + slots.TERM * n + 4]
        x1, offset = fma(x1, t, over * v), fma(offset, t, over * b[SERIES_W + n])
        v1 = fma(v1, t, v)
    over = model[k + slots.NEXT + 4]
    x1, offset = fma(x1, t, over * z[2]), fma(offset, t, over * z[3])
    return fma(x1, t, z[0]), fma(offset, t, z[1]), fma(v1, t, z[2])
