"""The phase law: an absorber that tunes itself, slowly, by its phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import require_number
from agents.controllers.stretch_command import StretchCommand, require_stable_rest

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class PhaseLaw:
    """Tune an absorber by its phase: the rate of stretch is proportional to x1 (x2 - x1).

    A tuned absorber moves a quarter period behind the carriage, so the mean of x1 times offset
    vanishes. Below resonance of the absorber the mean is positive and the springs should soften
    (stretch more); above, stiffen. Nagarajaiah, *Adaptive passive, semiactive, smart tuned mass
    dampers*, Struct. Control Health Monit. 16 (2009).

    Raises `DesignError` if the carriage is unstable at rest.
    """

    def __init__(self, scene: Scene, gain: float = 1.0) -> None:
        require_stable_rest(scene, "phase law")
        require_number("gain", gain, low=-np.finfo(np.float64).max)
        self.name = f"phase law, gain {gain:.2g}"
        self.gain = gain
        self.command = StretchCommand(scene)
        self.unit = scene.objective.displacement_scale * scene.objective.stroke_scale
        rate = self.command.actuator.rate_limit
        self.stroke = self.command.time_step * rate if rate is not None else np.inf

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action of the law, saturated at the actuator's rate."""
        x1, x2 = state[:, 0], state[:, 1]
        present = applied[:, -1]
        unsaturated = self.gain * self.command.time_step * x1 * (x2 - x1) / self.unit
        return self.command(present + np.clip(unsaturated, -self.stroke, self.stroke), present)
