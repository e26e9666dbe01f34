"""On-off stiffness: the springs stiff where that lowers a Lyapunov function, soft elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np

from agents.controllers.lead import Lead
from agents.controllers.lqr import state_weight
from agents.controllers.stretch_command import StretchCommand, require_stable_rest
from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class OnOffStiffness:
    """Minimise the rate of x' P x over the reachable stiffness, which is always at one of its ends.

    P solves A' P + P A + Q = 0 for the plant at one stretch and the reward's weight Q, so x' P x
    is the cost to go of that passive plant, and each choice lowers it. Onoda, Endo, Tamaoki and
    Watanabe, *Vibration suppression by variable-stiffness members*, AIAA J. 29 (1991); Leitmann,
    *Semiactive control for vibration attenuation*, Journal of Intelligent Material Systems and
    Structures 5 (1994).

    Raises
    ------
    DesignError
        If the passive plant is not stable.
    """

    def __init__(self, scene: Scene, stretch: float) -> None:
        require_stable_rest(scene, "on-off stiffness")
        self.name = f"on-off stiffness about {stretch:.2f}"
        self.command, self.lead = StretchCommand(scene), Lead(scene)
        a, _ = compile_scene(scene).linear(stretch)
        if not np.linalg.eigvals(a).real.max() < 0.0:
            msg = f"the plant at a stretch of {stretch:g} is not stable: it has no cost to go"
            raise DesignError(msg)
        p = np.asarray(control.lyap(a.T, state_weight(scene), method="scipy"))
        # The springs' force on carriage and sphere, per unit of k2 (x2 - x1).
        internal = np.array([0.0, 0.0, 1.0 / scene.carriage.mass, -1.0 / scene.sphere.mass])
        self.costate = p @ internal

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the stiff or the soft end."""
        present = applied[:, -1]
        state = self.lead(state, present)
        actuator = self.command.actuator
        raises = (state @ self.costate) * (state[:, 1] - state[:, 0]) > 0.0
        return self.command(np.where(raises, actuator.maximum, actuator.minimum), present)
