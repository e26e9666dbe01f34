"""A law and what tells it the state: together a controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.observed_state import ObservedState

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Law, Reads, StateSource, Values
    from mm_gym import MovingMassVectorEnv, Scene


class Feedback:
    """Feed the state back through a law.

    Parameters
    ----------
    scene
        The scene that is controlled.
    law
        The law; it gives the controller its name.
    source
        Where the state comes from: by default an estimate from the observation. `TrueState` is a
        bound that no agent can use.
    """

    def __init__(self, scene: Scene, law: Law, source: StateSource | None = None) -> None:
        self.law = law
        self.source = source or ObservedState(scene)
        self.name = law.name

    @property
    def reads(self) -> Reads:
        """What the source reads."""
        return self.source.reads

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare law and source for new episodes."""
        self.source.begin(env.num_envs)
        self.law.begin(env.num_envs)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the law's action, clipped."""
        action = np.clip(self.law.action(*self.source.read(observation, info)), -1.0, 1.0)
        self.source.send(action)
        return action
