"""A fast reference beyond double precision: Taylor series in pairs of doubles.

A number is a pair (high, low) of doubles, some 32 digits (Dekker, 1971). The motion follows
docs/model.md, the excitation docs/excitation.md; only the compiler is the package's. Harmonics and
sweeps are oscillators whose series stand next to that of the motion; lines between samples, jumps
and the ends of sweeps divide a control step into pieces.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import intrinsic

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel

ORDER = 26
CUT_OFF = 1e-23
"""Size of the last terms of a series, relative to the largest velocity."""

SAMPLES = 64
"""Points of a series at which an exit from its regime is searched."""

MOST_SERIES = 2000
"""Series of a control step, at most: a stiff one is left out."""

OK, TOO_MANY, COLLAPSED, ESCAPED = range(4)

# Parameters of a lane; SIZE of them.
(M1, M2, K1, D, ALPHA, BETA, C, MU1, MU2, VR, CHI, FN, K0, L0, STRETCH, FORCE, REACTION, SIZE) = (
    range(18)
)
"""FORCE and REACTION [N] act on carriage and sphere; a STRETCH of 0 is that of plain springs K0."""

# Of an oscillator: its amplitude, whether it shakes the ground, its kind (0: of a constant
# frequency, 1: linear, 2: logarithmic), its last frequency [rad/s], and the piece from which it has
# that one.
AMPLITUDE, GROUND, KIND, LAST, UNTIL, FIELDS = range(6)

_V1, _V2, _X1, _X2, _SQUARE, _LONG, _SHORT, _BY_LONG, _BY_SHORT = range(9)
_LONG_SQUARE, _SHORT_SQUARE, _ROWS = range(9, 12)


@intrinsic
def _fused(_context, a, b, c):  # noqa: ARG001 - numba's own form
    """Return a b + c, rounded once."""

    def lowered(_context, builder, _signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), lowered


@inlined_kernel
def _quick(a, b):
    s = a + b
    return s, b - (s - a)


@inlined_kernel
def _add(x, y):
    s = x[0] + y[0]
    b = s - x[0]
    e = (x[0] - (s - b)) + (y[0] - b)
    t = x[1] + y[1]
    b = t - x[1]
    f = (x[1] - (t - b)) + (y[1] - b)
    s, e = _quick(s, e + t)
    return _quick(s, e + f)


@inlined_kernel
def _times(x, y):
    p = x[0] * y[0]
    e = _fused(x[0], y[0], -p)
    e += x[0] * y[1] + x[1] * y[0]
    return _quick(p, e)


@inlined_kernel
def _minus(x):
    return -x[0], -x[1]


@borrowing_kernel
def _over(x, y):
    q = x[0] / y[0]
    r = _add(x, _minus(_times(y, (q, 0.0))))
    q2 = r[0] / y[0]
    r = _add(r, _minus(_times(y, (q2, 0.0))))
    q3 = r[0] / y[0]
    return _add(_quick(q, q2), (q3, 0.0))


@inlined_kernel
def _get(c, row, n):
    return c[row, n, 0], c[row, n, 1]


@inlined_kernel
def _set(c, row, n, x):
    c[row, n, 0] = x[0]
    c[row, n, 1] = x[1]


@borrowing_kernel
def _product(c, a, b, n):
    total = 0.0, 0.0
    for j in range(n + 1):
        total = _add(total, _times(_get(c, a, j), _get(c, b, n - j)))
    return total


@borrowing_kernel
def _value(c, row, t):
    total = 0.0, 0.0
    for n in range(ORDER, -1, -1):
        total = _add(_times(total, t), _get(c, row, n))
    return total


@borrowing_kernel
def _expand(c, p, regime, now, oscillators, kinds):
    """Write the series of the motion, term n the derivative n over n!; False if collapsed.

    The rows of the state hold its values; `now` has the line of force and of ground acceleration.
    """
    m1, m2 = (p[M1], 0.0), (p[M2], 0.0)
    cubic = _times((p[K1], 0.0), (p[BETA], 0.0))
    linear = _times((p[K1], 0.0), (p[ALPHA], 0.0))
    finite = p[L0] > 0.0
    stretch = p[STRETCH], 0.0
    k2 = 0.0, 0.0
    if p[STRETCH] == 0.0:
        k2 = p[K0], 0.0
    elif p[K0] > 0.0 and not finite:
        k2 = _over((2.0, 0.0), _times(stretch, _times(stretch, stretch)))
        k2 = _times((2.0 * p[K0], 0.0), _add((1.0, 0.0), k2))
    slope, constant = (p[C], 0.0), (0.0, 0.0)
    if p[VR] > 0.0:
        normal = p[FN], 0.0
        if regime == 0.0:
            slope = _over(_times((p[MU1], 0.0), normal), (p[VR], 0.0))
        else:
            slope = p[CHI], 0.0
            constant = _times((p[MU2], 0.0), normal)
            constant = _add(constant, _minus(_times(slope, (p[VR], 0.0))))
            constant = _times((regime, 0.0), constant)
    count = len(kinds)
    for n in range(ORDER):
        part = _over((1.0, 0.0), (n + 1.0, 0.0))
        x1, x2 = _get(c, _X1, n), _get(c, _X2, n)
        v1, v2 = _get(c, _V1, n), _get(c, _V2, n)
        offset = _add(x2, _minus(x1))
        inner = _times(slope, _add(v2, _minus(v1)))
        if n == 0:
            inner = _add(inner, constant)
        if finite:
            shift = _over(offset, (p[L0], 0.0))
            _set(c, _LONG, n, _add(stretch if n == 0 else (0.0, 0.0), shift))
            _set(c, _SHORT, n, _add(stretch if n == 0 else (0.0, 0.0), _minus(shift)))
            if c[_LONG, 0, 0] <= 0.0 or c[_SHORT, 0, 0] <= 0.0:
                return False
            pull = _pull(c, _LONG, _LONG_SQUARE, _BY_LONG, n)
            pull = _add(pull, _minus(_pull(c, _SHORT, _SHORT_SQUARE, _BY_SHORT, n)))
            inner = _add(inner, _times(_times((p[K0], 0.0), (p[L0], 0.0)), pull))
        else:
            inner = _add(inner, _times(k2, offset))
        outer = _add(_times(linear, x1), _times((p[D], 0.0), v1))
        if p[BETA] != 0.0:
            _set(c, _SQUARE, n, _product(c, _X1, _X1, n))
            outer = _add(outer, _times(cubic, _product(c, _SQUARE, _X1, n)))
        push, shake = (0.0, 0.0), (0.0, 0.0)
        if n == 0:
            push = p[FORCE], 0.0
        if n < 2:
            push = _add(push, (now[n, 0], now[n, 1]))
            shake = now[2 + n, 0], now[2 + n, 1]
        for j in range(count):
            row = _ROWS + 3 * j
            drive = _times((oscillators[j, AMPLITUDE], 0.0), _get(c, row, n))
            if oscillators[j, GROUND] > 0.0:
                shake = _add(shake, drive)
            else:
                push = _add(push, drive)
            if kinds[j] == 0:
                turn = _get(c, row + 2, 0)
                up, down = _times(turn, _get(c, row + 1, n)), _times(turn, _get(c, row, n))
            else:
                up, down = _product(c, row + 2, row + 1, n), _product(c, row + 2, row, n)
            _set(c, row, n + 1, _times(part, up))
            _set(c, row + 1, n + 1, _times(part, _minus(down)))
            growth = now[4 + j, 0], now[4 + j, 1]
            following = 0.0, 0.0
            if kinds[j] == 1 and n == 0:
                following = growth
            elif kinds[j] == 2:
                following = _times(part, _times(growth, _get(c, row + 2, n)))
            _set(c, row + 2, n + 1, following)
        a1 = _over(_add(_add(inner, push), _minus(outer)), m1)
        if n == 0:
            inner = _add(inner, (-p[REACTION], 0.0))
        a2 = _over(_minus(inner), m2)
        _set(c, _V1, n + 1, _times(part, _add(a1, _minus(shake))))
        _set(c, _V2, n + 1, _times(part, _add(a2, _minus(shake))))
        _set(c, _X1, n + 1, _times(part, v1))
        _set(c, _X2, n + 1, _times(part, v2))
    return True


@borrowing_kernel
def _pull(c, row, square, inverse, n):
    """Return term n of l - l**-2 of a side, from l**2 l**-2 = 1."""
    _set(c, square, n, _product(c, row, row, n))
    known = (1.0, 0.0) if n == 0 else (0.0, 0.0)
    for j in range(1, n + 1):
        known = _add(known, _minus(_times(_get(c, square, j), _get(c, inverse, n - j))))
    _set(c, inverse, n, _over(known, _get(c, square, 0)))
    return _add(_get(c, row, n), _minus(_get(c, inverse, n)))


@borrowing_kernel
def _length(c, longest):
    """Return the time within which the last four terms of the velocities are below the cut-off."""
    largest = 0.0
    for n in range(4):
        for row in (_V1, _V2):
            largest = max(largest, abs(c[row, n, 0]) * (1e-3 * longest) ** n)
    shortest = longest
    for row in (_V1, _V2):
        for n in range(ORDER - 3, ORDER + 1):
            term = abs(c[row, n, 0])
            if term > 0.0 and largest > 0.0:
                shortest = min(shortest, (CUT_OFF * largest / term) ** (1.0 / n))
    return shortest


@inlined_kernel
def _slip(c, t):
    return _add(_value(c, _V2, t), _minus(_value(c, _V1, t)))


@borrowing_kernel
def _coarse_slip(c, t):
    total = 0.0
    for n in range(ORDER, -1, -1):
        total = total * t + (c[_V2, n, 0] - c[_V1, n, 0])
    return total


@inlined_kernel
def _room(regime, vr, w):
    """Return how far the slip velocity is from the end of its regime."""
    return vr - abs(w) if regime == 0.0 else regime * w - vr


@borrowing_kernel
def _exit(c, regime, vr, length):
    """Return the first exit from the regime, as a number; negative if there is none."""
    for k in range(1, SAMPLES + 1):
        high = length * k / SAMPLES
        if _room(regime, vr, _coarse_slip(c, high)) < 0.0:
            low = length * (k - 1) / SAMPLES
            for _ in range(60):
                middle = 0.5 * (low + high)
                if _room(regime, vr, _coarse_slip(c, middle)) < 0.0:
                    high = middle
                else:
                    low = middle
            return high
    return -1.0


@borrowing_kernel
def _polished(c, sign, vr, t):
    """Return the time near t at which the slip velocity is sign vr (Newton)."""
    for _ in range(4):
        gap = _add(_slip(c, t), (-sign * vr, 0.0))
        slope = 0.0
        for n in range(ORDER, 0, -1):
            slope = slope * t[0] + n * (c[_V2, n, 0] - c[_V1, n, 0])
        if slope == 0.0:
            return t
        t = _add(t, (-gap[0] / slope, 0.0))
    return t


@inlined_kernel
def _regime_of(vr, w):
    if vr == 0.0 or abs(w) <= vr:
        return 0.0
    return 1.0 if w > 0.0 else -1.0


@kernel
def advance(p, lengths, lines, jumps, oscillators, phases, state, largest, rounded):
    """Advance a lane by a control step.

    Parameters
    ----------
    p
        (SIZE,) parameters, in SI units.
    lengths
        (pieces, 2) the length of each piece [s], a pair.
    lines
        (pieces, 4, 2) force [N] at its start and end, ground acceleration [m/s^2] likewise; pairs.
    jumps
        (pieces, 2) what is added to v1 and v2 at its start [m/s].
    oscillators
        (n, FIELDS), see above.
    phases
        (n, 4, 2) pairs: sine, cosine, frequency [rad/s] at the start, and the rate of its growth,
        [rad/s^2] if linear, [1/s] if logarithmic.
    state
        (4,) x1, x2 [m], v1, v2 [m/s]; written: those at the end.
    largest
        (4,) written: their largest magnitudes on the way.
    rounded
        Whether the state is rounded to doubles after each series.

    Returns
    -------
    int
        OK, or why not.
    """
    count = oscillators.shape[0]
    c = np.zeros((_ROWS + 3 * count, ORDER + 1, 2))
    now, kinds = np.zeros((4 + count, 2)), np.zeros(count, np.int64)
    rows = (_X1, _X2, _V1, _V2)
    for k in range(4):
        _set(c, rows[k], 0, (state[k], 0.0))
        largest[k] = abs(state[k])
    for j in range(count):
        for k in range(3):
            _set(c, _ROWS + 3 * j + k, 0, (phases[j, k, 0], phases[j, k, 1]))
        now[4 + j] = phases[j, 3]
        kinds[j] = int(oscillators[j, KIND])
    regime, vr, used = _regime_of(p[VR], state[3] - state[2]), p[VR], 0
    for piece in range(lengths.shape[0]):
        if jumps[piece, 0] != 0.0 or jumps[piece, 1] != 0.0:
            _set(c, _V1, 0, _add(_get(c, _V1, 0), (jumps[piece, 0], 0.0)))
            _set(c, _V2, 0, _add(_get(c, _V2, 0), (jumps[piece, 1], 0.0)))
            w = _add(_get(c, _V2, 0), _minus(_get(c, _V1, 0)))
            regime = _regime_of(vr, w[0])
            for k in range(2, 4):
                largest[k] = max(largest[k], abs(c[rows[k], 0, 0]))
        for j in range(count):
            if kinds[j] > 0 and piece >= oscillators[j, UNTIL]:
                kinds[j] = 0
                _set(c, _ROWS + 3 * j + 2, 0, (oscillators[j, LAST], 0.0))
        left = lengths[piece, 0], lengths[piece, 1]
        for target in range(2):
            start = lines[piece, 2 * target, 0], lines[piece, 2 * target, 1]
            end = lines[piece, 2 * target + 1, 0], lines[piece, 2 * target + 1, 1]
            slope = _over(_add(end, _minus(start)), left)
            now[2 * target, 0], now[2 * target, 1] = start
            now[2 * target + 1, 0], now[2 * target + 1, 1] = slope
        while left[0] > 0.0:
            used += 1
            if used > MOST_SERIES:
                return TOO_MANY
            if not _expand(c, p, regime, now, oscillators, kinds):
                return COLLAPSED
            most = _length(c, left[0])
            step = left if most >= left[0] else (most, 0.0)
            leaves = -1.0
            if vr > 0.0:
                leaves = _exit(c, regime, vr, step[0])
            following = regime
            if leaves >= 0.0:
                w = _coarse_slip(c, leaves)
                sign = 1.0 if w > 0.0 else -1.0
                step = _polished(c, sign, vr, (leaves, 0.0))
                if step[0] < 0.0:
                    step = 0.0, 0.0
                following = sign if regime == 0.0 else 0.0
            for k in range(1, 9):
                t = _times(step, (k / 8.0, 0.0))
                for m in range(4):
                    reached = _value(c, rows[m], t)
                    largest[m] = max(largest[m], abs(reached[0]))
                    if k == 8:
                        _set(c, _SQUARE, m, reached)
            for m in range(4):
                end = _get(c, _SQUARE, m)
                _set(c, rows[m], 0, (end[0], 0.0 if rounded else end[1]))
            for row in range(_ROWS, _ROWS + 3 * count):
                _set(c, row, 0, _value(c, row, step))
            if not largest.max() < 1e100:
                return ESCAPED
            for n in range(2):
                slope = now[2 * n + 1, 0], now[2 * n + 1, 1]
                value = _add((now[2 * n, 0], now[2 * n, 1]), _times(slope, step))
                now[2 * n, 0], now[2 * n, 1] = value
            left, regime = _add(left, _minus(step)), following
    for k in range(4):
        state[k] = c[rows[k], 0, 0]
    return OK
