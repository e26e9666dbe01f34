"""Elementary functions that are rounded alike in a lone lane and in a vector of them.

In a loop over lanes a compiler may take a library's functions from Intel's vector library, if that
is installed, but not for the lanes that fill no vector: these would be rounded differently.
Polynomials without branches or calls are vectorised as they are.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.arithmetic import fma, stay_apart
from mm_gym.lanes.simd import alike

if TYPE_CHECKING:
    from collections.abc import Callable

_MANTISSA = 52
"""Bits of a double behind its exponent."""

_HALF_ROOT = 0x3FE6A09E667F3BCD
"""Bits of the square root of 1/2."""

_ONE = 0x3FF
"""Exponent of 1, as a double has it."""

_LN2_HIGH, _LN2_LOW = float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33")
"""ln 2 in two parts; a whole number of up to 21 bits times the first is exact."""

_ROUNDING = 1.5 * 2.0**_MANTISSA
"""Added to a number it leaves the nearest integer in the last bits."""

_SMALLEST = -708.0
"""Least argument of `exponential`: below, results would have fewer digits."""

# Taylor's series, each up to the last term that counts, for |s| <= 3 - sqrt(8), |x| <= pi / 4 and
# |x| <= ln(2) / 2.
_ATANH = tuple(2.0 / (2 * k + 1) for k in range(11))
_SINE = tuple(
    (0.5 * math.pi) ** (2 * k + 1) * (-1) ** k / math.factorial(2 * k + 1) for k in range(9)
)
_COSINE = tuple((0.5 * math.pi) ** (2 * k) * (-1) ** k / math.factorial(2 * k) for k in range(9))
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))


@intrinsic
def _reread(_context, x):
    """Return the bits of a double as an integer, or the double of an integer's bits."""
    types_of = {True: (types.int64, types.float64), False: (types.float64, types.int64)}
    result, argument = types_of[isinstance(x, types.Float)]
    kind = ir.IntType(64) if result is types.int64 else ir.DoubleType()

    def build(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], kind)

    return result(argument), build


def bits_of(x: float) -> int:
    """Return the bits of a double as an integer."""
    return np.float64(x).view(np.int64)


def double_of(x: int) -> float:
    """Return the double of these bits."""
    return np.int64(x).view(np.float64)


@overload(bits_of)
@overload(double_of)
def _compiled(x) -> Callable[..., float]:  # noqa: ARG001 - as the functions
    return lambda x: _reread(x)  # noqa: PLW0108 - numba wants a plain function


@borrowing_kernel
def cosine_and_sine(x):
    """Return cosine and sine of any angle, by the library's functions for a single number."""
    stay_apart()
    return math.cos(x), math.sin(x)


@inlined_kernel
def _value(coefficients, x):
    """Return the value of a polynomial, its lowest coefficient first.

    Even and odd powers are summed apart (Horner), so that one sum hides the other's latency.
    """
    square, count = x * x, len(coefficients)
    total, other = alike(x, coefficients[count - 1]), alike(x, coefficients[count - 2])
    for k in range(count - 3, -1, -2):
        total = fma(total, square, coefficients[k])
        if k > 0:
            other = fma(other, square, coefficients[k - 1])
    return fma(total, x, other) if count % 2 == 0 else fma(other, x, total)


@inlined_kernel
def logarithm(x):
    """Return ln x of a normal number x > 0, from x = m 2^e and 2 artanh((m - 1) / (m + 1))."""
    bits = bits_of(x)
    exponent = (bits - _HALF_ROOT) >> _MANTISSA
    m = double_of(bits - (exponent << _MANTISSA))  # from sqrt(1/2) to sqrt(2)
    s, e = (m - 1.0) / (m + 1.0), float(exponent)
    return fma(e, _LN2_HIGH, fma(s, _value(_ATANH, s * s), e * _LN2_LOW))


@inlined_kernel
def on_circle(x):
    """Return cosine and sine of x pi / 2, for |x| <= 1/2."""
    square = x * x
    return _value(_COSINE, square), x * _value(_SINE, square)


@inlined_kernel
def exponential(x):
    """Return exp(x) for x <= 0; no less than exp(-708)."""
    x = max(x, _SMALLEST)
    rounded = fma(x, 1.0 / math.log(2.0), _ROUNDING)
    n = rounded - _ROUNDING
    value = _value(_EXPONENTIAL, fma(-n, _LN2_LOW, fma(-n, _LN2_HIGH, x)))
    return value * double_of((bits_of(rounded) + _ONE) << _MANTISSA)
