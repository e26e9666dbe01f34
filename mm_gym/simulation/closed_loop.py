"""Whole episodes of lanes under a compiled controller."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.addresses import address_of
from mm_gym.compiler.jit import COMPILED, compiled_for, entry_point
from mm_gym.errors import SimulationError
from mm_gym.simulation.lanes import Lanes
from mm_gym.step.closed_loop import LAW_FAILED, run


class Episodes(NamedTuple):
    """What came of one episode in each lane."""

    returns: Array
    """(lanes,) sum of the rewards [-]"""
    least: Array
    """(lanes,) least reward, at most zero [-]"""
    lengths: NDArray[np.int64]
    """(lanes,) number of control steps"""
    terminated: NDArray[np.bool_]
    """(lanes,) whether it was terminated, not truncated"""


class ClosedLoop:
    """Lanes under a controller that acts on what is observed.

    Parameters
    ----------
    lanes
        The lanes.
    controller, arguments
        As for `MovingMassVectorEnv.closed_loop`.
    """

    def __init__(
        self, lanes: Lanes, controller: Callable[..., None], arguments: tuple[object, ...]
    ) -> None:
        self._lanes, self._controller = lanes, controller  # whose machine code is called by address
        actions = np.zeros((len(lanes.plant.actuators), lanes.count), np.float32)
        self._rewards = lanes.rewards = np.zeros(lanes.count)
        step, known = lanes.step_with(actions.reshape(-1))
        given = (known[3][: len(lanes.observed)], actions, *arguments)
        _check(controller, given)
        reward, read = lanes.reward_with()
        constants = (
            *(address_of(controller, *given), given, address_of(step, *known), known),
            *(address_of(reward, *read), read),
        )
        self._run = partial(entry_point(run, *constants, self._empty()), *constants)

    def _empty(self) -> Episodes:
        count = self._lanes.count
        return Episodes(
            np.empty(count), np.empty(count), np.empty(count, np.int64), np.empty(count, np.bool_)
        )

    def run(self) -> Episodes:
        """Take all lanes to the ends of their episodes."""
        found, self._lanes.rewards = self._empty(), self._rewards
        status = self._run(found)
        if status == LAW_FAILED:
            msg = "controller: raised an error in compiled code; call it from Python to see which"
            raise SimulationError(msg)
        self._lanes.raise_for(status)
        return found


def _check(controller: Any, given: tuple[object, ...]) -> None:  # noqa: ANN401 - anything may be given
    """Raise `TypeError` unless a controller can be called by address."""
    if not COMPILED:
        return
    if not hasattr(controller, "overloads"):
        msg = f"controller: got {controller!r}; allowed: a function that numba.njit has compiled"
        raise TypeError(msg)
    returned = compiled_for(controller, *given).signature.return_type
    if returned != types.none:
        msg = f"controller: returns {returned}; allowed: nothing, it writes the actions"
        raise TypeError(msg)
