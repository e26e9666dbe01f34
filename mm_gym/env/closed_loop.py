"""Whole episodes of a vector environment, without Python between their control steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from gymnasium.error import ResetNeeded

from mm_gym.simulation.closed_loop import ClosedLoop

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.rendering.renderer import Renderer
    from mm_gym.simulation.closed_loop import Episodes
    from mm_gym.simulation.lanes import Lanes


class CanCloseLoop:
    """A vector environment whose episodes a compiled law can run through."""

    num_envs: int
    _lanes: Lanes
    _over: NDArray[np.int64]
    _renderer: Renderer | None

    def closed_loop(self, law: Callable[..., None], *arguments: object) -> Callable[[], Episodes]:
        """Return a function that takes every lane through its episode to the end.

        Between the control steps no Python runs, and the GIL is free. The function may be called
        after each `reset`; the next call needs another one.

        Parameters
        ----------
        law
            A function ``law(observed, actions, *arguments)`` that `numba.njit` has compiled. It
            returns nothing, and is called before each control step of all lanes.

            - ``observed``, read: (n, columns) float32. A lane's observation is a column; there may
              be more columns than lanes.
            - ``actions``, to be written: (k, lanes) float32, as `step` takes them, transposed.
        *arguments
            Arrays, numbers and tuples of them, of the caller's own. What arrays hold is read anew
            in each control step, so they may be changed between two episodes, and be the law's
            memory.

        Raises
        ------
        TypeError
            If the law is not compiled, or returns something.
        ResetNeeded, ActionError, SimulationError
            From the function, as from `step`; the last one also if the law raises an error.
        """
        loop = ClosedLoop(self._lanes, law, arguments)

        def run() -> Episodes:
            if self._over.size:
                msg = f"{self._over.size} of {self.num_envs} lanes need reset() before an episode"
                raise ResetNeeded(msg)
            self._over = np.arange(self.num_envs)
            episodes = loop.run()
            if self._renderer is not None:
                self._renderer.note(watched=False)
            return episodes

        return run
