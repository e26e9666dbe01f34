"""Event-exact propagation of a linear plant with dry friction (eq. 9 of the paper).

Within a regime (stick, or slip in either direction) the plant is affine, and precomputed
transition matrices for the sample interval and its halves, quarters, ... (levels) advance it
exactly. An interval of a level is taken whole if the slip velocity w provably stays in its regime:
a chord of w over a time h is wrong by at most t (h - t) / 2 times the largest |w''|, which the
model bounds. Otherwise the interval is halved. The last level is short enough for a Taylor series
(`series_kernel`), which finds every crossing to round-off, two within one step included; there is
no tolerance. Where there is one level only, `lanes_kernel` follows many such lanes at a time.

The state alone tells the regime: on w = +-v_r the slip acceleration jumps outwards, so a trajectory
never rests there.
"""

from __future__ import annotations

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.law.events import sign_of
from mm_gym.methods.switched import lanes_kernel
from mm_gym.methods.switched import layout as slots
from mm_gym.methods.switched.series_kernel import (
    COEFFICIENTS,
    HELD,
    SERIES,
    load_coefficients,
    walk,
)

_HARMONIC_SLOTS = (
    *(slots.HARMONIC_ROWS + 2 * row for row in range(4)),
    *(slots.HARMONIC_SECOND, slots.HARMONIC_CHANGE, slots.HARMONIC_GAINS),
)

MOST_INTERVALS = 1 << 20
"""Intervals tried in one sample interval before giving up: some 0.1 s of work."""

# Some lanes at a time are worked on with scratch rows that lie WIDTH apart: with distances known
# when it is compiled, the compiler vectorises the loops without checking for overlap.
WIDTH = 64

# Scratch: the next state, whether a lane may leave its regime, and what the harmonics add to the
# state, to w'' now, to the change of w and to the gains.
_LEAVES, _ADDED = 4 * WIDTH, 5 * WIDTH
_SCRATCH_ROWS = 12 * WIDTH


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval, or a part of it; force and stretch are held."""
    part = model[layout.SAMPLE_INTERVAL]
    if part == model[slots.WHOLE]:
        return propagate_whole(model, lanes, first, last)
    return _follow(model, lanes, np.arange(first, last), part)


@kernel
def propagate_whole(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    harmonics, in_slip = int(model[layout.HARMONIC_COUNT]), _level(model, int(model[slots.SLIP]))
    room = np.empty(_SCRATCH_ROWS + last - first)  # one array: to make two takes a lane longer
    scratch, which, left = room[:_SCRATCH_ROWS], room[_SCRATCH_ROWS:].view(np.int64), 0
    _clear_added(scratch, min(WIDTH, last - first))
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        if harmonics > 0:
            _clear_added(scratch, count)
            for j in range(harmonics):
                _add_harmonic(model, lanes, scratch, j, start, count)
        if _some_slip(model[slots.VR], lanes, start, count):
            leaving = _propagate(model, lanes, scratch, start, count, in_slip)
        else:  # the common case once motions have decayed
            leaving = _propagate(model, lanes, scratch, start, count, None)
        if leaving > 0:
            for i in range(count):
                which[left] = start + i
                left += int(scratch[_LEAVES + i])
    if left > 0 and model[slots.SERIES] > 0.0:
        left = lanes_kernel.advance(model[int(model[slots.SERIES]) :], lanes, which[:left])
    return _follow(model, lanes, which[:left], None) if left > 0 else layout.OK


@borrowing_kernel
def _clear_added(scratch, count):
    """Set what the harmonics add to zero."""
    for row in range(7):
        for i in range(count):
            scratch[_ADDED + row * WIDTH + i] = 0.0


@kernel
def _stays(vr, sign, w, next_w, bend):
    """Tell whether w stays in its regime all the way.

    It does if the chord from w to next_w leaves room for the bend, 4 times the largest sag [m/s].
    """
    chord = w + next_w
    room = 2.0 * vr - abs(chord) if sign == 0.0 else sign * chord - 2.0 * vr
    return (room >= bend) & (abs(next_w) <= vr if sign == 0.0 else sign * next_w >= vr)


@borrowing_kernel
def _some_slip(vr, lanes, first, count):
    """Tell whether a lane slips."""
    prefer_widest_vectors()
    v1s, v2s = lanes[layout.V1, first : first + count], lanes[layout.V2, first : first + count]
    some = False
    for i in range(count):
        some |= sign_of(vr, v2s[i] - v1s[i]) != 0.0
    return some


@borrowing_kernel
def _propagate(model, lanes, scratch, first, count, in_slip):
    """Advance those lanes whose regime provably lasts; return how many may leave it.

    Where all stick, `in_slip` is None instead of the level of the whole interval in slip: so it is
    compiled without the arithmetic of slip, half of all.
    """
    prefer_widest_vectors()
    vr, stick, slip = model[slots.VR], int(model[slots.STICK]), int(model[slots.SLIP])
    in_stick = _level(model, stick)
    stick_gain, slip_gain = model[stick + slots.GAIN_OF_SECOND], model[slip + slots.GAIN_OF_SECOND]
    x1s, x2s = lanes[layout.X1, first : first + count], lanes[layout.X2, first : first + count]
    v1s, v2s = lanes[layout.V1, first : first + count], lanes[layout.V2, first : first + count]
    us, leaving = lanes[layout.FORCE, first : first + count], 0
    for i in range(count):
        x1, x2, v1, v2, u = x1s[i], x2s[i], v1s[i], v2s[i], us[i]
        w = v2 - v1
        s = sign_of(vr, w)
        z, moving = (x1, x2, v1, v2, s, u), (x1, x2 - x1, v1, w, s, u)
        sizes = (abs(x1), abs(x2 - x1), abs(v1), abs(w), abs(s), abs(u))
        y1, y2 = _chosen(s, in_stick, in_slip, 0, z), _chosen(s, in_stick, in_slip, 1, z)
        y3, y4 = _chosen(s, in_stick, in_slip, 2, z), _chosen(s, in_stick, in_slip, 3, z)
        second = _chosen(s, in_stick, in_slip, 4, moving) + scratch[_ADDED + 4 * WIDTH + i]
        change = _chosen(s, in_stick, in_slip, 5, moving) + scratch[_ADDED + 5 * WIDTH + i]
        bend = _chosen(s, in_stick, in_slip, 6, sizes) + scratch[_ADDED + 6 * WIDTH + i]
        scratch[i], scratch[WIDTH + i] = y1 + scratch[_ADDED + i], y2 + scratch[_ADDED + WIDTH + i]
        scratch[2 * WIDTH + i], scratch[3 * WIDTH + i] = (
            y3 + scratch[_ADDED + 2 * WIDTH + i],
            y4 + scratch[_ADDED + 3 * WIDTH + i],
        )
        bend = fma(stick_gain if s == 0.0 else slip_gain, abs(second), bend)
        leaves = not _stays(vr, s, w, w + change, bend)
        scratch[_LEAVES + i] = leaves
        leaving += leaves
    for row in range(4):
        reached, following = lanes[row, first : first + count], scratch[row * WIDTH :]
        for i in range(count):
            reached[i] = following[i] if scratch[_LEAVES + i] == 0.0 else reached[i]
    return leaving


@borrowing_kernel
def _level(model, k):
    """Return the rows of the level at slot k: of the state, w'' now, the change of w, the gains."""
    return (
        _coefficients(model, k + slots.ROWS),
        _coefficients(model, k + slots.ROWS + 6),
        _coefficients(model, k + slots.ROWS + 12),
        _coefficients(model, k + slots.ROWS + 18),
        _coefficients(model, k + slots.SECOND),
        _coefficients(model, k + slots.CHANGE),
        _coefficients(model, k + slots.GAINS),
    )


@borrowing_kernel
def _coefficients(model, k):
    """Return the coefficients of a row from slot k."""
    return model[k], model[k + 1], model[k + 2], model[k + 3], model[k + 4], model[k + 5]


@borrowing_kernel
def _chosen(s, in_stick, in_slip, row, z):
    """Return a row of the lane's regime times its inputs; in_slip is None if all lanes stick."""
    sticking = _product(in_stick[row], z)
    if in_slip is None:
        return sticking
    slipping = _product(in_slip[row], z)
    return sticking if s == 0.0 else slipping


@borrowing_kernel
def _product(m, z):
    """Return a row times the inputs without harmonics."""
    outer = fma(m[0], z[0], fma(m[1], z[1], m[4] * z[4]))
    return outer + fma(m[2], z[2], fma(m[3], z[3], m[5] * z[5]))


@borrowing_kernel
def _add_harmonic(model, lanes, scratch, j, first, count):
    """Add what a harmonic contributes to the rows of `_level`.

    Parameters
    ----------
    scratch
        (_SCRATCH_ROWS,) read and written: rows from _ADDED on, of `count` lanes.
    """
    vr, stick, slip = model[slots.VR], int(model[slots.STICK]), int(model[slots.SLIP])
    harmonic, own = (
        layout.HARMONICS + layout.HARMONIC_ROWS * j,
        slots.HARMONICS + slots.HARMONIC_SIZE * j,
    )
    amplitudes = lanes[harmonic + layout.AMPLITUDE, first:]
    cosines, sines = lanes[harmonic + layout.COSINE, first:], lanes[harmonic + layout.SINE, first:]
    v1s, v2s = lanes[layout.V1, first:], lanes[layout.V2, first:]
    for row in range(7):
        k = own + _HARMONIC_SLOTS[row]
        a0, a1, b0, b1 = (
            model[stick + k],
            model[stick + k + 1],
            model[slip + k],
            model[slip + k + 1],
        )
        for i in range(count):
            c, s = amplitudes[i] * cosines[i], amplitudes[i] * sines[i]
            if _HARMONIC_SLOTS[row] == slots.HARMONIC_GAINS:
                c, s = abs(c), abs(s)
            in_stick, in_slip = fma(a0, c, a1 * s), fma(b0, c, b1 * s)
            sticks = sign_of(vr, v2s[i] - v1s[i]) == 0.0
            scratch[_ADDED + row * WIDTH + i] += in_stick if sticks else in_slip


@kernel
def _follow(model, lanes, which, part):
    """Advance one by one the lanes listed; `part` as below."""
    z, p, c = (
        np.empty(7 + 2 * int(model[layout.HARMONIC_COUNT])),
        np.empty(COEFFICIENTS),
        np.zeros(SERIES),
    )
    load_coefficients(lanes, which[0], p)  # all lanes have the same
    status = layout.OK
    for i in which:
        status = max(status, _propagate_by_intervals(model, lanes, i, z, p, c, part))
    return status


@kernel
def _propagate_by_intervals(model, lanes, i, z, p, c, part):
    """Walk through the interval level by level; on the series where the regime may change.

    A sample interval is cut short at its start: what is left of it has whole units of the last
    level, and less than one behind them.

    Parameters
    ----------
    model
        (m,) read: the levels of both regimes.
    lanes
        (rows, count) read and written: the state, force and harmonics of lane i.
    z
        (7 + 2 harmonics,) written: room for the inputs, see `_load_inputs`.
    p
        (COEFFICIENTS,) read, but for the held force, written: see `load_coefficients`.
    c
        (SERIES,) written: room for the series, zeroed when it was made.
    part
        Length [s] of a part of a sample interval, or None for a whole one. For that this is
        compiled without the parts' second call of `walk`, which would keep the compiler from
        inlining the first.
    """
    last_level, size, degree = (
        int(model[slots.LAST_LEVEL]),
        int(model[slots.LEVEL_SIZE]),
        int(model[slots.DEGREE]),
    )
    vr = model[slots.VR]
    _load_inputs(model, lanes, i, z)
    p[HELD] = z[6]
    unit, end = model[slots.WHOLE] / (1 << last_level), 1 << last_level
    position, level = 0, 0  # in units of the last level's time
    if part is not None:
        position = end - int(part / unit)
        while level < last_level and position & ((1 << (last_level - level)) - 1) != 0:
            level += 1
    start = position
    for _ in range(MOST_INTERVALS if start < end else 0):
        first = (int(model[slots.STICK]) if z[5] == 0.0 else int(model[slots.SLIP])) + level * size
        m = model[first : first + size]
        next_w = z[4] + _slip_row(m, slots.CHANGE, slots.HARMONIC_CHANGE, z)
        bend = _slip_gain(m, z) + m[slots.GAIN_OF_SECOND] * abs(
            _slip_row(m, slots.SECOND, slots.HARMONIC_SECOND, z)
        )
        if _stays(vr, z[5], z[4], next_w, bend):
            _take_interval(m, z)
            z[4] = next_w
        elif level < last_level:
            level += 1
            continue
        else:
            elapsed = (position - start) * unit
            status, z[5] = walk(p, c, model, lanes, i, z, z[5], elapsed, unit, degree)
            if status != layout.OK:
                return status
            _turn_harmonics(m, z)
        position += 1 << (last_level - level)
        if position == end:
            break
        while (
            level > 0 and position & ((2 << (last_level - level)) - 1) == 0
        ):  # as long as the place allows
            level -= 1
    if position < end:
        return layout.TOO_MANY_EVENTS
    if part is not None:
        elapsed = (end - start) * unit
        if part > elapsed:
            rest = part - elapsed
            status, z[5] = walk(p, c, model, lanes, i, z, z[5], elapsed, rest, degree)
            if status != layout.OK:
                return status
    for row in range(4):
        lanes[row, i] = z[row]
    return layout.OK


@kernel
def _load_inputs(model, lanes, i, z):
    """Write the inputs of one lane.

    x1, x2, v1, v2, w, sign of slip, u, and each harmonic's cosine and sine times amplitude.
    """
    harmonics = int(model[layout.HARMONIC_COUNT])
    for row in range(4):
        z[row] = lanes[row, i]
    z[4] = z[3] - z[2]
    z[5], z[6] = sign_of(model[slots.VR], z[4]), lanes[layout.FORCE, i]
    for j in range(harmonics):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        z[7 + 2 * j] = lanes[harmonic + layout.AMPLITUDE, i] * lanes[harmonic + layout.COSINE, i]
        z[8 + 2 * j] = lanes[harmonic + layout.AMPLITUDE, i] * lanes[harmonic + layout.SINE, i]


@kernel
def _slip_row(m, row, harmonic_row, z):
    """Return a row of a level times the inputs with offset and slip velocity."""
    total = _product(_coefficients(m, row), (z[0], z[1] - z[0], z[2], z[4], z[5], z[6]))
    for j in range((z.size - 7) // 2):
        own = slots.HARMONICS + slots.HARMONIC_SIZE * j + harmonic_row
        total += m[own] * z[7 + 2 * j] + m[own + 1] * z[8 + 2 * j]
    return total


@kernel
def _slip_gain(m, z):
    """Return a level's gains times the magnitudes of the inputs with offset and slip velocity."""
    sizes = (abs(z[0]), abs(z[1] - z[0]), abs(z[2]), abs(z[4]), abs(z[5]), abs(z[6]))
    total = _product(_coefficients(m, slots.GAINS), sizes)
    for j in range((z.size - 7) // 2):
        own = slots.HARMONICS + slots.HARMONIC_SIZE * j + slots.HARMONIC_GAINS
        total += m[own] * abs(z[7 + 2 * j]) + m[own + 1] * abs(z[8 + 2 * j])
    return total


@kernel
def _take_interval(m, z):
    """Advance the inputs but w by a level."""
    present = (z[0], z[1], z[2], z[3], z[5], z[6])
    for row in range(4):
        z[row] = _product(_coefficients(m, slots.ROWS + 6 * row), present)
    for j in range((z.size - 7) // 2):
        own, cosine, sine = (
            slots.HARMONICS + slots.HARMONIC_SIZE * j + slots.HARMONIC_ROWS,
            z[7 + 2 * j],
            z[8 + 2 * j],
        )
        for row in range(4):
            z[row] += m[own + 2 * row] * cosine + m[own + 2 * row + 1] * sine
    _turn_harmonics(m, z)


@kernel
def _turn_harmonics(m, z):
    """Advance the phases of the harmonics by a level."""
    for j in range((z.size - 7) // 2):
        own, cosine, sine = (
            slots.HARMONICS + slots.HARMONIC_SIZE * j + slots.HARMONIC_TURN,
            z[7 + 2 * j],
            z[8 + 2 * j],
        )
        z[7 + 2 * j] = cosine * m[own] - sine * m[own + 1]
        z[8 + 2 * j] = sine * m[own] + cosine * m[own + 1]
