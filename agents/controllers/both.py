"""Two laws side by side, one for each actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from agents.controllers.controller import Law, Values


class Both:
    """One law for the force and one for the stretch."""

    def __init__(self, force: Law, stretch: Law) -> None:
        self.name = f"{force.name} + {stretch.name}"
        self.force, self.stretch = force, stretch

    def begin(self, lanes: int) -> None:
        """Prepare both."""
        self.force.begin(lanes)
        self.stretch.begin(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the two columns."""
        return np.concatenate([law.action(state, applied) for law in (self.force, self.stretch)], 1)
