"""Skyhook, groundhook and balance: laws of a damper whose coefficient is controlled."""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Literal, TypeAlias, get_args

import numpy as np

from agents.control.actuators import SWITCHINGS, Damper, Lead, Switching
from agents.control.controller import Acted, Law, Memory, joined, part
from agents.control.feedback import Feedback
from agents.control.model import Innovation, force_column, state_scales
from agents.control.scene import (
    STATES,
    natural_frequency,
    nominal,
    plant_of,
    require_number,
    sphere_springs,
)
from agents.controllers.registry import Entry
from agents.controllers.searched import grid, over_decades, searched
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

Hooked: TypeAlias = Literal["skyhook", "groundhook", "displacement groundhook"]

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
        self.kept = float(np.exp(-CORNER * natural_frequency(scene) * self.step))

    def begin(self, lanes: int) -> Memory:
        return {**joined(innovation=self.innovation.begin(lanes)), "velocity": np.zeros(lanes)}

    def observe(self, memory: Memory, state: Array, applied: Array) -> Memory:
        """Return the memory, whose "velocity" (lanes,) [m/s] is that now; call it at each step."""
        missed, _, own = self.innovation.missed(part(memory, "innovation"), state, applied)
        velocity = self.kept * memory["velocity"] + self.step * (missed @ self.row)
        return {**joined(innovation=own), "velocity": velocity}


class SemiActive(Law):
    """A law that wants a force F of a damper, which gives what it can of it (`Damper`).

    The device's lag and rate limit are met by the state ahead, see `Lead`.
    """

    name = "semi-active damper"

    def __init__(self, scene: Scene, switching: Switching, on: float | None = None) -> None:
        self.device, self.lead = Damper(scene, switching, on), Lead(scene, "damping")

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        present = self.device.present(applied)
        ahead = self.lead(state, present)
        wanted, velocity = self.force(memory, ahead), self.device.velocity(ahead)
        return self.device.towards(wanted, velocity, present), memory

    @abstractmethod
    def force(self, memory: Memory, state: Array) -> Array:
        """Return the wanted forces F (lanes,) [N], positive as the device's relative velocity."""

    def _called(self, what: str, gain: str) -> str:
        value = f"on {self.device.on:.3g} N s/m" if self.device.is_on_off else gain
        return f"{what}, {'on-off' if self.device.is_on_off else 'continuous'}, {value}"


class Hook(SemiActive):
    """The force of a damper that is not there, from a mass to the sky or to the ground.

    Skyhook (Karnopp, Crosby and Harwood, *Vibration control using semi-active force generators*,
    J. Eng. Ind. 96 (1974), doi:10.1115/1.3438373), with the velocity v_g of the ground::

        F = gain (v2 + v_g), where (v2 + v_g) (v2 - v1) > 0  the interface's damper holds the sphere
        F = gain (v1 + v_g), where v1 (v1 + v_g) > 0         the carriage's holds the carriage

    The engine's velocities are relative to the ground; v_g comes from a `GroundVelocity`, and is 0
    where the ground rests.

    Groundhook (Valášek, Novák, Šika and Vaculín, *Extended ground-hook*, Veh. Syst. Dyn. 27
    (1997), doi:10.1080/00423119708969333): the interface's damper holds the carriage, whose
    velocity is relative to the ground. On displacement, for semi-active absorbers: Koo, Ahmadian,
    Setareh and Murray, *In search of suitable control methods for semi-active tuned vibration
    absorbers*, J. Vib. Control 10 (2004)::

        F = -gain v1, where v1 (v2 - v1) < 0           groundhook
        F = -gain x1, where x1 (v2 - v1) < 0           displacement groundhook

    The gain, [N s/m], on displacement [N/m], has no effect on an on-off damper. Raise `DesignError`
    if no damping is actuated; if it is the carriage's, and the law is a groundhook, or the ground
    rests: then the carriage's damper is itself what the law imitates.
    """

    def __init__(
        self,
        scene: Scene,
        what: Hooked,
        switching: Switching,
        *,
        on: float | None = None,
        gain: float = 1.0,
    ) -> None:
        super().__init__(scene, switching, on)
        require_number("gain", gain)
        moves = any(part.target == "ground" for part in scene.excitation)
        if not self.device.of_interface and not (what == "skyhook" and moves):
            msg = (
                f"actuation.damping.of: got 'carriage'; allowed for a {what}"
                f"{' while the ground rests' if what == 'skyhook' else ''}: 'interface'; the "
                "carriage's damper already stands on the ground, so a constant damping is best"
            )
            raise DesignError(msg)
        self.what, self.gain = what, gain
        self.ground = GroundVelocity(scene) if what == "skyhook" and moves else None
        unit = "N/m" if what == "displacement groundhook" else "N s/m"
        self.name = self._called(what, f"gain {gain:.3g} {unit}")

    def begin(self, lanes: int) -> Memory:
        return {} if self.ground is None else self.ground.begin(lanes)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        if self.ground is not None:
            memory = self.ground.observe(memory, state, applied)
        return super().action(memory, state, applied)

    def force(self, memory: Memory, state: Array) -> Array:
        if self.what == "skyhook":
            held = state[:, 3 if self.device.of_interface else 2]
            return self.gain * (held if self.ground is None else held + memory["velocity"])
        return -self.gain * state[:, 2 if self.what == "groundhook" else 0]


class Balance(SemiActive):
    """Balance the spring in parallel with the damper, where the two forces are opposed.

    F = -gain s, with the spring's force s at the relative displacement e of the damper's ends: it
    acts while e shrinks, e r < 0, and with a gain of 1 the mass that spring and damper move does
    not feel either. Displacements are relative to the ground by nature, so it may move. On or off:
    Rakheja and Sankar, *Vibration and shock isolation performance of a semi-active "on-off"
    damper*, J. Vib. Acoust. 107 (1985); continuous: Alanoly and Sankar, *A new concept in
    semi-active vibration isolation*, J. Mech. Trans. Autom. Des. 109 (1987). The gain [-] has no
    effect on an on-off damper. Raise `DesignError` if no damping is actuated, or it is the
    interface's and there are no springs in parallel.
    """

    def __init__(
        self, scene: Scene, switching: Switching, *, on: float | None = None, gain: float = 1.0
    ) -> None:
        super().__init__(scene, switching, on)
        require_number("gain", gain)
        if self.device.of_interface and scene.springs.kind == "none":
            msg = "springs.kind: got 'none'; allowed for the balance: springs in parallel"
            raise DesignError(msg)
        self.gain, self.springs = gain, sphere_springs(scene)
        self.carriage = (
            nominal(scene, "carriage.stiffness"),
            nominal(scene, "carriage.linear_coefficient"),
            nominal(scene, "carriage.cubic_coefficient"),
        )
        self.name = self._called("balance", f"gain {gain:.3g}")

    def force(self, memory: Memory, state: Array) -> Array:
        stroke = self.device.stroke(state)
        if self.device.of_interface:
            return -self.gain * self.springs(stroke)
        stiffness, linear, cubic = self.carriage
        return -self.gain * stiffness * (linear + cubic * stroke**2) * stroke


def best(what: Hooked | Literal["balance"], switching: Switching) -> Callable[[Scene], Feedback]:
    """Return what searches the damping of an on-off law, or the gain of a continuous one."""
    make = Balance if what == "balance" else partial(Hook, what=what)

    def followed(scene: Scene, ratio: float) -> Law:
        k1, m1 = nominal(scene, "carriage.stiffness"), nominal(scene, "carriage.mass")
        units = {"balance": 1.0, "displacement groundhook": k1}
        gain = units.get(what, 2.0 * np.sqrt(k1 * m1)) * ratio
        return make(scene, switching=switching, gain=gain)

    if switching == "continuous":
        return over_decades(followed)
    return lambda scene: searched(
        scene, lambda on: make(scene, switching=switching, on=on), grid(scene, "damping")[2::2]
    )


def damper_entry(
    what: str, switching: Switching, make: Callable[[Scene], Feedback], order: int
) -> Entry:
    """Return the entry of a law of a damping, on-off before continuous."""
    order += 5 * (switching == "continuous")
    name, label = f"{what.replace(' ', '-')}-{switching}", f"{what}, {switching}"
    return Entry(name, ("damping",), make, order, label=label)


ENTRIES = tuple(
    damper_entry(what, switching, best(what, switching), 40 + k)
    for switching in SWITCHINGS
    for k, what in enumerate([*get_args(Hooked), "balance"])
)
