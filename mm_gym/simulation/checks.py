"""Checks of the field values and snapshots that lanes are given."""

from __future__ import annotations

from collections.abc import Mapping
from operator import index
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array, Single
from mm_gym.errors import SceneError, refuse
from mm_gym.lanes import layout
from mm_gym.methods.support import MASSLESS, Support

SEEDS = 2**64  # number of seeds of a lane
Mask = NDArray[np.bool_]


def checked_seed(seed: int | np.integer) -> int:
    """Return a seed as an integer of Python, or raise `SceneError` if no lane has it."""
    try:
        number = -1 if isinstance(seed, bool) else index(seed)
    except TypeError:
        number = -1
    if not 0 <= number < SEEDS:
        refuse("seed", f"{seed!r}", "an integer from 0 to 2**64 - 1")
    return number


def checked_fields(
    given: Mapping[str, ArrayLike], support: Support, count: int
) -> dict[int, Array]:
    """Return rows and values of fields by dotted name: a number in the support, or one a lane."""
    rows = {name: support.row_of(name) for name in given}
    names = {row: name for name, row in support.names.items()}
    for followed, ratio, _ in support.products:
        if followed in rows.values():
            msg = f"{names[followed]}: follows from {names[ratio]}; set that"
            raise SceneError(msg)
    checked = {row: _checked(name, given[name], row, support, count) for name, row in rows.items()}
    _check_offset(checked, support)
    for name, row in support.whole_rows.items():
        if row in checked and np.any(checked[row] % 1.0):
            what = "control steps" if row not in support.number_rows.values() else "records"
            refuse(name, f"{checked[row]}", f"whole numbers, those of {what}")
    return checked


def _check_offset(fixed: Mapping[int, Array], support: Support) -> None:
    """Raise `SceneError` for an offset at which a spring of finite stretch has length 0."""
    # As for a scene: at the least stretch, to which an actuator may go in the first step.
    furthest = support.low[layout.STRETCH] * fixed.get(layout.L0, support.low[layout.L0])
    offset = fixed.get(layout.X2)
    if support.high[layout.L0] > 0.0 and offset is not None and np.any(abs(offset) >= furthest):
        end = "where a spring of finite stretch has length 0"
        allowed = f"less than stretch * rest_length = {furthest} m, {end}"
        refuse("initial.sphere_offset", f"{offset}", allowed)


def _checked(name: str, value: ArrayLike, row: int, support: Support, count: int) -> Array:
    array = array_of(value, name)
    if array.dtype.kind not in "fiu" or array.shape not in ((), (count,)):
        refuse(name, f"{value!r}", f"a number, or {count} of them")
    largest = np.finfo(np.float64).max
    low, high = (-largest, largest) if row < layout.FORCE else (support.low[row], support.high[row])
    if not np.all((array >= low) & (array <= high)):
        refuse(name, f"{value}", f"{low:g} to {high:g}, which this scene was compiled for")
    return array.astype(np.float64)


def check_snapshot(
    snapshot: Mapping[str, object], digest: str, arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Raise `SceneError` if a snapshot is not of this scene and of arrays like these."""
    missing = [name for name in ("scene", *arrays) if name not in snapshot]
    if missing:
        msg = f"state: {', '.join(missing)} missing; use what get_state returned"
        raise SceneError(msg)
    if snapshot["scene"] != digest:
        msg = f"state: it belongs to scene {snapshot['scene']}; this one is {digest}"
        raise SceneError(msg)
    for name, own in arrays.items():
        array = snapshot[name]
        if not is_array(array) or (array.shape, array.dtype) != (own.shape, own.dtype):
            msg = f"state.{name}: allowed: an array of shape {own.shape} and type {own.dtype}"
            raise SceneError(msg)


def check_values(values: Array, frames: Single, support: Support, idle: Mask) -> None:
    """Raise `SceneError` for values of a snapshot that lanes cannot have.

    The kernels rely on them: a record is read where its start and the lane's clock point to. Lanes
    are idle, (count,), if their episodes are over: their states may be anything, because an episode
    also ends where its state is lost.
    """
    low, high = _bounds(support)
    least, most = values.min(axis=1), values.max(axis=1)
    outside = ~((least >= low) & (most <= high))
    if support.kind == MASSLESS:  # without mass the carriage's is not finite, and nothing reads it
        outside[layout.CARRIAGE_ACCELERATION] = False
    for row in np.flatnonzero(outside):
        wrong = ~((values[row] >= low[row]) & (values[row] <= high[row]))
        if row in ENDING:
            wrong &= ~idle
        if wrong.any():
            lane = int(np.flatnonzero(wrong)[0])
            names = [name for name, own in support.names.items() if own == row]
            where = f"row {row}" + (f" ({names[-1]})" if names else "") + f" of lane {lane}"
            allowed = f"{low[row]:g} to {high[row]:g}"
            refuse(f"state.values: {where}", f"{values[row, lane]:g}", allowed)
    if not np.all(abs(frames[:, ~idle]) <= layout.OBSERVATION_BOUND):
        msg = f"state.frames: allowed: numbers of magnitude at most {layout.OBSERVATION_BOUND:g}"
        raise SceneError(msg)
    age = values[layout.NOW] - values[layout.BEGAN]
    if np.any(age < 0.0) or np.any(age % 1.0 > 0.0):
        rows = f"rows {layout.BEGAN} and {layout.NOW}"
        msg = f"state.values: {rows}: allowed: whole numbers, in order"
        raise SceneError(msg)
    _check_relations(values, support)


def _check_relations(values: Array, support: Support) -> None:
    """Raise `SceneError` for rows that are not what follows from others, or no whole numbers."""
    for name, row in support.whole_rows.items():
        if np.any(values[row] % 1.0):
            msg = f"state.values: row {row} ({name}): allowed: whole numbers"
            raise SceneError(msg)
    if support.damped_row and np.any(values[support.damped_row] != values[layout.DAMPING]):
        row = support.damped_row
        msg = f"state.values: row {row}: allowed: the same as in row {layout.DAMPING}"
        raise SceneError(msg)
    for row, ratio, other in support.products:
        if np.any(values[row] != values[ratio] * values[other]):
            msg = f"state.values: row {row}: allowed: the product of rows {ratio} and {other}"
            raise SceneError(msg)


def _bounds(support: Support) -> tuple[Array, Array]:
    """Return the least and largest values (rows,) that a snapshot may have."""
    largest = np.finfo(np.float64).max
    low, high = np.full_like(support.low, -largest), np.full_like(support.high, largest)
    # What is prepared once for all lanes has the same value everywhere.
    rows = np.flatnonzero((support.low == support.high) & (support.low != 0.0))
    rows = np.concatenate([rows[rows >= layout.M1], np.array(support.parameters, np.int64)])
    low[rows], high[rows] = support.low[rows], support.high[rows]
    if support.high[layout.VR] > 0.0:  # row C has the slope of dry friction in stick
        low[layout.C], high[layout.C] = 0.0, largest
    for clock in (layout.BEGAN, layout.NOW):
        low[clock], high[clock] = 0.0, LAST
    if support.age_row:
        low[support.age_row], high[support.age_row] = 0.0, LAST
    for row in support.actuator_rows.values():
        low[row + layout.LAG_FACTOR], high[row + layout.LAG_FACTOR] = 0.0, 1.0
        low[row + layout.TRAVEL], high[row + layout.TRAVEL] = 0.0, np.inf
    for row in support.harmonic_rows:
        turn = row + layout.COSINE
        low[turn : turn + 4], high[turn : turn + 4] = -ROUNDED_ONE, ROUNDED_ONE
    return low, high


LAST = 2.0**52  # latest control step of a lane's clock, far below the integers that doubles round
ROUNDED_ONE = 1.0 + 1e-9  # bound of cosines and sines, with more than their round-off

ENDING = {layout.X1, layout.X2, layout.V1, layout.V2, *layout.DERIVED}
"""Rows of a state that may be lost, which ends its episode."""


def array_of(value: ArrayLike, name: str) -> NDArray[Any]:
    """Return the value as an array; refuse parts of different shapes, and masked numbers."""
    if isinstance(value, np.ma.MaskedArray):
        refuse(name, "a masked array", "a value for every lane")
    try:
        return np.asarray(value)
    except ValueError as error:
        msg = f"{name}: got {value!r}; allowed: a number, or as many as there are lanes: {error}"
        raise SceneError(msg) from None


def is_array(value: object) -> TypeGuard[NDArray[Any]]:
    """Tell whether a value is an array, of any type."""
    return isinstance(value, np.ndarray)
