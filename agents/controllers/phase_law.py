"""The phase law: an absorber that tunes itself, slowly, by its phase."""

import numpy as np

from agents.control.actuators import Command, require_stable_rest
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import pace, require_number
from agents.controllers.registry import Entry
from agents.controllers.searched import over_decades
from mm_gym import Scene
from mm_gym.arrays import Array


class PhaseLaw(Law):
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
        self.gain, self.time_step = gain, scene.control.time_step
        self.command = Command(scene, "stretch")
        self.unit = scene.objective.displacement_scale * scene.objective.stroke_scale

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        x1, x2 = state[:, 0], state[:, 1]
        present = self.command.present(applied)
        unsaturated = self.gain * self.time_step * x1 * (x2 - x1) / self.unit
        travel = self.command.travel
        return self.command(present + np.clip(unsaturated, -travel, travel), present), memory


best_phase_law = over_decades(lambda scene, ratio: PhaseLaw(scene, ratio * pace(scene)))

ENTRIES = (Entry("phase-law", ("stretch",), best_phase_law, 20),)
