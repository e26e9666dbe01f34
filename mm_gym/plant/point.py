"""The lane at the point about which a plant is made linear."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SceneError, as_array, refuse
from mm_gym.lanes import layout
from mm_gym.law.dry_friction import REGIMES_WRITTEN, write_regimes
from mm_gym.methods.support import Support
from mm_gym.plant.idle_friction import REMEDY


def lane_at(
    support: Support, values: Mapping[str, float] | ArrayLike | None, about: ArrayLike | None
) -> Array:
    """Return the lane (rows,) with some values that it was compiled for, at a state (4,)."""
    if values is None or hasattr(values, "keys"):
        row = support.middle
        named: Mapping[str, float] = values or {}  # pyright: ignore[reportAssignmentType, reportUnknownVariableType]
        for name, value in named.items():
            row[support.row_of(name)] = _value(support, name, value)
        for follower, ratio, other in support.products:
            row[follower] = row[ratio] * row[other]
    else:
        row = _numbers("at", values, len(support.start_low))
        require_parameters(support, row[:, None])
    row[:4] = 0.0 if about is None else _numbers("about", about, 4)
    row[layout.FORCE] = 0.0
    if support.damped_row:
        row[support.damped_row] = row[layout.DAMPING]
    furthest, got = row[layout.STRETCH] * row[layout.L0], row[layout.X2] - row[layout.X1]
    if row[layout.L0] > 0.0 and abs(got) >= furthest:
        refuse("about", f"a relative displacement of {got:g} m", f"below {furthest:g}")
    plain(write_regimes)(row[:, None], 0, 1)
    slip = abs(row[layout.V2] - row[layout.V1])
    if slip > support.idle_velocity:
        allowed = f"at most interface.reference_velocity = {support.idle_velocity:g} m/s, {REMEDY}"
        refuse("about", f"a slip velocity of {slip:g} m/s", allowed)
    return row


def require_parameters(support: Support, values: Array) -> None:
    """Raise `SceneError` for parameters (rows, lanes) that the plant was not compiled for."""
    derived = REGIMES_WRITTEN if support.slips else ()  # written when an episode begins
    rows = np.array([row for row in support.parameters if row not in derived])
    low, high = support.low[rows, None], support.high[rows, None]
    wrong = np.argwhere(~((values[rows] >= low) & (values[rows] <= high)))
    if not len(wrong):
        return
    k, lane = wrong[0]
    row = rows[k]
    names = [name for name, own in support.names.items() if own == row]
    where = names[-1] if names else f"row {row}"
    refuse(
        f"at: {where}", f"{values[row, lane]:g}", f"{support.low[row]:g} to {support.high[row]:g}"
    )


def _value(support: Support, name: str, value: object) -> float:
    row = support.row_of(name)
    if row < layout.FORCE:
        msg = f"at.{name}: state the point by about = (x1, x2, v1, v2)"
        raise SceneError(msg)
    low, high = float(support.low[row]), float(support.high[row])
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and low <= value <= high):  # pyright: ignore[reportOperatorIssue] - a number
        refuse(f"at.{name}", f"{value!r}", f"{low:g} to {high:g}")
    return float(value)  # pyright: ignore[reportArgumentType] - a number


def _numbers(what: str, values: object, size: int) -> Array:
    array = as_array(what, values)
    if array.dtype.kind not in "fiu" or array.shape != (size,):
        refuse(what, f"shape {array.shape} of {array.dtype}", f"({size},) numbers")
    if not np.isfinite(array[: layout.HARMONICS]).all():  # a plateau behind them may be endless
        refuse(what, "NaN or infinity", "finite numbers")
    return array.astype(np.float64)
