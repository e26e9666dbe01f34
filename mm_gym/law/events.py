"""Changes of the friction's regime: which one a slip velocity is in, and when it leaves it.

A regime is the direction of slip, 1 or -1, or 0 for stick. How far the slip velocity w is from its
boundaries are two gaps: that below v_r, and that above -v_r.
"""

from __future__ import annotations

from mm_gym.compiler.jit import kernel
from mm_gym.lanes.arithmetic import fma

NONE = 2.0
"""What `first_exit` returns where there is no exit."""


_MOST_TRIALS = 10_000


_SHORTEST = 2.0**-52


@kernel
def sign_of(vr, w):
    """Return the direction of slip, or 0 for stick."""
    return (1.0 if w > vr else 0.0) - (1.0 if w < -vr else 0.0)


@kernel
def gaps_of(vr, w):
    """Return how far w is below v_r and above -v_r [m/s]."""
    return vr - w, vr + w


@kernel
def gaps_on(vr, direction):
    """Return the same exactly on the boundary of a direction, where w = direction v_r."""
    return (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)


@kernel
def regime_exit(c, row, degree, regime, upper, lower):
    """Return when a slip velocity, given as a series, first leaves its regime, and where.

    Parameters
    ----------
    c, row, degree
        (n,) read: terms c[row + 1] to c[row + degree] are the change of w [m/s] in powers of t.
    regime
        That at t = 0.
    upper, lower
        Gaps [m/s] at t = 0.

    Returns
    -------
    tuple
        t in (0, 1] and the boundary's direction, 1 or -1; NONE and 0 if the regime lasts.
    """
    if regime != 0.0:
        gap = -upper if regime > 0.0 else -lower
        t, direction = first_exit(c, row, degree, gap, regime), regime
    else:
        up = first_exit(c, row, degree, upper, -1.0)
        down = first_exit(c, row, degree, lower, 1.0)
        t, direction = (up, 1.0) if up <= down else (down, -1.0)
    return (NONE, 0.0) if t == NONE else (t, direction)


@kernel
def regime_exit_within(c, row, scaled, degree, theta, regime, upper, lower):
    """Return the same for the part of a series up to theta; t is then a fraction of that part.

    Parameters
    ----------
    c, row, degree, regime, upper, lower
        As for `regime_exit`.
    scaled
        Row of c that is written: the series in powers of t / theta.
    theta
        Time in units of the series.
    """
    power = 1.0
    for n in range(1, degree + 1):
        power *= theta
        c[scaled + n] = c[row + n] * power
    return regime_exit(c, scaled, degree, regime, upper, lower)


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
    """Return the polynomial of `first_exit` and its derivative at t.

    Parameters
    ----------
    c, row, degree, gap, sign
        As for `first_exit`; read.
    t
        Time in units of the series.
    """
    value = slope = 0.0
    for n in range(degree, 0, -1):
        slope = fma(slope, t, value)
        value = fma(value, t, c[row + n])
    return fma(sign * value, t, gap), sign * fma(slope, t, value)


@kernel
def _root(c, row, degree, gap, sign, low, high, t):
    """Return the root of a falling polynomial by Newton's method, bracketed.

    Parameters
    ----------
    c, row, degree, gap, sign
        As for `first_exit`; read.
    low, high
        Times in units of the series: the polynomial is at least 0 at low and negative at high.
    t
        Time to begin from.
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
