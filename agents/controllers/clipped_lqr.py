"""The clipped LQR: springs whose stiffness is switched to give a regulator's force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control
import numpy as np

from agents.controllers.controller import FULL_STATE
from agents.controllers.lqr import state_weight
from agents.controllers.stretch_command import StretchCommand
from mm_gym import compile_scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene


class ClippedLQR:
    """Choose the stiffness whose force is closest to that of an actuator in the springs' place.

    A regulator is designed for the internal force between carriage and sphere about one stretch;
    the springs give its force F with k2 = k2(stretch) + F / (x2 - x1), as far as their range goes;
    a small price makes that on-off stiffness. Dyke et al., *Modeling and control of
    magnetorheological dampers for seismic response reduction*, Smart Materials and Structures 5
    (1996).

    Parameters
    ----------
    price
        of the internal force over carriage.stiffness * objective.displacement_scale, squared [-].
    """

    reads = FULL_STATE

    def __init__(self, scene: Scene, stretch: float, price: float) -> None:
        self.name = f"clipped LQR about {stretch:.2f}, price {price:.2g}"
        self.command = StretchCommand(scene)
        self.stiffness = scene.springs.stiffness
        self.k2 = spring_stiffness(stretch, self.stiffness)
        unit = scene.carriage.stiffness * scene.objective.displacement_scale
        internal = np.array([[0.0], [0.0], [1.0 / scene.carriage.mass], [-1.0 / scene.sphere.mass]])
        a, _ = compile_scene(scene).linear(stretch)
        gain, _, _ = control.lqr(a, internal, state_weight(scene), [[price / unit**2]])
        self.gain = np.asarray(gain)[0]

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the action towards the stretch of the wanted stiffness."""
        state = info["state"]
        offset = state[:, 1] - state[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            k2 = self.k2 - np.nan_to_num(state @ self.gain / offset)
        wanted = stretch_for_stiffness(k2, self.stiffness)
        return self.command(wanted, info["applied"][:, -1])
