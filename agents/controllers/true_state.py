"""The true state, which no agent sees: for bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads, Values


class TrueState:
    """The state and the actuators' values from the environment's `info`."""

    reads: Reads = "full state"

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def read(self, observation: NDArray[np.float32], info: dict[str, Any]) -> tuple[Values, Values]:
        """Return what `info` says."""
        return info["state"], info["applied"]

    def send(self, action: Values) -> None:
        """Nothing to note."""
