"""Exact transition matrices of linear plants (Van Loan, IEEE Trans. Automat. Control 23, 1978)."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.exponential import exponential

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.state_space import StateSpace


def transition(system: StateSpace, time: float) -> NDArray[np.float64]:
    """Return [exp(A t) | response to a held unit force], (4, 5)."""
    generator = np.full((5, 5), Decimal(0))
    generator[:4, :4], generator[:4, 4] = system.a, system.force
    return exponential(generator, time)[:4]


def response_to_tone(system: StateSpace, frequency: float, *, ground: bool, time: float) -> NDArray[np.float64]:
    """Return what cos and sin of the phase at the step's start add to the state at its end, (2, 4).

    The excitation sin(w t + phase) is the second state of the exosystem z' = [[0, -w], [w, 0]] z, z = (cos, sin).
    """
    generator = np.full((6, 6), Decimal(0))
    generator[:4, :4] = system.a
    generator[:4, 5] = system.ground if ground else system.force
    generator[4, 5], generator[5, 4] = -Decimal(frequency), Decimal(frequency)
    return exponential(generator, time)[:4, 4:].T
