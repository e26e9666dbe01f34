"""Two laws side by side, one for each actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.controller import FULL_STATE, OBSERVATION

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from mm_gym import MovingMassVectorEnv


class Both:
    """One law for the force and one for the stretch."""

    def __init__(self, force: Controller, stretch: Controller) -> None:
        self.name = f"{force.name} + {stretch.name}"
        self.reads = FULL_STATE if FULL_STATE in (force.reads, stretch.reads) else OBSERVATION
        self.force, self.stretch = force, stretch

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare both."""
        self.force.reset(env)
        self.stretch.reset(env)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the two columns."""
        laws = (self.force, self.stretch)
        return np.concatenate([law.act(observation, info) for law in laws], axis=1)
