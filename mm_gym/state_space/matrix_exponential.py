"""The matrix exponential, correctly rounded.

A propagator is computed once and used for millions of steps, so it is worth having every digit of
it. Double precision cannot give them: for a stiff plant the squarings of ``scipy.linalg.expm`` lose
as many digits as ``norm(A) dt`` has, and a carriage of 1e-80 kg overflows it. Decimal arithmetic of
the standard library has neither limit; a 4 by 4 exponential takes a few milliseconds.
"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array

GUARD_DIGITS = 30
"""Digits kept beyond those that the squarings can lose: 17 for a double, the rest for the sums."""

ASSEMBLY_DIGITS = 700
"""Digits of the matrices' entries: a row's small terms must not be lost next to its large ones,
since what they leave of the sum is what decays. More than three times LARGEST_EXPONENT, as the
exponential itself."""

LARGEST_EXPONENT = 200
"""Decimal digits of norm(A) t beyond which nothing physical is left: refuse rather than compute for
minutes."""


def exponential(matrix: NDArray[np.object_], time: float) -> Array:
    """Return exp(matrix * time), each entry rounded once to double precision.

    Parameters
    ----------
    matrix
        (n, n) array of `decimal.Decimal`, so that the entries need not be doubles.
    time
        Duration [s], finite.

    Returns
    -------
    ndarray
        (n, n) float64. Entries below the smallest double are zero.

    Raises
    ------
    OverflowError
        If norm(matrix) * time has more than 200 digits or an entry of the result exceeds the
        largest double.
    """
    return halved_exponentials(matrix, time, 0)[0].astype(np.float64)


def halved_exponentials(
    matrix: NDArray[np.object_], time: float, levels: int
) -> list[NDArray[np.object_]]:
    """Return exp(matrix * time / 2**k) for k = 0 .. levels, as decimals.

    They are correct far beyond double precision.

    Parameters
    ----------
    matrix, time
        As for `exponential`.
    levels
        Number of halvings wanted.

    Raises
    ------
    OverflowError
        If norm(matrix) * time has more than 200 digits.

    Notes
    -----
    Scaling and squaring of the Taylor series (Moler and Van Loan, 2003, method 3): the halvings are
    its intermediate results. A squaring at most doubles the relative error, which costs a third of
    a digit; the hump of a non-normal matrix is bounded by norm(A) t for a dissipative oscillator,
    and entries differ by as much where positions and velocities do: hence the digits beyond
    GUARD_DIGITS.
    """
    step = Decimal(time)
    size = len(matrix)
    norm = max((sum(abs(entry) for entry in row) for row in matrix), default=Decimal(0)) * abs(step)
    digits = max(norm.adjusted(), 0) if norm else 0
    if digits > LARGEST_EXPONENT:
        msg = f"norm(A) t is about 1e{digits}; at most 1e{LARGEST_EXPONENT} is supported"
        raise OverflowError(msg)
    with localcontext(Context(prec=GUARD_DIGITS + 3 * digits + levels // 3)) as context:
        squarings = 0
        while norm > Decimal("0.1"):
            norm /= 2
            squarings += 1
        squarings = max(squarings, levels)
        scaled = matrix * (step / 2**squarings)
        identity: NDArray[np.object_] = np.array(
            [[Decimal(i == j) for j in range(size)] for i in range(size)]
        )
        result, term, order = identity, identity, 0
        threshold = Decimal(10) ** (-context.prec)
        # Entry by entry, because units differ; an entry may appear first at the order of its chain,
        # at most the size.
        while order < size or np.any(abs(term) > threshold * abs(result)):
            order += 1
            term = term @ scaled / order
            result = result + term
        squares = [result]
        for _ in range(squarings):
            result = result @ result
            squares.append(result)
    return squares[::-1][: levels + 1]


def decimals(matrix: Array) -> NDArray[np.object_]:
    """Return the matrix with each double as the `decimal.Decimal` that it exactly is."""
    return np.array([[Decimal(float(entry)) for entry in row] for row in matrix], dtype=object)
