"""Clipped-optimal control: a damper that gives what it can of a regulator's force."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from agents.control.actuators import (
    SWITCHINGS,
    Actuators,
    Command,
    Damper,
    Lead,
    MagnetorheologicalDamper,
    Switching,
)
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import STATES, drawn_but, nominal, require_number
from agents.controllers.lqr import design
from agents.controllers.registry import Entry, Free, Tunable, unless
from agents.controllers.searched import over_decades
from agents.controllers.semi_active import SemiActive, damper_entry
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

WEIGHTS = np.linspace(-4.0, 2.0, 13)  # exponents of the weights that are tried


class ClippedOptimal(SemiActive):
    """Follow the force of an LQR of the plant that has an actuator in the damper's place.

    The damper is taken out, and a force acts between carriage and sphere, or on the carriage; F is
    the force of that regulator (`lqr.design`), whose cost is the scene's. On an estimated state,
    which `Feedback` has by default, it is the LQG's. Dyke, Spencer, Sain and Carlson, *Modeling and
    control of magnetorheological dampers for seismic response reduction*, Smart Materials and
    Structures 5 (1996), doi:10.1088/0964-1726/5/5/006; there the damper is on or off. The weight is
    of the force over carriage.stiffness * objective.displacement_scale, squared [-]. Raise
    `DesignError` if no damping is actuated, or as for `lqr.design`.
    """

    def __init__(self, scene: Scene, switching: Switching, weight: float) -> None:
        super().__init__(scene, switching)
        self.name = self._called("clipped-optimal", f"weight {weight:.2g}")
        if self.device.is_on_off:
            self.name += f", weight {weight:.2g}"
        self.design = design(regulated(scene, weight))
        # Positive u accelerates the carriage: so does the interface's damper where v2 > v1.
        self.sign = -1.0 if self.device.of_interface else 1.0

    def force(self, memory: Memory, state: Array) -> Array:
        return self.sign * (state[:, self.design.states] @ self.design.gain[0])


class SharedForce(ClippedOptimal):
    """Give the regulator's force by a damper and, for the rest, by the force in parallel with it.

    u = F - c r between the masses, with the damping c nearest to F / r: the damper gives what it
    can, which needs no power, and the force what is left, within its limit. The weight is of both
    forces together; what `objective.effort_weight` makes a damping cost, which is an action too, is
    left out. Raise `DesignError` if force and damping do not act between the same masses, or
    as for `lqr.design`.
    """

    def __init__(self, scene: Scene, weight: float) -> None:
        if not _in_parallel(scene):
            msg = (
                "actuation.force.between: allowed for a force that is shared with a damper: "
                '"masses", with actuation.damping of the interface; only there do both act in '
                "parallel"
            )
            raise DesignError(msg)
        super().__init__(scene, "continuous", weight)
        self.name = f"clipped-optimal, rest by the force, weight {weight:.2g}"
        self.drive, self.actuators = Command(scene, "force"), Actuators(scene)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        damping, memory = super().action(memory, state, applied)
        actions = np.concatenate([np.zeros_like(damping), damping], 1)
        reached, _ = self.actuators.reached(actions, applied, applied)
        given = self.device.present(reached) * self.device.velocity(state)
        rest = self.force(memory, state) - given
        return np.concatenate([self.drive(rest, self.drive.present(applied)), damping], 1), memory


class ClippedVoltage(Law):
    """Follow the force of an LQR by the voltage of a magnetorheological damper.

    v = maximum where (F - f) f > 0, else minimum, with the damper's force f and the force F that
    the LQR of the plant with a force between the masses in its place wants, as `ClippedOptimal`.
    Dyke, Spencer, Sain and Carlson (1996), cited there, who measure f; here it is computed from the
    state and the present voltage, see `MagnetorheologicalDamper`. Raise `DesignError` if no voltage
    is actuated, or as for `lqr.design`.
    """

    def __init__(self, scene: Scene, weight: float) -> None:
        self.device = MagnetorheologicalDamper(scene)
        self.name = f"clipped-optimal, on-off, weight {weight:.2g}"
        self.design = design(regulated(scene, weight))

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return self.device.towards(self.force(state), state, self.device.present(applied)), memory

    def force(self, state: Array) -> Array:
        return -state[:, self.design.states] @ self.design.gain[0]


def regulated(scene: Scene, weight: float) -> Scene:
    """Return the scene with a force in place of the damper that is actuated.

    The weight is that of `ClippedOptimal`.
    """
    require_number("weight", weight, np.finfo(np.float64).tiny)
    damped = str(scene.actuation.damped)
    is_voltage = scene.actuation.voltage is not None
    out = "interface." if is_voltage else damped
    drawn = drawn_but(scene, out, "sensors.", "actuation.")
    unit = nominal(scene, "carriage.stiffness") * scene.objective.displacement_scale
    between = "ground" if damped == "carriage.damping" else "masses"
    without: dict[str, object] = {"interface": {"kind": "none"}} if is_voltage else {damped: 0.0}
    return scene.replace(
        **{
            "actuation.damping": None,
            "actuation.voltage": None,
            "actuation.force": {"limit": unit, "between": between},
            "objective.effort_weight": weight,
            "randomization": drawn,
            "sensors": {},
            **without,
        }
    )


def free_numbers(scene: Scene, switching: Switching) -> dict[str, Free]:
    """Return the regulator's weight, factors of the lead and of its gains, and of what is on.

    Gains are free because the regulator knows neither what is clipped nor that a damper takes
    energy out alone. What an on-off damper has where it is on is in [N s/m].
    """
    command = Command(scene, "damping")
    numbers = {"weight": Free(0.1), "lead": Free(1.0, 0.3, ratio=False, low=0.0)}
    if switching == "on-off":
        numbers["on"] = Free(command.high, 0.3, low=command.low, high=command.high)
    return numbers | {f"gain_{state}": Free(1.0, 0.3, ratio=False) for state in STATES}


def with_free_gains(
    scene: Scene, numbers: Mapping[str, float], switching: Switching
) -> ClippedOptimal:
    """Return clipped-optimal control of free numbers."""
    law = ClippedOptimal(scene, switching, numbers["weight"])
    law.device = Damper(scene, switching, numbers.get("on"))
    law.lead = Lead(scene, "damping", numbers["lead"])
    factors = np.array([numbers[f"gain_{STATES[k]}"] for k in law.design.states])
    law.design = replace(law.design, gain=law.design.gain * factors)
    law.name = f"clipped-optimal, {switching}, free gains"
    return law


TUNED = {
    switching: Tunable(
        f"tuned-clipped-optimal-{switching}",
        partial(free_numbers, switching=switching),
        partial(with_free_gains, switching=switching),
    )
    for switching in SWITCHINGS
}


def _in_parallel(scene: Scene) -> bool:
    return scene.actuation.is_between and scene.actuation.damped == "interface.damping"


def _switched(switching: Switching, order: int) -> Entry:
    best = over_decades(lambda scene, weight: ClippedOptimal(scene, switching, weight), WEIGHTS)
    return damper_entry("clipped-optimal", switching, best, order)


ENTRIES = (
    *(_switched(switching, 44) for switching in SWITCHINGS),
    *(
        tunable.entry(("damping",), 50, label=f"clipped-optimal, {switching}, free gains")
        for switching, tunable in TUNED.items()
    ),
    Entry(
        "clipped-optimal-and-force",
        ("force", "damping"),
        over_decades(SharedForce, WEIGHTS),
        48,
        refuses=unless(
            _in_parallel, "which is for a force and a damper between the masses, in parallel"
        ),
    ),
    Entry(
        "clipped-optimal-on-off",
        ("voltage",),
        over_decades(ClippedVoltage, WEIGHTS),
        49,
        label="clipped-optimal, on-off",
    ),
)
