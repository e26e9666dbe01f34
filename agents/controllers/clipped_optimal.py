"""Clipped-optimal control: a damper that gives what it can of a regulator's force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import require_number
from agents.controllers.damping_command import MagnetorheologicalDamper
from agents.controllers.lqr import design
from agents.controllers.semi_active import SemiActive

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from agents.controllers.damping_command import Switching
    from mm_gym import Scene


class ClippedOptimal(SemiActive):
    """Follow the force of an LQR of the plant that has an actuator in the damper's place.

    The damper is taken out, and a force acts between carriage and sphere, or on the carriage; F is
    the force of that regulator (`lqr.design`), whose cost is the scene's. On an estimated state,
    which `Feedback` has by default, it is the LQG's. Dyke, Spencer, Sain and Carlson, *Modeling and
    control of magnetorheological dampers for seismic response reduction*, Smart Materials and
    Structures 5 (1996), doi:10.1088/0964-1726/5/5/006; there the damper is on or off.

    Parameters
    ----------
    scene
        A scene with an actuated damping.
    switching, on
        How the damper follows F, see `Damper`.
    price
        Of the force over carriage.stiffness * objective.displacement_scale, squared [-].

    Raises
    ------
    DesignError
        If no damping is actuated, or as for `lqr.design`.
    """

    def __init__(
        self, scene: Scene, switching: Switching, price: float, *, on: float | None = None
    ) -> None:
        super().__init__(scene, switching, on)
        require_number("price", price, np.finfo(np.float64).tiny)
        self.name = self._called("clipped-optimal", f"price {price:.2g}")
        if self.device.is_on_off:
            self.name += f", price {price:.2g}"
        self.design = design(regulated(scene, price))
        # Positive u accelerates the carriage: so does the interface's damper where v2 > v1.
        self.sign = -1.0 if self.device.of_interface else 1.0

    def force(self, state: Values) -> Values:
        """Return the wanted forces F (lanes,) [N]."""
        return self.sign * (state[:, self.design.states] @ self.design.gain[0])


class ClippedVoltage:
    """Follow the force of an LQR by the voltage of a magnetorheological damper.

    v = maximum where (F - f) f > 0, else minimum, with the damper's force f and the force F that
    the LQR of the plant with a force between the masses in its place wants, as `ClippedOptimal`.
    Dyke, Spencer, Sain and Carlson (1996), cited there, who measure f; here it is computed from
    the state and the present voltage, see `MagnetorheologicalDamper`.

    Parameters
    ----------
    scene
        A scene with an actuated voltage.
    price
        Of the force over carriage.stiffness * objective.displacement_scale, squared [-].

    Raises
    ------
    DesignError
        If no voltage is actuated, or as for `lqr.design`.
    """

    def __init__(self, scene: Scene, price: float) -> None:
        self.device = MagnetorheologicalDamper(scene)
        require_number("price", price, np.finfo(np.float64).tiny)
        self.name = f"clipped-optimal, on-off, price {price:.2g}"
        self.design = design(regulated(scene, price))

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the regulator's force."""
        force = -state[:, self.design.states] @ self.design.gain[0]
        return self.device.towards(force, state, self.device.present(applied))


def regulated(scene: Scene, price: float) -> Scene:
    """Return the scene with a force in place of the damper that is actuated.

    Parameters
    ----------
    scene
        A scene with an actuated damping or voltage.
    price
        Of the force over carriage.stiffness * objective.displacement_scale, squared [-].
    """
    damped = str(scene.actuation.damped)
    is_voltage = scene.actuation.voltage is not None
    out = "interface." if is_voltage else damped
    drawn = {name: ends for name, ends in scene.randomization.items() if not name.startswith(out)}
    unit = scene.carriage.stiffness * scene.objective.displacement_scale
    between = "ground" if damped == "carriage.damping" else "masses"
    without: dict[str, object] = {"interface": {"kind": "none"}} if is_voltage else {damped: 0.0}
    return scene.replace(
        **{
            "actuation.damping": None,
            "actuation.voltage": None,
            "actuation.force": {"limit": unit, "between": between},
            "objective.effort_weight": price,
            "randomization": drawn,
            "sensors": {},
            **without,
        }
    )
