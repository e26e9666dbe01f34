"""Exact transition matrices of linear plants (Van Loan, IEEE Trans. Automat. Control 23, 1978)."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.exponential import ASSEMBLY_DIGITS, exponential, ladder

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.state_space import StateSpace, Values


def transition(system: StateSpace, time: float) -> NDArray[np.float64]:
    """Return [exp(A t) | response to a held unit force], (4, 5)."""
    generator = np.full((5, 5), Decimal(0))
    generator[:4, :4], generator[:4, 4] = system.a, system.force
    return exponential(generator, time)[:4]


def response_to_tone(
    system: StateSpace, frequency: float, *, ground: bool, time: float
) -> NDArray[np.float64]:
    """Return what cos and sin of the phase at the step's start add to the state at its end, (2, 4).

    The excitation sin(w t + phase) is the second state of the exosystem
    z' = [[0, -w], [w, 0]] z, z = (cos, sin).
    """
    generator = np.full((6, 6), Decimal(0))
    generator[:4, :4] = system.a
    generator[:4, 5] = system.ground if ground else system.force
    generator[4, 5], generator[5, 4] = -Decimal(frequency), Decimal(frequency)
    return exponential(generator, time)[:4, 4:].T


def massless_transition(p: Values, time: float) -> NDArray[np.float64]:
    """Return the same as `transition` for a carriage without mass.

    The velocity v1 at the step's start has no influence.
    """
    return _massless(p, time, Decimal(0), ground=False)[:, :5].astype(np.float64)


def massless_response_to_tone(
    p: Values, frequency: float, *, ground: bool, time: float
) -> NDArray[np.float64]:
    """Return the same as `response_to_tone` for a carriage without mass."""
    return _massless(p, time, Decimal(frequency), ground=ground)[:, 5:].T.astype(np.float64)


def _massless(p: Values, time: float, frequency: Decimal, *, ground: bool) -> NDArray[np.object_]:
    """Return x1, x2, v1, v2 at the step's end against what there is at its start.

    That is (x1, x2, v1, v2, held force, cos, sin).

    Without inertia the forces on the carriage balance:
    (c + d) v1 = c v2 - (k1 + k2) x1 + k2 x2 + u + p(t).
    """
    m2, k1, c, d, k2 = (p[name] for name in ("m2", "k1", "c", "d", "k2"))
    zero = Decimal(0)
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        push = zero if ground else 1 / (c + d)
        v1 = np.array([-(k1 + k2), k2, c, Decimal(1), zero, zero]) / (c + d)
        v1[5] = push
        generator = np.full((6, 6), zero)
        generator[0], generator[1, 2] = v1, Decimal(1)
        generator[2] = (np.array([k2, -k2, -c, zero, zero, zero]) + c * v1) / m2
        generator[2, 5] -= 1 if ground else 0
        generator[4, 5], generator[5, 4] = -frequency, frequency
    step = ladder(generator, time, 0)[0]
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        rows = np.array([step[0], step[1], v1 @ step, step[2]])
        return np.insert(rows, 2, np.asarray(zero), axis=1)
