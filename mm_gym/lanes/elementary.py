"""Elementary functions that are rounded alike in a lone lane and in a vector of them.

In a loop over lanes a compiler may take a library's functions from Intel's vector library, if that
is installed, but not for the lanes that fill no vector: these would be rounded differently.
Polynomials without branches or calls are vectorised as they are.
"""

# ruff: noqa: PLW0108 - as in `lanes.simd`

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba import types

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, plain
from mm_gym.compiler.llvm_code import compiled_as, defines
from mm_gym.lanes.arithmetic import fma, stay_apart
from mm_gym.lanes.simd import VECTOR, alike, recast
from mm_gym.lanes.simd_masks import where

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


@compiled_as(types.int64, lambda _context, builder, _kinds, x: builder.bitcast(x, ir.IntType(64)))
def bits_of(x: float) -> int:
    """Return the bits of a double as an integer."""
    return np.asarray(x, np.float64).view(np.int64)[()]


@compiled_as(
    types.float64, lambda _context, builder, _kinds, x: builder.bitcast(x, ir.DoubleType())
)
def double_of(x: int) -> float:
    """Return the double of these bits."""
    return np.asarray(x, np.int64).view(np.float64)[()]


def _integers(kind, value):
    """Return an integer in every lane, or one."""
    count = getattr(kind, "count", None)
    return ir.Constant(kind, value if count is None else [value] * count)


def _split(builder, x, whole):
    """Return the bits of a number, and the exponent of its part that is a power of two."""
    bits = builder.bitcast(x, whole)
    above = builder.sub(bits, _integers(whole, _HALF_ROOT))
    return bits, builder.ashr(above, _integers(whole, _MANTISSA))


def _mantissa(builder, x, whole, number):
    bits, exponent = _split(builder, x, whole)
    shifted = builder.shl(exponent, _integers(whole, _MANTISSA))
    return builder.bitcast(builder.sub(bits, shifted), number)


def _power_of_two(builder, x, whole, number):
    biased = builder.add(builder.bitcast(x, whole), _integers(whole, _ONE))
    return builder.bitcast(builder.shl(biased, _integers(whole, _MANTISSA)), number)


@recast(lambda builder, x, whole, number: builder.sitofp(_split(builder, x, whole)[1], number))
def exponent_of(x: float) -> float:
    """Return e of x = m 2^e, with m from the root of 1/2 to that of 2."""
    return ((bits_of(x) - _HALF_ROOT) >> _MANTISSA) * 1.0


@recast(_mantissa)
def mantissa_of(x: float) -> float:
    """Return m of the same."""
    return double_of(bits_of(x) - (((bits_of(x) - _HALF_ROOT) >> _MANTISSA) << _MANTISSA))


@recast(_power_of_two)
def two_to_the(x: float) -> float:
    """Return 2^n of an integer n to which `_ROUNDING` was added."""
    return double_of((bits_of(x) + _ONE) << _MANTISSA)


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
    e = exponent_of(x)
    m = mantissa_of(x)  # from sqrt(1/2) to sqrt(2)
    s = (m - 1.0) / (m + 1.0)
    return fma(e, _LN2_HIGH, fma(s, _value(_ATANH, s * s), e * _LN2_LOW))


@inlined_kernel
def on_circle(x):
    """Return cosine and sine of x pi / 2, for |x| <= 1/2."""
    square = x * x
    return _value(_COSINE, square), x * _value(_SINE, square)


@inlined_kernel
def exponential(x):
    """Return exp(x) for x <= 0; no less than exp(-708)."""
    x = where(x > _SMALLEST, x, _SMALLEST)
    rounded = fma(x, 1.0 / math.log(2.0), _ROUNDING)
    n = rounded - _ROUNDING
    value = _value(_EXPONENTIAL, fma(-n, _LN2_LOW, fma(-n, _LN2_HIGH, x)))
    return value * two_to_the(rounded)


_SMALLEST_NORMAL = 2.0**-1022


def exp_of(x: float) -> float:
    """Return exp(x) of a number of any kind, for x <= 0; no less than exp(-708)."""
    return plain(exponential)(x)


def log_of(x: float) -> float:
    """Return ln x of a number of any kind, for x >= 0; no less than that of 2^-1022."""
    return plain(_logarithm_above)(x)


@inlined_kernel
def _logarithm_above(x):
    return logarithm(where(x > _SMALLEST_NORMAL, x, _SMALLEST_NORMAL))


def power(x: float, exponent: float) -> float:
    """Return x to the power of an exponent from 0 on, for 0 <= x <= 1; numbers of any kind."""
    return plain(_power)(x, exponent)


@inlined_kernel
def _power(x, exponent):
    return exponential(exponent * _logarithm_above(x))


def _are_plain(*kinds: types.Type) -> bool:
    return all(kind in (types.float64, VECTOR) for kind in kinds)


defines(exp_of, _are_plain)(lambda x: exponential(x))
defines(log_of, _are_plain)(lambda x: _logarithm_above(x))
defines(power, _are_plain)(lambda x, exponent: _power(x, exponent))
