"""The ends of episodes whose lanes begin anew in the step that ends them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.simulation.lanes import Lanes


class Ends:
    """Last outputs of lanes, for `final_obs` and `final_info`, laid out as by `SyncVectorEnv`.

    Parameters
    ----------
    lanes
        The lanes.
    copy
        Whether what is returned is the caller's own. If not, it is memory that the next call
        overwrites: to make an array for each observation takes longer than the control step.
    """

    def __init__(self, lanes: Lanes, *, copy: bool) -> None:
        self._lanes, self._copy = lanes, copy
        self._memory: tuple[Any, ...] = ()
        self._former = np.empty(0, np.int64)

    def of(
        self, over: NDArray[np.int64]
    ) -> tuple[NDArray[np.object_], NDArray[np.float64], NDArray[np.float64]]:
        """Return the outputs of the lanes listed, before they begin anew.

        They are observations (lanes,), None in other lanes, and states (lanes, 4) and what was
        applied (lanes, actuators), zero in other lanes.
        """
        memory, former = self._memory, self._former
        if not memory:
            memory = self._allocated(len(over) if self._copy else self._lanes.count)
        written, rows, observations, state, applied = memory
        self._lanes.copy_ends(over, former, *written)
        observations[former] = None
        observations[over] = rows[: len(over)]
        if not self._copy:
            self._memory, self._former = memory, over
        return observations, state, applied

    def _allocated(self, count: int) -> tuple[Any, ...]:
        """Return memory for a number of lanes' observations.

        It is what the kernel writes, each observation's row in it, all lanes' observations, states,
        and what was applied.
        """
        _, _, _, state, applied = self._lanes.outputs
        observed = np.empty((count, len(self._lanes.observed)), np.float32)
        values = np.zeros((self._lanes.count, len(state) + len(applied)))
        views = observed.view(), values[:, : len(state)], values[:, len(state) :]
        for view in views:
            view.flags.writeable = self._copy
        rows = np.fromiter(views[0], dtype=object, count=count)
        return (observed, values), rows, np.empty(self._lanes.count, dtype=object), *views[1:]
