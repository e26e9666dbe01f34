"""Exact transition matrices of linear plants (Van Loan, IEEE Trans. Automat. Control 23, 1978).

The carriage may have no mass.
"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.state_space.equations import Values, state_space
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS, halved_exponentials


class Exosystem(NamedTuple):
    """An excitation p = output . z with z' = matrix z, as arrays of `Decimal`."""

    matrix: NDArray[np.object_]
    output: NDArray[np.object_]


def harmonic(frequency: float) -> Exosystem:
    """Return the exosystem of sin(w t + phase): z = (cos, sin)."""
    w, zero = Decimal(frequency), Decimal(0)
    return Exosystem(np.array([[zero, -w], [w, zero]]), np.array([zero, Decimal(1)]))


def jet(terms: int, time: float) -> Exosystem:
    """Return the exosystem of a polynomial in t / time: z its coefficients about the present."""
    matrix = np.full((terms, terms), Decimal(0))
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        for n in range(terms - 1):
            matrix[n, n + 1] = Decimal(n + 1) / Decimal(time)
    return Exosystem(matrix, np.array([Decimal(n == 0) for n in range(terms)], object))


NONE = jet(0, 1.0)
"""No exosystem."""


def transition(p: Values, time: float, *, is_between: bool = False) -> Array:
    """Return [exp(A t) | response to a held unit control force], (4, 5)."""
    return _halved(p, NONE, time, is_between=is_between)[0].astype(np.float64)


def halved_transitions(p: Values, time: float, levels: int) -> Array:
    """Return exp(A t / 2**k) for k = 1 .. levels, (levels, 4, 4)."""
    halves = _halved(p, NONE, time, levels)[1:]
    return np.array([half[:, :4].astype(np.float64) for half in halves])


def response(p: Values, source: Exosystem, *, ground: bool, time: float) -> Array:
    """Return what each state of an exosystem at the step's start adds to the state at its end.

    (n, 4), for a force on the carriage or an acceleration of the ground.
    """
    return _halved(p, source, time, ground=ground)[0][:, 5:].T.astype(np.float64)


def _halved(
    p: Values,
    source: Exosystem,
    time: float,
    levels: int = 0,
    *,
    ground: bool = False,
    is_between: bool = False,
) -> list[NDArray[np.object_]]:
    """Return x1, x2, v1, v2 after time / 2**k, k = 0 .. levels, against what there is at the start.

    That is (x1, x2, v1, v2, held force, exosystem's states).
    """
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        if p["m1"] == 0:
            generator, v1 = _without_mass(p, source, ground=ground, is_between=is_between)
            halves = halved_exponentials(generator, time, levels)
            rows = [np.array([half[0], half[1], v1 @ half, half[2]]) for half in halves]
            return [np.insert(row, 2, np.asarray(Decimal(0)), axis=1) for row in rows]
        system, size = state_space(p), 5 + len(source.output)
        generator = np.full((size, size), Decimal(0))
        generator[:4, :4], generator[:4, 4] = system.a, system.control(is_between=is_between)
        generator[:4, 5:] = np.outer(system.ground if ground else system.force, source.output)
        generator[5:, 5:] = source.matrix
        return [half[:4] for half in halved_exponentials(generator, time, levels)]


def _without_mass(
    p: Values, source: Exosystem, *, ground: bool, is_between: bool
) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
    """Return the generator of x1, x2, v2, held force and the exosystem's states, and v1 from these.

    Without inertia the forces on the carriage balance: (c + d) v1 = c v2 - (k1 + k2) x1 + k2 x2 +
    u + p(t). So v1 at the start has no influence.
    """
    m2, k1, c, d, k2 = (p[name] for name in ("m2", "k1", "c", "d", "k2"))
    zero, size = Decimal(0), 4 + len(source.output)
    push, shake = (zero * source.output, source.output)[:: 1 if ground else -1]
    v1 = np.concatenate([np.array([-(k1 + k2), k2, c, Decimal(1)]), push]) / (c + d)
    generator = np.full((size, size), zero)
    generator[0], generator[1, 2] = v1, Decimal(1)
    generator[2] = c * v1 / m2
    generator[2, :3] += np.array([k2, -k2, -c]) / m2
    if is_between:
        generator[2, 3] -= 1 / m2
    generator[2, 4:] -= shake
    generator[4:, 4:] = source.matrix
    return generator, v1
