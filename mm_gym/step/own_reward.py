"""Rewards by a caller's own cost, a compiled function of channels, in place of the scene's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import types

from mm_gym.compiler.llvm_code import compiled_as, get_item_pointer
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
    shown = _reading(tuple(rows))

    @numba.njit(nogil=True, error_model="numpy")
    def reward(lanes, rewards, first, last):
        lost = False
        try:
            for i in range(first, last):
                value = 0.0 - cost(*shown(lanes, i))
                rewards[i] = value
                lost |= not abs(value) < np.inf
        except Exception:  # noqa: BLE001 - whatever a caller's function raises
            lost = True
        return layout.UNREWARDED if lost else layout.OK

    return reward


@cache  # the compiler never forgets an instruction
def _reading(rows: tuple[tuple[int, int], ...]) -> Compiled:
    """Return a function (lanes, i) -> the arguments of the cost in lane i."""

    def built(context, builder, kinds, lanes, i):
        array = context.make_array(kinds[0])(context, builder, lanes)

        def number(row):
            place = [context.get_constant(types.intp, row), i]
            return builder.load(get_item_pointer(context, builder, kinds[0], array, place))

        values = [
            number(row) if less == layout.NO_ROW else builder.fsub(number(row), number(less))
            for row, less in rows
        ]
        return context.make_tuple(builder, result, values)

    result = types.UniTuple(types.float64, len(rows))

    @compiled_as(result, built)
    def shown(lanes, i):
        return tuple(
            lanes[row, i] - (0.0 if less == layout.NO_ROW else lanes[less, i]) for row, less in rows
        )

    return shown
