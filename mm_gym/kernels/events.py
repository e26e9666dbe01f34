"""Changes of the friction's regime: which one a slip velocity is in, and when it leaves it."""

from __future__ import annotations

from mm_gym.kernels.arithmetic import fma
from mm_gym.kernels.jit import kernel

NONE = 2.0
"""What `first_exit` returns where there is no exit."""


_MOST_TRIALS = 10_000


_SHORTEST = 2.0**-52


@kernel
def sign_of(vr, w):
    """Return the direction of slip, or 0 for stick."""
    return (1.0 if w > vr else 0.0) - (1.0 if w < -vr else 0.0)


@kernel
def first_exit(c, row, degree, gap, sign):
    """Return the first t in (0, 1] at which a polynomial turns negative, or NONE.

    The polynomial is gap + sign (c1 t + c2 t**2 + ...), c from `row` on.

    Nothing is missed: an interval is passed only if the second derivative's bound leaves no room
    for an exit, and a root is taken as the first one only where the polynomial is monotone.
    """
    gap = max(gap, 0.0)  # what round-off left outside
    total = bend = 0.0
    for n in range(degree, 0, -1):
        total += c[row + n]
        bend += n * (n - 1.0) * abs(c[row + n])
    if gap + sign * total >= 0.0 and gap + gap + sign * total >= 0.5 * bend:
        return NONE
    start, width, value, slope = 0.0, 1.0, gap, sign * c[row + 1]
    for _ in range(_MOST_TRIALS):
        end = start + width
        next_value, next_slope = _value_and_slope(c, row, degree, gap, sign, end)
        rises = max(slope, next_slope) >= bend * width
        falls = min(slope, next_slope) <= -bend * width
        passed = next_value >= 0.0 and (
            rises or falls or value + next_value >= 0.5 * bend * width * width or width <= _SHORTEST
        )
        if passed:
            if end >= 1.0:
                return NONE
            start, value, slope = end, max(next_value, 0.0), next_slope
            while start % (2.0 * width) == 0.0:  # the next interval is as long as its place allows
                width *= 2.0
        elif falls:
            return _root(
                c, row, degree, gap, sign, start, end, start + width * value / (value - next_value)
            )
        elif width <= _SHORTEST:
            return end
        else:
            width *= 0.5
    return start


@kernel
def _value_and_slope(c, row, degree, gap, sign, t):
    value = slope = 0.0
    for n in range(degree, 0, -1):
        slope = fma(slope, t, value)
        value = fma(value, t, c[row + n])
    return fma(sign * value, t, gap), sign * fma(slope, t, value)


@kernel
def _root(c, row, degree, gap, sign, low, high, t):
    """Return the root of a falling polynomial, at least 0 at `low` and negative at `high`.

    By Newton's method from t, bracketed.
    """
    for _ in range(200):
        value, slope = _value_and_slope(c, row, degree, gap, sign, t)
        if value >= 0.0:
            low = t
        else:
            high = t
        following = t - value / slope if slope < 0.0 else high
        if abs(following - t) <= 2.0**-52 * t:
            return min(max(following, low), high)
        if not low < following < high:
            following = 0.5 * (low + high)
            if not low < following < high:
                return high
        t = following
    return t
