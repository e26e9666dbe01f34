"""Checks of the field values and snapshots that lanes are given."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from mm_gym.errors import SceneError
from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.methods.support import Support


def checked_fields(
    given: Mapping[str, ArrayLike], support: Support, count: int
) -> dict[int, NDArray[np.float64]]:
    """Return rows and values of fields by dotted name, a number or one per lane.

    Raises
    ------
    SceneError
        If a name is unknown, or a value is not a number within the scene's support.
    """
    rows = {name: support.row_of(name) for name in given}
    names = {row: name for name, row in support.names.items()}
    for followed, ratio, _ in support.products:
        if followed in rows.values():
            msg = f"{names[followed]}: follows from {names[ratio]}; set that"
            raise SceneError(msg)
    checked = {row: _checked(name, given[name], row, support, count) for name, row in rows.items()}
    _check_offset(checked, support)
    return checked


def _check_offset(fixed: Mapping[int, NDArray[np.float64]], support: Support) -> None:
    """Raise `SceneError` for an offset at which a spring of finite stretch has length 0."""
    # As for a scene: at the least stretch, to which an actuator may go in the first step.
    furthest = support.low[at.STRETCH] * fixed.get(at.L0, support.low[at.L0])
    offset = fixed.get(at.X2)
    if support.high[at.L0] > 0.0 and offset is not None and np.any(abs(offset) >= furthest):
        msg = (
            f"initial.sphere_offset: got {offset}; allowed: less than stretch * rest_length = "
            f"{furthest} m, where a spring of finite stretch has length 0"
        )
        raise SceneError(msg)


def _checked(
    name: str, value: ArrayLike, row: int, support: Support, count: int
) -> NDArray[np.float64]:
    array = array_of(value, name)
    if array.dtype.kind not in "fiu" or array.shape not in ((), (count,)):
        msg = f"{name}: got {value!r}; allowed: a number, or {count} of them"
        raise SceneError(msg)
    largest = np.finfo(np.float64).max
    low, high = (-largest, largest) if row < at.FORCE else (support.low[row], support.high[row])
    if not np.all((array >= low) & (array <= high)):
        msg = (
            f"{name}: got {value}; allowed: {low:g} to {high:g}, which this scene was compiled for"
        )
        raise SceneError(msg)
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


def array_of(value: ArrayLike, name: str) -> NDArray[Any]:
    """Return the value as an array, or raise `SceneError` if its parts differ in shape."""
    try:
        return np.asarray(value)
    except ValueError as error:
        msg = f"{name}: got {value!r}; allowed: a number, or as many as there are lanes: {error}"
        raise SceneError(msg) from None


def is_array(value: object) -> TypeGuard[NDArray[Any]]:
    """Tell whether a value is an array, of any type."""
    return isinstance(value, np.ndarray)
