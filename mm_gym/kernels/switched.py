"""Event-exact propagation of a linear plant with dry friction (eq. 9 of the paper).

Within a regime (stick, or slip in either direction) the plant is affine, and a ladder of
precomputed transition matrices for the control step and its halves, quarters, ... advances it
exactly. An interval of the ladder is taken whole if the slip velocity w provably stays in its
regime: a chord of w over a time h is wrong by at most t (h - t) / 2 times the largest |w''|, which
the model bounds. Otherwise the interval is halved. The last rung is short enough for a Taylor
series (kernels/friction.py), which finds every crossing to round-off, two within one step included;
there is no tolerance.

The state alone tells the regime: on w = +-v_r the slip acceleration jumps outwards, so a trajectory
never rests there.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.friction import coefficients, sign_of, walk
from mm_gym.kernels.jit import kernel

# Slots of the model; STICK and SLIP hold where the rungs of each regime begin, the whole control
# step first.
VR, LAST_RUNG, STICK, SLIP, RUNG_SIZE, DEGREE = (at.MODEL_OWN + i for i in range(6))
REGIMES = at.MODEL_OWN + 6

# Slots of a rung: rows against the inputs (x1, x2, v1, v2, sign, u), or, for w'' now, the change of
# w and the gains of h**2 |w''| / 2, against the inputs (x1, x2 - x1, v1, w, sign, u).
SECOND, ROWS, CHANGE, GAINS, GAIN_OF_SECOND, TONES = (
    0,
    6,
    30,
    36,
    42,
    43,
)  # _propagate_lane counts on these
# Then for each tone the same against cosine and sine times amplitude, and the cosine and sine of
# its turn.
TONE_SECOND, TONE_ROWS, TONE_CHANGE, TONE_GAINS, TONE_TURN, TONE_SIZE = 0, 2, 10, 12, 14, 16

MOST_INTERVALS = 1 << 20
"""Intervals tried in one control step before giving up: some 0.1 s of work."""

_FEW = 8  # fewer lanes than this are advanced one by one

# Rows of the scratch array; those of the tones follow, and then the four rows of the next state.
_X1, _X2, _V1, _V2, _U, _OFFSET, _W, _SIGN, _NOW, _BEND, _CHANGE, _LEAVES, _TONES = range(13)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step; force and stretch are held over it."""
    status = at.OK
    if last - first >= _FEW:
        return _propagate_block(model, lanes, first, last)
    for i in range(first, last):
        status = max(status, _propagate_lane(model, lanes, i))
    return status


@kernel
def _product(m, row, a, b, c, d, e, f):
    """Return a row of a rung times the inputs without tones."""
    return (
        m[row] * a
        + m[row + 1] * b
        + m[row + 2] * c
        + m[row + 3] * d
        + m[row + 4] * e
        + m[row + 5] * f
    )


@kernel
def _stays(vr, sign, w, next_w, bend):
    """Tell whether w stays in its regime all the way.

    It does if the chord leaves room for the bend, 4 times the largest sag.
    """
    chord = w + next_w
    room = 2.0 * vr - abs(chord) if sign == 0.0 else sign * chord - 2.0 * vr
    return (room >= bend) & (abs(next_w) <= vr if sign == 0.0 else sign * next_w >= vr)


@kernel
def _propagate_lane(model, lanes, i):
    """Advance one lane: in one piece if its regime provably lasts, else interval by interval."""
    vr = model[VR]
    x1, x2, v1, v2 = lanes[at.X1, i], lanes[at.X2, i], lanes[at.V1, i], lanes[at.V2, i]
    u, offset, w = lanes[at.FORCE, i], x2 - x1, v2 - v1
    s = sign_of(vr, w)
    first = int(model[STICK]) if s == 0.0 else int(model[SLIP])
    m = model[first : first + TONES]
    second = m[0] * x1 + m[1] * offset + m[2] * v1 + m[3] * w + m[4] * s + m[5] * u
    y1 = m[6] * x1 + m[7] * x2 + m[8] * v1 + m[9] * v2 + m[10] * s + m[11] * u
    y2 = m[12] * x1 + m[13] * x2 + m[14] * v1 + m[15] * v2 + m[16] * s + m[17] * u
    y3 = m[18] * x1 + m[19] * x2 + m[20] * v1 + m[21] * v2 + m[22] * s + m[23] * u
    y4 = m[24] * x1 + m[25] * x2 + m[26] * v1 + m[27] * v2 + m[28] * s + m[29] * u
    change = m[30] * x1 + m[31] * offset + m[32] * v1 + m[33] * w + m[34] * s + m[35] * u
    bend = (
        m[36] * abs(x1)
        + m[37] * abs(offset)
        + m[38] * abs(v1)
        + m[39] * abs(w)
        + m[40] * abs(s)
        + m[41] * abs(u)
    )
    for j in range(int(model[at.TONE_COUNT])):
        tone, own = at.TONES + at.TONE_ROWS * j, first + TONES + TONE_SIZE * j
        t = model[own : own + TONE_SIZE]
        cosine = lanes[tone + at.AMPLITUDE, i] * lanes[tone + at.COSINE, i]
        sine = lanes[tone + at.AMPLITUDE, i] * lanes[tone + at.SINE, i]
        second += t[TONE_SECOND] * cosine + t[TONE_SECOND + 1] * sine
        y1 += t[TONE_ROWS] * cosine + t[TONE_ROWS + 1] * sine
        y2 += t[TONE_ROWS + 2] * cosine + t[TONE_ROWS + 3] * sine
        y3 += t[TONE_ROWS + 4] * cosine + t[TONE_ROWS + 5] * sine
        y4 += t[TONE_ROWS + 6] * cosine + t[TONE_ROWS + 7] * sine
        change += t[TONE_CHANGE] * cosine + t[TONE_CHANGE + 1] * sine
        bend += t[TONE_GAINS] * abs(cosine) + t[TONE_GAINS + 1] * abs(sine)
    if not _stays(vr, s, w, w + change, bend + m[GAIN_OF_SECOND] * abs(second)):
        return _propagate_by_intervals(model, lanes, i)
    lanes[at.X1, i], lanes[at.X2, i], lanes[at.V1, i], lanes[at.V2, i] = y1, y2, y3, y4
    return at.OK


@kernel
def _propagate_by_intervals(model, lanes, i):
    """Walk through the control step on the ladder; on the series where the regime may change."""
    last_rung, size, degree = int(model[LAST_RUNG]), int(model[RUNG_SIZE]), int(model[DEGREE])
    z, vr = _inputs(model, lanes, i), model[VR]
    unit = model[at.TIME_STEP] / (1 << last_rung)
    position, end, rung = 0, 1 << last_rung, 0  # in units of the last rung's time
    for _ in range(MOST_INTERVALS):
        first = (int(model[STICK]) if z[5] == 0.0 else int(model[SLIP])) + rung * size
        m = model[first : first + size]
        next_w = z[4] + _slip_row(m, CHANGE, TONE_CHANGE, z)
        bend = _slip_gain(m, z) + m[GAIN_OF_SECOND] * abs(_slip_row(m, SECOND, TONE_SECOND, z))
        if _stays(vr, z[5], z[4], next_w, bend):
            _take_interval(m, z)
            z[4] = next_w
        elif rung < last_rung:
            rung += 1
            continue
        else:
            status, z[5] = walk(
                coefficients(lanes, i), model, lanes, i, z, z[5], position * unit, unit, degree
            )
            if status != at.OK:
                return status
            _turn_tones(m, z)
        position += 1 << (last_rung - rung)
        while (
            rung > 0 and position & ((2 << (last_rung - rung)) - 1) == 0
        ):  # as long as the place allows
            rung -= 1
        if position == end:
            for row in range(4):
                lanes[row, i] = z[row]
            return at.OK
    return at.TOO_MANY_EVENTS


@kernel
def _inputs(model, lanes, i):
    """Return the inputs of one lane.

    x1, x2, v1, v2, w, sign of slip, u, and each tone's cosine and sine times amplitude.
    """
    tones = int(model[at.TONE_COUNT])
    z = np.empty(7 + 2 * tones)
    for row in range(4):
        z[row] = lanes[row, i]
    z[4] = z[3] - z[2]
    z[5], z[6] = sign_of(model[VR], z[4]), lanes[at.FORCE, i]
    for j in range(tones):
        tone = at.TONES + at.TONE_ROWS * j
        z[7 + 2 * j] = lanes[tone + at.AMPLITUDE, i] * lanes[tone + at.COSINE, i]
        z[8 + 2 * j] = lanes[tone + at.AMPLITUDE, i] * lanes[tone + at.SINE, i]
    return z


@kernel
def _slip_row(m, row, tone_row, z):
    """Return a row of a rung times the inputs with offset and slip velocity."""
    total = _product(m, row, z[0], z[1] - z[0], z[2], z[4], z[5], z[6])
    for j in range((z.size - 7) // 2):
        own = TONES + TONE_SIZE * j + tone_row
        total += m[own] * z[7 + 2 * j] + m[own + 1] * z[8 + 2 * j]
    return total


@kernel
def _slip_gain(m, z):
    """Return a rung's gains times the magnitudes of the inputs with offset and slip velocity."""
    total = _product(
        m, GAINS, abs(z[0]), abs(z[1] - z[0]), abs(z[2]), abs(z[4]), abs(z[5]), abs(z[6])
    )
    for j in range((z.size - 7) // 2):
        own = TONES + TONE_SIZE * j + TONE_GAINS
        total += m[own] * abs(z[7 + 2 * j]) + m[own + 1] * abs(z[8 + 2 * j])
    return total


@kernel
def _take_interval(m, z):
    """Advance the inputs but w by a rung."""
    x1, x2, v1, v2, s, u = z[0], z[1], z[2], z[3], z[5], z[6]
    for row in range(4):
        z[row] = _product(m, ROWS + 6 * row, x1, x2, v1, v2, s, u)
    for j in range((z.size - 7) // 2):
        own, cosine, sine = TONES + TONE_SIZE * j + TONE_ROWS, z[7 + 2 * j], z[8 + 2 * j]
        for row in range(4):
            z[row] += m[own + 2 * row] * cosine + m[own + 2 * row + 1] * sine
    _turn_tones(m, z)


@kernel
def _turn_tones(m, z):
    """Advance the phases of the tones by a rung."""
    for j in range((z.size - 7) // 2):
        own, cosine, sine = TONES + TONE_SIZE * j + TONE_TURN, z[7 + 2 * j], z[8 + 2 * j]
        z[7 + 2 * j] = cosine * m[own] - sine * m[own + 1]
        z[8 + 2 * j] = sine * m[own] + cosine * m[own + 1]


@kernel
def _propagate_block(model, lanes, first, last):
    """Advance many lanes side by side, then one by one those whose regime may change."""
    count, tones, vr = last - first, int(model[at.TONE_COUNT]), model[VR]
    scratch = np.empty((_TONES + 2 * tones + 4, count))
    _load(model, lanes, scratch, first, last)
    stick = model[int(model[STICK]) : int(model[STICK]) + int(model[RUNG_SIZE])]
    slip = model[int(model[SLIP]) : int(model[SLIP]) + int(model[RUNG_SIZE])]
    x2, v2, offset, w = scratch[_X2], scratch[_V2], scratch[_OFFSET], scratch[_W]
    for row in range(4):
        reached = scratch[_TONES + 2 * tones + row]
        _multiply(stick[ROWS + 6 * row :], slip[ROWS + 6 * row :], scratch, x2, v2, reached)
        _add_tones(stick, slip, scratch, TONE_ROWS + 2 * row, reached)
    now, change, bend = scratch[_NOW], scratch[_CHANGE], scratch[_BEND]
    _multiply(stick[SECOND:], slip[SECOND:], scratch, offset, w, now)
    _add_tones(stick, slip, scratch, TONE_SECOND, now)
    _multiply(stick[CHANGE:], slip[CHANGE:], scratch, offset, w, change)
    _add_tones(stick, slip, scratch, TONE_CHANGE, change)
    _multiply_magnitudes(stick[GAINS:], slip[GAINS:], scratch, bend)
    _add_tone_gains(stick, slip, scratch, bend)
    _mark(vr, stick[GAIN_OF_SECOND], slip[GAIN_OF_SECOND], scratch)
    leaves = scratch[_LEAVES]
    for row in range(4):
        reached, following = lanes[row, first:last], scratch[_TONES + 2 * tones + row]
        for i in range(count):
            reached[i] = following[i] if leaves[i] == 0.0 else reached[i]
    status = at.OK
    for i in range(count):
        if leaves[i] > 0.0:
            status = max(status, _propagate_by_intervals(model, lanes, first + i))
    return status


@kernel
def _load(model, lanes, scratch, first, last):
    """Copy the inputs and derive offset, slip velocity and regime."""
    count, vr = last - first, model[VR]
    for row in range(5):
        present, copy = lanes[row, first:last], scratch[row]
        for i in range(count):
            copy[i] = present[i]
    x1, x2, v1, v2 = scratch[_X1], scratch[_X2], scratch[_V1], scratch[_V2]
    offset, w, sign = scratch[_OFFSET], scratch[_W], scratch[_SIGN]
    for i in range(count):
        offset[i] = x2[i] - x1[i]
        w[i] = v2[i] - v1[i]
    for i in range(count):
        sign[i] = sign_of(vr, w[i])
    for j in range(int(model[at.TONE_COUNT])):
        tone = at.TONES + at.TONE_ROWS * j
        amplitude = lanes[tone + at.AMPLITUDE, first:last]
        cosine, sine = lanes[tone + at.COSINE, first:last], lanes[tone + at.SINE, first:last]
        by_cosine, by_sine = scratch[_TONES + 2 * j], scratch[_TONES + 2 * j + 1]
        for i in range(count):
            by_cosine[i], by_sine[i] = amplitude[i] * cosine[i], amplitude[i] * sine[i]


@kernel
def _multiply(stick, slip, scratch, second, fourth, out):
    """Write a row of each lane's regime times its inputs.

    `second` and `fourth` are the inputs that differ.
    """
    x1s, v1s, signs, us = scratch[_X1], scratch[_V1], scratch[_SIGN], scratch[_U]
    a0, a1, a2, a3, a4, a5 = stick[0], stick[1], stick[2], stick[3], stick[4], stick[5]
    b0, b1, b2, b3, b4, b5 = slip[0], slip[1], slip[2], slip[3], slip[4], slip[5]
    for i in range(out.size):
        x1, x2, v1, v2, s, u = x1s[i], second[i], v1s[i], fourth[i], signs[i], us[i]
        in_stick = a0 * x1 + a1 * x2 + a2 * v1 + a3 * v2 + a4 * s + a5 * u
        in_slip = b0 * x1 + b1 * x2 + b2 * v1 + b3 * v2 + b4 * s + b5 * u
        out[i] = in_stick if s == 0.0 else in_slip


@kernel
def _multiply_magnitudes(stick, slip, scratch, out):
    """Write the gains of each lane's regime times the magnitudes of its inputs."""
    x1s, offsets, v1s, ws = scratch[_X1], scratch[_OFFSET], scratch[_V1], scratch[_W]
    signs, us = scratch[_SIGN], scratch[_U]
    a0, a1, a2, a3, a4, a5 = stick[0], stick[1], stick[2], stick[3], stick[4], stick[5]
    b0, b1, b2, b3, b4, b5 = slip[0], slip[1], slip[2], slip[3], slip[4], slip[5]
    for i in range(out.size):
        x1, offset, v1, w, s, u = (
            abs(x1s[i]),
            abs(offsets[i]),
            abs(v1s[i]),
            abs(ws[i]),
            abs(signs[i]),
            abs(us[i]),
        )
        in_stick = a0 * x1 + a1 * offset + a2 * v1 + a3 * w + a4 * s + a5 * u
        in_slip = b0 * x1 + b1 * offset + b2 * v1 + b3 * w + b4 * s + b5 * u
        out[i] = in_stick if s == 0.0 else in_slip


@kernel
def _add_tones(stick, slip, scratch, slot, out):
    """Add what the tones contribute to a row."""
    signs = scratch[_SIGN]
    for j in range((scratch.shape[0] - _TONES - 4) // 2):
        cosines, sines, k = (
            scratch[_TONES + 2 * j],
            scratch[_TONES + 2 * j + 1],
            TONES + TONE_SIZE * j + slot,
        )
        a0, a1, b0, b1 = stick[k], stick[k + 1], slip[k], slip[k + 1]
        for i in range(out.size):
            in_stick, in_slip = a0 * cosines[i] + a1 * sines[i], b0 * cosines[i] + b1 * sines[i]
            out[i] += in_stick if signs[i] == 0.0 else in_slip


@kernel
def _add_tone_gains(stick, slip, scratch, out):
    """Add what the tones contribute to the gains."""
    signs = scratch[_SIGN]
    for j in range((scratch.shape[0] - _TONES - 4) // 2):
        cosines, sines, k = (
            scratch[_TONES + 2 * j],
            scratch[_TONES + 2 * j + 1],
            TONES + TONE_SIZE * j + TONE_GAINS,
        )
        a0, a1, b0, b1 = stick[k], stick[k + 1], slip[k], slip[k + 1]
        for i in range(out.size):
            cosine, sine = abs(cosines[i]), abs(sines[i])
            in_stick, in_slip = a0 * cosine + a1 * sine, b0 * cosine + b1 * sine
            out[i] += in_stick if signs[i] == 0.0 else in_slip


@kernel
def _mark(vr, stick_gain, slip_gain, scratch):
    """Mark the lanes that may leave their regime."""
    signs, ws, changes = scratch[_SIGN], scratch[_W], scratch[_CHANGE]
    bends, seconds, leaves = scratch[_BEND], scratch[_NOW], scratch[_LEAVES]
    for i in range(leaves.size):
        s, w = signs[i], ws[i]
        gain = stick_gain if s == 0.0 else slip_gain
        leaves[i] = (
            0.0 if _stays(vr, s, w, w + changes[i], bends[i] + gain * abs(seconds[i])) else 1.0
        )
