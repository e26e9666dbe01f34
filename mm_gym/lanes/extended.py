"""Numbers in twice a double's digits, as a pair of doubles (high, low), for phases of many radians.

Sums and products follow Knuth (1969) and Dekker (1971); their errors are some 1e-31 of the result.
"""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes.arithmetic import fma, stay_apart
from mm_gym.lanes.elementary import cosine_and_sine

_LN2 = math.log(2.0), 2.3190468138462996e-17
_HALVINGS = 6
_TERMS = 12
"""Terms of the exponential's series for |x| <= ln(2) / 2^7: what is left is 1e-36."""


@borrowing_kernel
def total(a, b):
    """Return a + b of two doubles."""
    high = a + b
    added = high - a
    return high, (a - (high - added)) + (b - added)


@borrowing_kernel
def plus(x, y):
    """Return x + y."""
    high, low = total(x[0], y[0])
    return total(high, low + (x[1] + y[1]))


@borrowing_kernel
def times(x, y):
    """Return x y."""
    high = x[0] * y[0]
    return total(high, fma(x[0], y[0], -high) + (x[0] * y[1] + x[1] * y[0]))


@borrowing_kernel
def over(x, y):
    """Return x / y."""
    first = x[0] / y[0]
    rest = plus(x, times((-first, 0.0), y))
    second = rest[0] / y[0]
    rest = plus(rest, times((-second, 0.0), y))
    high, low = total(first, second)
    return total(high, low + rest[0] / y[0])


@borrowing_kernel
def exponential_less_one(x):
    """Return exp(x) - 1, right to the last digits also where x is small."""
    n = float(math.floor(x[0] / _LN2[0] + 0.5))
    rest = plus(x, times((-n, 0.0), _LN2))
    shorter = rest[0] * 0.5**_HALVINGS, rest[1] * 0.5**_HALVINGS
    value = 0.0, 0.0
    for k in range(_TERMS, 0, -1):  # (1 + value) x / k
        value = over(times(shorter, plus((1.0, 0.0), value)), (float(k), 0.0))
    for _ in range(_HALVINGS):
        value = plus((2.0 * value[0], 2.0 * value[1]), times(value, value))
    scale = 2.0**n
    return plus((scale - 1.0, 0.0), (scale * value[0], scale * value[1]))


@borrowing_kernel
def logarithm_of_ratio(a, b):
    """Return ln(a / b) of two positive doubles."""
    stay_apart()  # or a vector library might take the logarithm's place
    ratio = over((a, 0.0), (b, 0.0))
    near = math.log(ratio[0])
    # Newton's step; what it leaves is the square of the double's error.
    grown = exponential_less_one((-near, 0.0))
    return plus((near, 0.0), plus(plus(ratio, (-1.0, 0.0)), times(ratio, grown)))


@borrowing_kernel
def on_circle(x):
    """Return cosine and sine of an angle [rad]."""
    (c, s), (small_c, small_s) = cosine_and_sine(x[0]), cosine_and_sine(x[1])
    return c * small_c - s * small_s, s * small_c + c * small_s
