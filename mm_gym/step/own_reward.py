"""Rewards by a caller's own cost, a compiled function of channels, in place of the scene's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np

from mm_gym.lanes import layout

Compiled = Callable[..., Any]


def rewarding(cost: Compiled, rows: Sequence[tuple[int, int]]) -> Compiled:
    """Return the kernel ``(lanes, rewards, first, last) -> status`` that rewards a control step.

    The reward of a lane is minus its cost. A plain function of numba's, which no cache keeps: the
    digest of the package's sources does not cover a caller's function.

    Parameters
    ----------
    cost
        A compiled function of numbers that returns a number.
    rows
        Of each argument the row of the lanes, and the row subtracted from it or `NO_ROW`.
    """
    cost_of = _of_values(cost)
    for row, subtracted in reversed(rows):
        cost_of = _with_value(cost_of, row, subtracted)

    @numba.njit(nogil=True, error_model="numpy")
    def reward(lanes, rewards, first, last):
        lost = False
        try:
            for i in range(first, last):
                value = 0.0 - cost_of(lanes, i, ())
                rewards[i] = value
                lost |= not abs(value) < np.inf
        except Exception:  # noqa: BLE001 - whatever a caller's function raises
            lost = True
        return layout.UNREWARDED if lost else layout.OK

    return reward


def _of_values(cost: Compiled) -> Compiled:
    @numba.njit(error_model="numpy")
    def cost_of(lanes, i, values):  # noqa: ARG001 - `_with_value` has read them
        return cost(*values)

    return cost_of


def _with_value(cost_of: Compiled, row: int, subtracted: int) -> Compiled:
    """Return a function that reads one more value of a lane, for those read behind it."""
    if subtracted == layout.NO_ROW:

        @numba.njit(error_model="numpy")
        def read_row(lanes, i, values):
            return cost_of(lanes, i, (*values, lanes[row, i]))

        return read_row

    @numba.njit(error_model="numpy")
    def read_difference(lanes, i, values):
        return cost_of(lanes, i, (*values, lanes[row, i] - lanes[subtracted, i]))

    return read_difference
