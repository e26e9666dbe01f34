"""The models of the sensitivities' kernels, and the excitation to be expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError
from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import noise
from mm_gym.lanes import layout
from mm_gym.methods.base import Settings, degree, header
from mm_gym.methods.linear.kernel import TRANSITION
from mm_gym.methods.linear_series.method import LONGEST_PIECE
from mm_gym.methods.runge_kutta.method import RungeKutta
from mm_gym.methods.support import Support, fastest_rate
from mm_gym.methods.taylor import layout as series
from mm_gym.sensitivity import layout as slots
from mm_gym.sensitivity.linear_kernel import propagate

TOLERANCE = 1e-12
"""Of motion and deviations by Runge-Kutta steps; ten times as much, and so on, where they would be
too many."""

_RUNGE_KUTTA = RungeKutta()


def model_of(
    support: Support, causes: Sequence[int], rows: int, width: int, tolerance: float = TOLERANCE
) -> Array:
    """Return the model that follows the state and some causes, the rows of parameters.

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
    tolerance
        Of motion and deviations by Runge-Kutta steps.
    """
    model = header(support, slots.CAUSES - layout.MODEL_OWN + width)
    if support.is_general:
        settings = Settings(tolerance, 1)
        planned = _RUNGE_KUTTA.planned(support, settings)
        if planned is None:
            reason = _RUNGE_KUTTA.obstacle(support, settings)
            msg = f"jacobian: not by {_RUNGE_KUTTA.title}: {reason}"
            raise SimulationError(msg)
        steps = _RUNGE_KUTTA.model(support, planned)
        model[: len(steps)] = steps
    model[series.HAS_FRICTION] = support.slips
    model[series.IS_CUBIC] = support.is_cubic or layout.BETA in causes
    model[series.IS_FINITE] = support.high[layout.L0] > 0.0
    model[slots.FIRST_ROW], model[slots.WIDTH] = rows, width
    phase = fastest_rate(support) * support.sample_interval
    model[slots.PIECES], model[slots.DEGREE] = _pieces(phase)
    model[slots.DEGREE] += max(support.terms - 1, 0)  # a jet's last term begins so much later
    phase *= support.intervals_per_step
    model[slots.STEP_PIECES], model[slots.STEP_DEGREE] = _pieces(phase)
    model[slots.CAUSES :] = slots.NONE
    model[slots.CAUSES + len(support.state_rows) :][: len(causes)] = causes
    model[layout.EXCITATION] = len(model)
    return np.concatenate([model, support.excitation])


def _pieces(phase: float) -> tuple[float, int]:
    """Return how many series cover a time, the fastest rate times which is given, and their degree.

    A time that would need too many is refused by the kernels.
    """
    pieces = max(1.0, np.ceil(phase / LONGEST_PIECE))
    return pieces, degree(phase / pieces)


def control_step(model: Array) -> tuple[Array, Array]:
    """Return the transition of a linear plant over a control step, given its method's model.

    It is (4, 4) with respect to the state, and (4, 1) to the force [N] held.
    """
    once = model[TRANSITION : TRANSITION + 20].reshape(4, 5)
    state, force = np.eye(4), np.zeros((4, 1))
    for _ in range(int(model[layout.INTERVALS])):
        state, force = once[:, :4] @ state, once[:, :4] @ force + once[:, 4:]
    return state, force


def parameter_maps(support: Support, causes: Sequence[int], lane: Array) -> tuple[int, Array]:
    """Return how derivatives of a linear plant over parameters follow from a step's start.

    Without excitation they are linear in the state and the force. With a status these are (4,
    causes, 5): the derivatives of x1, x2, v1, v2 with respect to each parameter, per unit of x1,
    x2, v1, v2 and force.
    """
    rows, width = len(lane), slots.STATES + len(causes)
    lanes = np.zeros((rows + slots.TANGENTS + 4 * width, 5))
    lanes[:rows] = lane[:, None]
    lanes[[*range(4), layout.FORCE]] = np.eye(5)
    lanes[rows + slots.LAST_V1 : rows + slots.TANGENTS - 1] = lanes[layout.V1 : layout.V2 + 1]
    status = propagate(model_of(support, causes, rows, width), lanes, 0, 5)
    return status, lanes[rows + slots.TANGENTS :].reshape(4, width, 5)[:, slots.STATES :].copy()


def expected(support: Support, model: Array, values: Array) -> tuple[Support, Array, Array]:
    """Return support, model and lanes (rows, count) with nothing random to come.

    That is the excitation to be expected by one who knows its present state, but not what is drawn.
    Noise decays as the filters do that shape it: the conditional mean. Impulses whose time is given
    come as they do; random ones are taken to have a mean size of 0.
    """
    described, model, values = support.excitation.copy(), model.copy(), values.copy()
    spread = slice(shaping.SPREAD, shaping.START_SPREAD)
    for k in range(int(described[0])):
        source = described[kernels.FIRST + kernels.SIZE * k :][: kernels.SIZE]
        row, place = int(source[kernels.ROW]), int(source[kernels.OWN + noise.PLACE])
        if source[kernels.KIND] == kernels.IMPULSE:
            time, following = values[row + process.TIME], values[row + process.NEXT]
            values[row + process.NEXT] = np.where(following <= time, time, process.NEVER)
            values[row + process.RANDOM] = process.NEVER
            values[row + process.RATE] = 0.0
        elif source[kernels.KIND] == kernels.FILTER:
            matrices = described[place:] if place else values[row + noise.ROWS :]
            matrices[spread] = 0.0
    model[int(model[layout.EXCITATION]) :] = described
    return replace(support, excitation=described), model, values
