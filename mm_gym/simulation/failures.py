"""Texts of what ends a simulation: what happened, in which lanes, where and when."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import plain
from mm_gym.kernels.laws import escape_distance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.plant.plant import Plant

    Values = NDArray[np.float64]

MOST_NAMED = 5
"""Lanes named in a message, at most."""


def text_of(plant: Plant, values: Values, rewards: Values, status: int, age: Values) -> str:
    """Return what went wrong in a control step.

    Parameters
    ----------
    plant
        What was propagated.
    values
        (rows, count) the lanes, as the step left them.
    rewards
        (count,) those of the step.
    status
        One of the codes of `mm_gym.kernels.layout` above NOT_FINITE.
    age
        (count,) control steps since each episode's start, the present one included.
    """
    lanes = _escaped(plant, values) if status == at.ESCAPED else _lost(values, rewards)
    text = at.MESSAGES[status]
    if status == at.ESCAPED and lanes.size:
        text = _escape(values[:, lanes[0]], float(age[lanes[0]]) * plant.time_step)
    elif status == at.DIVERGED and lanes.size and _grows_forever(values[:, lanes[0]]):
        text += (
            "; with carriage.linear_coefficient < 0 and no cubic_coefficient > 0 motions grow "
            "forever, which objective.displacement_limit can end"
        )
    return f"{plant.method.name}{_named(lanes, values.shape[1])}: {text}"


def _named(lanes: NDArray[np.intp], count: int) -> str:
    """Name some lanes, if there is more than one in all."""
    if count == 1 or not lanes.size:
        return ""
    named = ", ".join(map(str, lanes[:MOST_NAMED]))
    return f", lane {named}" + (", ..." if lanes.size > MOST_NAMED else "")


def _lost(values: Values, rewards: Values) -> NDArray[np.intp]:
    """Return the lanes whose state or cost is not finite."""
    finite = np.isfinite(values[[at.X1, at.X2, at.V1, at.V2]]).all(axis=0) & np.isfinite(rewards)
    return np.flatnonzero(~finite)


def _escaped(plant: Plant, values: Values) -> NDArray[np.intp]:
    """Return the lanes whose carriage has escaped."""
    parameters = values[[at.M1, at.K1, at.ALPHA, at.BETA]].T
    interval = plant.support.sample_interval
    distances = [plain(escape_distance)(*lane, interval) for lane in parameters]
    return np.flatnonzero(np.abs(values[at.X1]) > np.array(distances))


def _escape(lane: Values, time: float) -> str:
    """Return what to say of a lane (rows,) that escaped in the control step until a time [s]."""
    alpha, beta, x1 = lane[at.ALPHA], lane[at.BETA], lane[at.X1]
    if alpha > 0.0:
        barrier = float(np.sqrt(-alpha / beta))
        what = (
            "the carriage has left its potential well, whose barrier is at "
            f"|x1| = sqrt(-alpha / beta) = {barrier:.6g} m"
        )
    else:
        what = "the carriage's spring (alpha <= 0, beta < 0) has no potential well to hold it"
    return (
        f"escape in the control step until t = {time:.9g} s: {what}; it is at x1 = {x1:.6g} m and "
        "driven ever faster outwards. objective.displacement_limit ends such an episode instead"
    )


def _grows_forever(lane: Values) -> bool:
    return bool(lane[at.ALPHA] < 0.0 and lane[at.BETA] <= 0.0)
