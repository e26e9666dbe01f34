"""Laws for springs whose stretch is adjusted: slowly by phase, or within a period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control
import numpy as np

from agents.controllers.controller import StretchCommand, stretch_of
from agents.controllers.lqr import state_weight
from mm_gym import compile_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene


class PhaseLaw:
    """Tune an absorber by its phase: the rate of stretch is proportional to x1 (x2 - x1).

    A tuned absorber moves a quarter period behind the carriage, so the mean of x1 times offset
    vanishes. Below resonance of the absorber the mean is positive and the springs should soften
    (stretch more); above, stiffen. Nagarajaiah, *Adaptive passive, semiactive, smart tuned mass
    dampers*, Struct. Control Health Monit. 16 (2009).
    """

    def __init__(self, scene: Scene, gain: float = 1.0) -> None:
        self.name = f"phase law, gain {gain:.2g}"
        self.gain = gain
        self.command = StretchCommand(scene)
        self.unit = scene.objective.displacement_scale * scene.objective.stroke_scale
        rate = self.command.actuator.rate_limit
        self.stroke = self.command.time_step * rate if rate is not None else np.inf

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the action of the law, saturated at the actuator's rate."""
        x1, x2 = info["state"][:, 0], info["state"][:, 1]
        present = info["applied"][:, -1]
        unsaturated = self.gain * self.command.time_step * x1 * (x2 - x1) / self.unit
        return self.command(present + np.clip(unsaturated, -self.stroke, self.stroke), present)


class ClippedLQR:
    """The stiffness whose force comes closest to that of an actuator between carriage and sphere.

    A regulator is designed for the internal force about one stretch; of its force F the springs
    give k2 = k2(stretch) + F / (x2 - x1), as far as k2 goes; a small price makes that on-off
    stiffness. Dyke et al., *Modeling and control of magnetorheological dampers for seismic
    response reduction*, Smart Materials and Structures 5 (1996).

    Parameters
    ----------
    price
        of the internal force over carriage.stiffness * objective.displacement_scale, squared [-].
    """

    def __init__(self, scene: Scene, stretch: float, price: float) -> None:
        self.name = f"clipped LQR about {stretch:.2f}, price {price:.2g}"
        self.command = StretchCommand(scene)
        self.twice_k0 = 2.0 * scene.springs.stiffness
        self.k2 = self.twice_k0 * (1.0 + 2.0 / stretch**3)
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
        return self.command(
            stretch_of(k2, self.twice_k0, self.command.actuator), info["applied"][:, -1]
        )
