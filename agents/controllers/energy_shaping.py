"""Energy shaping: a force between the masses that replaces the springs, and takes energy out."""

import numpy as np

from agents.control.controller import Acted, Law, Memory
from agents.control.feedback import Feedback
from agents.control.scene import (
    natural_frequency,
    nominal,
    require_actuator,
    require_number,
    sphere_springs,
)
from agents.controllers.registry import Entry
from agents.controllers.searched import searched_pair
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

RATIOS = np.linspace(0.3, 1.7, 15)
"""Frequencies of a sphere over that of the carriage on its spring that are tried."""


class EnergyShaping(Law):
    """Give the sphere another potential energy, and damp its motion relative to the carriage.

    u = k e - s(e) + g w on the carriage, -u on the sphere, with relative displacement e = x2 - x1,
    slip velocity w = v2 - v1 and the springs' force s. The energy of the motion with k e^2 / 2 in
    place of the springs' then only falls: by g w^2, and by what interface and carriage dissipate,
    while the force stays within its limit. All are relative displacements and velocities, so the
    ground may move. Jankovic, Fontaine and Kokotovic, *TORA example: cascade- and passivity-based
    control designs*, IEEE Trans. Control Syst. Technol. 4 (1996). Stiffness k [N/m] and gain g [N
    s/m] are at least 0. Raise `DesignError` if there is no force, it acts against the ground or is
    commanded by its rate.
    """

    def __init__(self, scene: Scene, stiffness: float, gain: float) -> None:
        require_actuator(scene, "force")
        actuator = scene.actuation.force
        assert actuator is not None  # noqa: S101 - as required
        wanted = {"between": "masses", "command": "position"}
        for field, value in wanted.items():
            if getattr(actuator, field) != value:
                msg = (
                    f"actuation.force.{field}: got {getattr(actuator, field)!r}; allowed for "
                    f"energy shaping: {value!r}"
                )
                raise DesignError(msg)
        require_number("stiffness", stiffness)
        require_number("gain", gain)
        self.name = f"energy shaping, {stiffness:.3g} N/m and {gain:.2g} N s/m"
        self.springs, self.limit = sphere_springs(scene), actuator.limit
        self.stiffness, self.gain = stiffness, gain

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        offset, slip = state[:, 1] - state[:, 0], state[:, 3] - state[:, 2]
        force = self.stiffness * offset - self.springs(offset) + self.gain * slip
        return np.clip(force / self.limit, -1.0, 1.0)[:, None], memory


def _best(scene: Scene) -> Feedback:
    """Search the frequency of the sphere and the damping of the slip, over four decades."""
    own, m2 = natural_frequency(scene), nominal(scene, "sphere.mass")

    def make(ratio: float, damping: float) -> EnergyShaping:
        rate = ratio * own
        return EnergyShaping(scene, m2 * rate**2, damping * m2 * rate)

    return searched_pair(scene, make, RATIOS)


def _refused(scene: Scene) -> str | None:
    if not scene.actuation.is_between:
        return "which is for a force between the masses, and this one acts against the ground"
    if scene.carriage.mass == 0.0:
        return "which tries frequencies near that of the carriage; carriage.mass: got 0"
    return None


ENTRIES = (Entry("energy-shaping", ("force",), _best, 12, refuses=_refused),)
