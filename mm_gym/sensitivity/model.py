"""The models of the sensitivities' kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.methods.base import degree, header
from mm_gym.methods.exponential_action.method import LONGEST_PIECE
from mm_gym.methods.linear.kernel import TRANSITION
from mm_gym.methods.support import fastest_rate
from mm_gym.sensitivity import layout as own

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

    Array = NDArray[np.float64]

BESIDE = own.COLUMNS - own.STATES
"""Causes that one model follows, beside the four states."""


def series_models(support: Support, causes: Sequence[int], rows: int) -> list[Array]:
    """Return as many models as it takes to follow the state and some rows of parameters.

    Parameters
    ----------
    support
        All values that the scene can reach.
    causes
        Rows of the parameters.
    rows
        Number of the plant's own rows of a lane.
    """
    models: list[Array] = []
    phase = fastest_rate(support) * support.sample_interval
    pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
    for first in range(0, max(len(causes), 1), BESIDE):
        model = header(support, own.MODEL_SIZE)
        model[own.HAS_FRICTION] = support.slips
        model[own.IS_CUBIC] = support.is_cubic
        model[own.IS_FINITE] = support.high[at.L0] > 0.0
        model[own.FIRST_ROW] = rows
        model[own.PIECES], model[own.DEGREE] = pieces, degree(phase / pieces)
        model[own.CAUSES : own.CAUSES + own.COLUMNS] = own.NONE
        chosen = causes[first : first + BESIDE]
        model[own.IS_LINEAR] = not support.is_nonlinear and set(chosen) <= {at.FORCE, at.STRETCH}
        model[own.CAUSES + own.STATES : own.CAUSES + own.STATES + len(chosen)] = chosen
        model[at.EXCITATION] = len(model)
        models.append(np.concatenate([model, support.excitation]))
    return models


def control_step(model: Array) -> tuple[Array, Array]:
    """Return the derivatives of a linear plant: its transition over a control step.

    Parameters
    ----------
    model
        That of `mm_gym.methods.linear`.

    Returns
    -------
    tuple
        (4, 4) with respect to the state, and (4, 1) to the force [N] held.
    """
    once = model[TRANSITION : TRANSITION + 20].reshape(4, 5)
    state, force = np.eye(4), np.zeros((4, 1))
    for _ in range(int(model[at.INTERVALS])):
        state, force = once[:, :4] @ state, once[:, :4] @ force + once[:, 4:]
    return state, force
