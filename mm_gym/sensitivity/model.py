"""The models of the sensitivities' kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.lanes import layout as at
from mm_gym.methods.base import Settings, degree, header
from mm_gym.methods.exponential_action.method import LONGEST_PIECE
from mm_gym.methods.linear.kernel import TRANSITION
from mm_gym.methods.runge_kutta.method import RungeKutta
from mm_gym.methods.support import fastest_rate
from mm_gym.sensitivity import layout as own
from mm_gym.sensitivity import tangent_kernel
from mm_gym.sensitivity.linear_kernel import propagate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

    Array = NDArray[np.float64]

TOLERANCE = 1e-12
"""Of motion and deviations, where steps are Runge-Kutta's."""

_RUNGE_KUTTA = RungeKutta()


def tangent_model_of(support: Support, causes: Sequence[int], rows: int, width: int) -> Array:
    """Return the model of `tangent_kernel`; arguments as of `model_of`."""
    steps = _RUNGE_KUTTA.model(support, Settings(TOLERANCE, 1))
    model = np.zeros(tangent_kernel.CAUSES + width)
    model[: len(steps)] = steps
    model[tangent_kernel.FIRST_ROW], model[tangent_kernel.WIDTH] = rows, width
    model[tangent_kernel.CAUSES :] = own.NONE
    model[tangent_kernel.CAUSES + len(support.state_rows) :][: len(causes)] = causes
    model[at.EXCITATION] = len(model)
    return np.concatenate([model, support.excitation])


def model_of(support: Support, causes: Sequence[int], rows: int, width: int) -> Array:
    """Return the model that follows the state and some causes.

    Parameters
    ----------
    support
        All values that the scene can reach.
    causes
        Rows of the parameters.
    rows
        Number of the plant's own rows of a lane.
    width
        Columns of deviations that the kernel has, at least those of the state and the causes.
    """
    model = header(support, own.CAUSES - at.MODEL_OWN + width)
    model[own.HAS_FRICTION] = support.slips
    model[own.IS_CUBIC] = support.is_cubic or at.BETA in causes
    model[own.IS_FINITE] = support.high[at.L0] > 0.0
    model[own.FIRST_ROW], model[own.WIDTH] = rows, width
    phase = fastest_rate(support) * support.sample_interval
    model[own.PIECES], model[own.DEGREE] = _pieces(phase)
    phase *= support.intervals_per_step
    model[own.STEP_PIECES], model[own.STEP_DEGREE] = _pieces(phase)
    model[own.IS_LINEAR] = is_linear(support, causes)
    model[own.CAUSES :] = own.NONE
    model[own.CAUSES + own.STATES :][: len(causes)] = causes
    model[at.EXCITATION] = len(model)
    return np.concatenate([model, support.excitation])


def is_linear(support: Support, causes: Sequence[int]) -> bool:
    """Tell whether deviations by these causes obey linear equations, in each regime of friction."""
    return not support.is_nonlinear and at.BETA not in causes


def _pieces(phase: float) -> tuple[float, int]:
    """Return how many series cover a time, the fastest rate times which is given, and their degree.

    A time that would need too many is refused by the kernels.
    """
    pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
    return pieces, degree(phase / pieces)


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


def parameter_maps(support: Support, causes: Sequence[int], lane: Array) -> tuple[int, Array]:
    """Return how derivatives of a linear plant over parameters follow from a step's start.

    Without excitation they are linear in the state and the force.

    Parameters
    ----------
    support, causes
        As for `model_of`.
    lane
        (rows,) a lane of the plant.

    Returns
    -------
    tuple
        Status, and (4, causes, 5) the derivatives of x1, x2, v1, v2 with respect to each
        parameter, per unit of x1, x2, v1, v2 and force.
    """
    rows, width = len(lane), own.STATES + len(causes)
    lanes = np.zeros((rows + own.TANGENTS + 4 * width, 5))
    lanes[:rows] = lane[:, None]
    lanes[[*range(4), at.FORCE]] = np.eye(5)
    lanes[rows + own.LAST_V1 : rows + own.TANGENTS - 1] = lanes[at.V1 : at.V2 + 1]
    status = propagate(model_of(support, causes, rows, width), lanes, 0, 5)
    return status, lanes[rows + own.TANGENTS :].reshape(4, width, 5)[:, own.STATES :].copy()
