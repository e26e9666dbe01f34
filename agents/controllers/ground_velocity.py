"""The velocity of the ground, from how the motion differs from that over a ground at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import joined, part, plant_of
from agents.controllers.disturbance import force_column, state_scales
from agents.controllers.lqr import STATES
from agents.controllers.model import Innovation

if TYPE_CHECKING:
    from agents.controllers.controller import Memory, Values
    from mm_gym import Scene

CORNER = 0.1
"""Angular frequency below which the velocity is left out, over that of the carriage on its spring.

An acceleration's mean drifts away when it is integrated.
"""


class GroundVelocity:
    """Integrate the ground's acceleration, as an accelerometer's signal is in a real skyhook.

    The acceleration that a control step had is the one that explains best how the state differs
    from the model's prediction, in units of the objective's scales; a force on the carriage is told
    apart from it where the scene has both. The integral forgets what is slower than `CORNER`.
    """

    def __init__(self, scene: Scene) -> None:
        self.innovation, self.step = Innovation(scene), scene.control.time_step
        system = plant_of(scene).state_space(["ground"], STATES, sampled=True)
        units = state_scales(scene)
        causes = [system.B[:4, 0] / units]
        if any(part.target == "force" for part in scene.excitation):
            causes.append(force_column(scene) / units)
        self.row = np.linalg.pinv(np.stack(causes, axis=1))[0] / units
        carriage = scene.carriage
        self.kept = float(np.exp(-CORNER * np.sqrt(carriage.stiffness / carriage.mass) * self.step))

    def begin(self, lanes: int) -> Memory:
        """Begin with a ground at rest."""
        return {**joined(innovation=self.innovation.begin(lanes)), "velocity": np.zeros(lanes)}

    def observe(self, memory: Memory, state: Values, applied: Values) -> Memory:
        """Return the memory, in which "velocity" (lanes,) [m/s] is that now; call it at each step.

        Parameters
        ----------
        memory
            Of the step before.
        state
            (lanes, 4) x1, x2 [m], v1, v2 [m/s] now, relative to the ground.
        applied
            (lanes, k) what the actuators had in the step that led to it.
        """
        missed, _, own = self.innovation.missed(part(memory, "innovation"), state, applied)
        velocity = self.kept * memory["velocity"] + self.step * (missed @ self.row)
        return {**joined(innovation=own), "velocity": velocity}
