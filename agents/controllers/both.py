"""Laws side by side, one for each actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from agents.controllers.controller import Law, Values


class Both:
    """One law for each actuator, in the order of the action."""

    def __init__(self, *laws: Law) -> None:
        self.name = " + ".join(law.name for law in laws)
        self.laws = laws

    def begin(self, lanes: int) -> None:
        """Prepare all."""
        for law in self.laws:
            law.begin(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return their columns."""
        return np.concatenate([law.action(state, applied) for law in self.laws], 1)
