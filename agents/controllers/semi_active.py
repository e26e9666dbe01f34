"""Skyhook, groundhook and balance: laws of a damper whose coefficient is controlled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from agents.controllers.controller import require_number
from agents.controllers.damping_command import Damper
from agents.controllers.ground_velocity import GroundVelocity
from agents.controllers.lead import Lead
from agents.controllers.spring_force import middle, sphere_springs
from mm_gym import DesignError

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from agents.controllers.damping_command import Switching
    from mm_gym import Scene

Hooked: TypeAlias = Literal["skyhook", "groundhook", "displacement groundhook"]


class SemiActive:
    """A law that wants a force F of a damper, which gives what it can of it (`Damper`).

    The device's lag and rate limit are met by the state ahead, see `Lead`.

    Parameters
    ----------
    scene
        A scene with an actuated damping.
    switching, on
        How the damper follows F, see `Damper`.

    Attributes
    ----------
    remembers
        Whether an action depends on more than the present state.
    """

    name = "semi-active damper"
    remembers = False

    def __init__(self, scene: Scene, switching: Switching, on: float | None = None) -> None:
        self.device, self.lead = Damper(scene, switching, on), Lead(scene, "damping")

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the wanted force."""
        present = self.device.present(applied)
        ahead = self.lead(state, present)
        return self.device.towards(self.force(ahead), self.device.velocity(ahead), present)

    def force(self, state: Values) -> Values:
        """Return the wanted forces F (lanes,) [N], positive as the device's relative velocity."""
        raise NotImplementedError

    def _called(self, what: str, gain: str) -> str:
        value = f"on {self.device.on:.3g} N s/m" if self.device.is_on_off else gain
        return f"{what}, {'on-off' if self.device.is_on_off else 'continuous'}, {value}"


class Hook(SemiActive):
    """The force of a damper that is not there, from a mass to the sky or to the ground.

    Skyhook (Karnopp, Crosby and Harwood, *Vibration control using semi-active force generators*,
    J. Eng. Ind. 96 (1974), doi:10.1115/1.3438373), with the velocity v_g of the ground::

        F = gain (v2 + v_g), where v2 (v2 - v1) > 0    the interface's damper holds the sphere
        F = gain (v1 + v_g), where v1 (v1 + v_g) > 0   the carriage's damper holds the carriage

    The engine's velocities are relative to the ground; v_g comes from a `GroundVelocity`, and is 0
    where the ground rests.

    Groundhook (Valášek, Novák, Šika and Vaculín, *Extended ground-hook*, Veh. Syst. Dyn. 27
    (1997), doi:10.1080/00423119708969333): the interface's damper holds the carriage, whose
    velocity is relative to the ground. On displacement, for semi-active absorbers: Koo, Ahmadian,
    Setareh and Murray, *In search of suitable control methods for semi-active tuned vibration
    absorbers*, J. Vib. Control 10 (2004)::

        F = -gain v1, where v1 (v2 - v1) < 0           groundhook
        F = -gain x1, where x1 (v2 - v1) < 0           displacement groundhook

    Parameters
    ----------
    scene
        A scene with an actuated damping.
    what
        Which of them.
    switching, on
        How the damper follows F, see `Damper`.
    gain
        [N s/m], on displacement [N/m]; without effect on an on-off damper.

    Raises
    ------
    DesignError
        If no damping is actuated; if it is the carriage's, and the law is a groundhook, or the
        ground rests: then the carriage's damper is itself what the law imitates.
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
                "carriage's damper is one to the ground already, and a constant damping is best"
            )
            raise DesignError(msg)
        self.what, self.gain = what, gain
        self.ground = GroundVelocity(scene) if what == "skyhook" and moves else None
        self.remembers = self.ground is not None
        unit = "N/m" if what == "displacement groundhook" else "N s/m"
        self.name = self._called(what, f"gain {gain:.3g} {unit}")

    def begin(self, lanes: int) -> None:
        """Begin with a ground at rest."""
        if self.ground is not None:
            self.ground.begin(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the wanted force."""
        if self.ground is not None:
            self.ground.observe(state, applied)
        return super().action(state, applied)

    def force(self, state: Values) -> Values:
        """Return the wanted forces F (lanes,) [N]."""
        if self.what == "skyhook":
            held = state[:, 3 if self.device.of_interface else 2]
            return self.gain * (held if self.ground is None else held + self.ground.velocity)
        return -self.gain * state[:, 2 if self.what == "groundhook" else 0]


class Balance(SemiActive):
    """Balance the spring in parallel with the damper, where the two forces are opposed.

    F = -gain s, with the spring's force s at the relative displacement e of the damper's ends: it
    acts while e shrinks, e r < 0, and with a gain of 1 the mass that spring and damper move does
    not feel either. Displacements are relative to the ground by nature, so it may move. On or off:
    Rakheja and Sankar, *Vibration and shock isolation performance of a semi-active "on-off"
    damper*, J. Vib. Acoust. 107 (1985); continuous: Alanoly and Sankar, *A new concept in
    semi-active vibration isolation*, J. Mech. Trans. Autom. Des. 109 (1987).

    Parameters
    ----------
    scene
        A scene with an actuated damping.
    switching, on
        How the damper follows F, see `Damper`.
    gain
        [-]; without effect on an on-off damper.

    Raises
    ------
    DesignError
        If no damping is actuated, or it is the interface's and there are no springs in parallel.
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
            middle(scene, "carriage.stiffness"),
            middle(scene, "carriage.linear_coefficient"),
            middle(scene, "carriage.cubic_coefficient"),
        )
        self.name = self._called("balance", f"gain {gain:.3g}")

    def force(self, state: Values) -> Values:
        """Return the wanted forces F (lanes,) [N]."""
        stroke = self.device.stroke(state)
        if self.device.of_interface:
            return -self.gain * self.springs(stroke)
        stiffness, linear, cubic = self.carriage
        return -self.gain * stiffness * (linear + cubic * stroke**2) * stroke
