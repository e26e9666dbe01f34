"""Exact transition matrices of linear plants (Van Loan, IEEE Trans. Automat. Control 23, 1978)."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.state_space.equations import StateSpace, Values
from mm_gym.state_space.matrix_exponential import ASSEMBLY_DIGITS, exponential, halved_exponentials


def transition(system: StateSpace, time: float, *, is_between: bool = False) -> Array:
    """Return [exp(A t) | response to a held unit control force], (4, 5)."""
    generator = np.full((5, 5), Decimal(0))
    generator[:4, :4], generator[:4, 4] = system.a, system.control(is_between=is_between)
    return exponential(generator, time)[:4]


def halved_transitions(system: StateSpace, time: float, levels: int) -> Array:
    """Return exp(A t / 2**k) for k = 1 .. levels, (levels, 4, 4)."""
    halves = halved_exponentials(system.a, time, levels)[1:]
    return np.array([half.astype(np.float64) for half in halves])


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
    return Exosystem(matrix, np.array([Decimal(n == 0) for n in range(terms)]))


def response(system: StateSpace, source: Exosystem, *, ground: bool, time: float) -> Array:
    """Return what each state of an exosystem at the step's start adds to the state at its end.

    (n, 4), for a force on the carriage or an acceleration of the ground.
    """
    size = len(source.output)
    generator = np.full((4 + size, 4 + size), Decimal(0))
    generator[:4, :4], generator[4:, 4:] = system.a, source.matrix
    generator[:4, 4:] = np.outer(system.ground if ground else system.force, source.output)
    return exponential(generator, time)[:4, 4:].T


def massless_transition(p: Values, time: float, *, is_between: bool = False) -> Array:
    """Return the same as `transition` for a carriage without mass.

    The velocity v1 at the step's start has no influence.
    """
    moved = _massless(p, harmonic(0.0), time, 0, is_between=is_between)[0]
    return moved[:, :5].astype(np.float64)


def halved_massless_transitions(p: Values, time: float, levels: int) -> Array:
    """Return the same as `halved_transitions` for a carriage without mass."""
    halves = _massless(p, harmonic(0.0), time, levels)[1:]
    return np.array([half[:, :4].astype(np.float64) for half in halves])


def massless_response(p: Values, source: Exosystem, *, ground: bool, time: float) -> Array:
    """Return the same as `response` for a carriage without mass."""
    return _massless(p, source, time, 0, ground=ground)[0][:, 5:].T.astype(np.float64)


def _massless(
    p: Values,
    source: Exosystem,
    time: float,
    levels: int,
    *,
    ground: bool = False,
    is_between: bool = False,
) -> list[NDArray[np.object_]]:
    """Return x1, x2, v1, v2 after time / 2**k, k = 0 .. levels, against what there is at the start.

    That is (x1, x2, v1, v2, held force, exosystem's states). Without inertia the forces on the
    carriage balance: (c + d) v1 = c v2 - (k1 + k2) x1 + k2 x2 + u + p(t).
    """
    m2, k1, c, d, k2 = (p[name] for name in ("m2", "k1", "c", "d", "k2"))
    zero, size = Decimal(0), 4 + len(source.output)
    push, shake = (zero * source.output, source.output)[:: 1 if ground else -1]
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        v1 = np.concatenate([np.array([-(k1 + k2), k2, c, Decimal(1)]), push]) / (c + d)
        generator = np.full((size, size), zero)  # of (x1, x2, v2, held force, exosystem's states)
        generator[0], generator[1, 2] = v1, Decimal(1)
        generator[2] = c * v1 / m2
        generator[2, :3] += np.array([k2, -k2, -c]) / m2
        if is_between:
            generator[2, 3] -= 1 / m2
        generator[2, 4:] -= shake
        generator[4:, 4:] = source.matrix
        halves = halved_exponentials(generator, time, levels)
        rows = [np.array([half[0], half[1], v1 @ half, half[2]]) for half in halves]
        return [np.insert(row, 2, np.asarray(zero), axis=1) for row in rows]
