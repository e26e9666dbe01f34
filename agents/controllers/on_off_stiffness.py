"""On-off stiffness: the springs stiff where that lowers a Lyapunov function, soft elsewhere."""

from functools import partial

import control
import numpy as np

from agents.control.actuators import Command, Lead, require_stable_rest
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import internal_force, plant_of
from agents.controllers.lqr import state_weight
from agents.controllers.registry import Entry
from agents.controllers.searched import grid, searched
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array


class OnOffStiffness(Law):
    """Minimise the rate of x' P x over the reachable stiffness, which is always at one of its ends.

    P solves A' P + P A + Q = 0 for the plant at one stretch and the reward's weight Q, so x' P x
    is the cost to go of that passive plant, and each choice lowers it. Onoda, Endo, Tamaoki and
    Watanabe, *Vibration suppression by variable-stiffness members*, AIAA J. 29 (1991); Leitmann,
    *Semiactive control for vibration attenuation*, Journal of Intelligent Material Systems and
    Structures 5 (1994).

    Raise `DesignError` if the passive plant is not stable.
    """

    def __init__(self, scene: Scene, stretch: float) -> None:
        require_stable_rest(scene, "on-off stiffness")
        self.name = f"on-off stiffness about {stretch:.2f}"
        self.command, self.lead = Command(scene, "stretch"), Lead(scene)
        a, _ = plant_of(scene).linear(stretch)
        if not np.linalg.eigvals(a).real.max() < 0.0:
            msg = f"the plant at a stretch of {stretch:g} is not stable: its cost-to-go is infinite"
            raise DesignError(msg)
        p = np.asarray(control.lyap(a.T, state_weight(scene), method="scipy"))
        # The springs' force on carriage and sphere, per unit of k2 (x2 - x1).
        self.costate = p @ internal_force(scene)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        present = self.command.present(applied)
        state = self.lead(state, present)
        raises = (state @ self.costate) * (state[:, 1] - state[:, 0]) > 0.0
        wanted = np.where(raises, self.command.high, self.command.low)
        return self.command(wanted, present), memory


ENTRIES = (
    Entry(
        "on-off-stiffness",
        ("stretch",),
        lambda scene: searched(scene, partial(OnOffStiffness, scene), grid(scene, "stretch")[::4]),
        22,
        label="on-off stiffness",
    ),
)
