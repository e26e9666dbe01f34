"""Semi-active dampers: the command towards a wanted force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from agents.controllers.actuators import Command
from agents.controllers.controller import require_number
from agents.controllers.spring_force import middle

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

Switching: TypeAlias = Literal["on-off", "continuous"]

SWITCHINGS: tuple[Switching, ...] = get_args(Switching)
"""Ways in which a semi-active damper follows a wanted force."""


class Damper:
    """A semi-active damper as a device for a wanted force.

    Its force is c r, against the relative velocity r of its ends: v2 - v1 of the interface's
    damper, v1 of the carriage's. The force on the carriage is +c r and on the sphere -c r, or -c r
    on the carriage. It only takes energy out, so a wanted force of the other sign than r gets the
    least damping.

    Parameters
    ----------
    scene
        A scene with an actuated damping.
    switching
        "continuous" has the damping whose force is nearest to the wanted one, c = F / r within the
        limits. "on-off" has one damping wherever F and r agree in sign.
    on
        That one [N s/m]; by default the greatest.

    Raises
    ------
    DesignError
        If no damping is actuated, or `on` is beyond its limits.
    """

    def __init__(self, scene: Scene, switching: Switching, on: float | None = None) -> None:
        self.command, self.is_on_off = Command(scene, "damping"), switching == "on-off"
        self.on = self.command.high if on is None else on
        require_number("on", self.on, self.command.low, self.command.high)
        self.present = self.command.present
        self.of_interface = scene.actuation.damped == "interface.damping"

    def velocity(self, state: Values) -> Values:
        """Return the relative velocities (lanes,) [m/s] of the damper's ends."""
        return state[:, 3] - state[:, 2] if self.of_interface else state[:, 2]

    def stroke(self, state: Values) -> Values:
        """Return the relative displacements (lanes,) [m] of the damper's ends."""
        return state[:, 1] - state[:, 0] if self.of_interface else state[:, 0]

    def towards(self, force: Values, velocity: Values, present: Values) -> Values:
        """Return actions (lanes, 1) towards forces (lanes,) [N], positive as the velocities are."""
        low, high = self.command.low, self.command.high
        agree = force * velocity > 0.0
        wanted = np.where(agree, self.on, low)
        if not self.is_on_off:
            ratio = np.divide(force, velocity, out=np.full_like(force, low), where=agree)
            wanted = np.clip(ratio, low, high)
        return self.command(wanted, present)


class MagnetorheologicalDamper:
    """A magnetorheological damper as a device for a wanted force, by its voltage.

    Its states y and z are not observed. Its force f is taken to be that of (4c) of docs/model.md at
    a z that has settled, with the spring k0 relaxed: slow slip all goes into c1, as in the linear
    plant; faster slip shears the hysteresis at its yield, z = sqrt(A / (gamma + beta)).

    Parameters
    ----------
    scene
        A scene with an actuated voltage. Of parameters that are drawn the middle is known.

    Raises
    ------
    DesignError
        If no voltage is actuated.
    """

    def __init__(self, scene: Scene) -> None:
        self.command = Command(scene, "voltage")
        self.present = self.command.present
        interface = scene.interface
        assert interface.kind == "magnetorheological"  # noqa: S101 - as the scene demands
        self.values = {
            name: middle(scene, f"interface.{name}")
            for name in type(interface).model_fields
            if name != "kind"
        }
        bend = self.values["gamma"] + self.values["beta"]  # 0: never yields
        self.bound = np.sqrt(self.values["gain"] / max(bend, np.finfo(np.float64).tiny))

    def force(self, state: Values, voltage: Values) -> Values:
        """Return the forces f (lanes,) [N] on the carriage at voltages (lanes,) [V]."""
        offset, slip = state[:, 1] - state[:, 0], state[:, 3] - state[:, 2]
        parallel, series, hysteresis = (
            self.values[name] + self.values[f"{name}_per_volt"] * voltage
            for name in ("damping", "series_damping", "hysteresis")
        )
        yielded = (hysteresis * self.bound + parallel * np.abs(slip)) / (parallel + series)
        flow = np.sign(slip) * np.minimum(np.abs(slip), yielded)
        pressed = offset - self.values["accumulator_offset"]
        return series * flow + self.values["accumulator_stiffness"] * pressed

    def towards(self, force: Values, state: Values, present: Values) -> Values:
        """Return actions (lanes, 1) towards forces (lanes,) [N] on the carriage.

        The voltage is the greatest where the damper's force has the sign of the wanted one and is
        the smaller of the two, else the least.
        """
        given = self.force(state, present)
        more = (force - given) * given > 0.0
        return self.command(np.where(more, self.command.high, self.command.low), present)
