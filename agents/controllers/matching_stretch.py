"""The matching stretch: an absorber tuned to a force whose frequency is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agents.controllers.stretch_command import StretchCommand, require_stable_rest
from mm_gym.analysis import stretch_for_stiffness

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads, Values
    from mm_gym import MovingMassVectorEnv, Scene

FREQUENCY = "excitation.0.frequency"
"""The field that the law knows and an agent does not."""


class MatchingStretch:
    """Hold the stretch at which the sphere resonates with a known harmonic force.

    Its stiffness is k2 = m2 w^2. Den Hartog, *Mechanical Vibrations* (1956), section 3.2: at that
    frequency an undamped absorber stills the carriage.

    Raises `DesignError` if the carriage is unstable at rest.
    """

    name = "matching stretch (knows the frequency)"
    reads: Reads = "episode"

    def __init__(self, scene: Scene) -> None:
        require_stable_rest(scene, "matching stretch")
        self.command = StretchCommand(scene)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Compute each lane's stretch from its frequency."""
        k2 = env.drawn("sphere.mass") * env.drawn(FREQUENCY) ** 2
        self.stretch = stretch_for_stiffness(k2, env.drawn("springs.stiffness"))

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the action towards the matching stretch."""
        return self.command(self.stretch, info["applied"][:, -1])
