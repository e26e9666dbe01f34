"""Texts of what ends a simulation: what happened, in which lanes, where and when."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# SciPy ships no types

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law.carriage_spring import escape_distance
from mm_gym.law.springs import stiffness
from mm_gym.plant.plant import Plant

GROWN = (layout.TOO_MANY_EVENTS, layout.TOO_MANY_SERIES, layout.DIVERGED)
"""How a motion that grows forever may end."""

MOST_NAMED = 5  # lanes named in a message, at most


def text_of(plant: Plant, values: Array, rewards: Array, status: int, age: Array) -> str:
    """Return what went wrong in a control step.

    Parameters
    ----------
    plant
        What was propagated.
    values, rewards
        (rows, count) lanes and (count,) rewards, as the step left them.
    status
        One of the codes of `mm_gym.lanes.layout` above NOT_FINITE.
    age
        (count,) control steps since each episode's start, the present one included.
    """
    lanes = _escaped(plant, values) if status == layout.ESCAPED else _lost(values, rewards)
    text = layout.MESSAGES[status]
    if status == layout.ESCAPED and lanes.size:
        text = _escape(values[:, lanes[0]], float(age[lanes[0]]) * plant.time_step)
    elif status in GROWN:
        lane = _runaway(values, lanes)
        if lane is not None:
            # A shorter control step, as the text advises, would not keep the motion from growing.
            text = f"{text.partition('; ')[0]}; {growth_of(values[:, lane])}"
            text += _place(values[:, lane], age[lane], plant)
            lanes = lanes if lanes.size else np.array([lane])
    return f"{plant.method.name}{_named(lanes, values.shape[1])}: {text}"


def _named(lanes: NDArray[np.intp], count: int) -> str:
    """Name some lanes, if there is more than one in all."""
    if count == 1 or not lanes.size:
        return ""
    named = ", ".join(map(str, lanes[:MOST_NAMED]))
    return f", lane {named}" + (", ..." if lanes.size > MOST_NAMED else "")


def _lost(values: Array, rewards: Array) -> NDArray[np.intp]:
    """Return the lanes whose state or cost is not finite."""
    finite = np.isfinite(values[[layout.X1, layout.X2, layout.V1, layout.V2]]).all(
        axis=0
    ) & np.isfinite(rewards)
    return np.flatnonzero(~finite)


def _escaped(plant: Plant, values: Array) -> NDArray[np.intp]:
    """Return the lanes whose carriage has escaped."""
    parameters = values[[layout.M1, layout.K1, layout.ALPHA, layout.BETA]].T
    interval = plant.support.sample_interval
    distances = [plain(escape_distance)(*lane, interval) for lane in parameters]
    return np.flatnonzero(np.abs(values[layout.X1]) > np.array(distances))


def _escape(lane: Array, time: float) -> str:
    """Return what to say of a lane (rows,) that escaped in the control step until a time [s]."""
    alpha, beta, x1 = lane[layout.ALPHA], lane[layout.BETA], lane[layout.X1]
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


def growth_of(lane: Array) -> str:
    """Return at which rate motions of a lane (rows,) grow forever, and how to change that.

    The text is empty where they do not. The rate is that about x1 = 0, with friction in stick.
    """
    if not _grows_forever(lane):
        return ""
    from scipy.linalg import eigvals  # noqa: PLC0415 - nothing else here needs it

    k2 = (
        float(plain(stiffness)(lane[layout.K0], lane[layout.STRETCH]))
        if lane[layout.K0] > 0.0
        else 0.0
    )
    k, c, d = lane[layout.K1] * lane[layout.ALPHA], lane[layout.C], lane[layout.D]
    generator = np.array(
        [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-k - k2, k2, -c - d, c], [k2, -k2, c, -c]]
    )
    masses = np.diag([1.0, 1.0, lane[layout.M1], lane[layout.M2]])
    rates = np.asarray(eigvals(generator, masses), np.complex128)
    rate = float(rates.real[np.isfinite(rates)].max())
    return (
        f"carriage.linear_coefficient = {lane[layout.ALPHA]:g} without a cubic_coefficient > 0 "
        f"lets motions grow as exp({rate:.4g} t) forever, t in s: set a cubic_coefficient > 0, or "
        "end episodes by objective.displacement_limit"
    )


def _place(lane: Array, age: np.float64, plant: Plant) -> str:
    """Return where the carriage of a lane (rows,) is, if that is known."""
    time = f" in the control step until t = {float(age) * plant.time_step:.9g} s"
    if not np.isfinite(lane[layout.X1]):
        return f". The carriage was lost{time}"
    return f". The carriage is at x1 = {lane[layout.X1]:.6g} m{time}"


def _runaway(values: Array, lost: NDArray[np.intp]) -> int | None:
    """Return the first lost lane whose motion grows forever, or else the farthest of such lanes."""
    grows = _grows_forever(values)
    if grows[lost].any():
        return int(lost[grows[lost]][0])
    if lost.size or not grows.any():
        return None
    return int(np.argmax(np.where(grows, np.abs(values[layout.X1]), -1.0)))


def _grows_forever(lanes: Array) -> NDArray[np.bool_]:
    return np.asarray((lanes[layout.ALPHA] < 0.0) & (lanes[layout.BETA] == 0.0))
