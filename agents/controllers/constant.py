"""Constant control: one action, one force, one stretch, damping or voltage throughout."""

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Controller, Info, Law, Memory, Observation
from agents.control.feedback import Both, Feedback
from agents.control.observed_actuators import ObservedActuators
from agents.control.scene import require_number
from agents.controllers.registry import Entry
from agents.controllers.searched import grid, searched
from agents.scoring import VALIDATION_SEED
from mm_gym import Scene
from mm_gym.arrays import Array

CENTRED = np.linspace(-0.5, 0.5, 17)  # forces over the force limit that are tried

FORMATS = {
    "force": "{:.3f} N",
    "stretch": "{:.3f}",
    "damping": "{:.3g} N s/m",
    "voltage": "{:.3g} V",
}
"""How names tell what is held."""


class ConstantAction(Controller):
    """The same action throughout."""

    def __init__(self, scene: Scene, action: float = 0.0) -> None:
        self.name = "zero action" if action == 0.0 else f"constant action {action:.3f}"
        self.values = np.full(len(scene.actuation.names), action)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        return np.tile(self.values, (len(observation), 1)), memory


class Held(Law):
    """Go to one value and stay; by default stay at the one that the episode begins with.

    Raise `DesignError` if there is no such actuator, or the value is beyond its limits.

    Parameters
    ----------
    actuator
        "force" [N], "stretch" [-], "damping" [N s/m] or "voltage" [V].
    """

    def __init__(self, scene: Scene, actuator: str, value: float | None = None) -> None:
        self.command, self.value = Command(scene, actuator), value
        self.name = f"initial {actuator}"
        if value is not None:
            require_number(actuator, value, self.command.low, self.command.high)
            self.name = f"constant {actuator} {FORMATS[actuator].format(value)}"
        if (actuator, value) == ("force", 0.0):
            self.name = "no force"

    def begin(self, lanes: int) -> Memory:
        if self.value is not None:
            return {}
        return {"begun": np.zeros(lanes, np.bool_), "held": np.zeros(lanes)}

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        present = self.command.present(applied)
        if self.value is not None:
            return self.command(np.full_like(present, self.value), present), memory
        held = np.where(memory["begun"], memory["held"], present)
        return self.command(held, present), {"begun": np.ones_like(memory["begun"]), "held": held}


def device_of(scene: Scene) -> str:
    """Return which actuator a semi-active device has, "damping" or "voltage"."""
    return "damping" if scene.actuation.voltage is None else "voltage"


def held(scene: Scene, actuator: str, value: float | None = None) -> Law:
    """Return the law that holds an actuator's value as `Held` does, and nothing else moves."""
    at = dict.fromkeys(scene.actuation.names) | {"force": 0.0, actuator: value}
    laws = [Held(scene, name, at[name]) for name in scene.actuation.names]
    return laws[0] if len(laws) == 1 else Both(*laws)


def no_control(scene: Scene) -> Law:
    """Return the law of no force, and of stretch and damping that the episode begins with."""
    actuator = _slowest(scene)
    law = held(scene, actuator, 0.0 if actuator == "force" else None)
    law.name = "no control"
    return law


def uncontrolled(scene: Scene) -> Feedback:
    """Return no control, which needs no state."""
    return Feedback(scene, no_control(scene), ObservedActuators(scene))


def best_constant(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Return the best of what never moves: a stretch, else a damping, else a force.

    With the seed of the final evaluation it is the best in hindsight.
    """
    source, actuator = ObservedActuators(scene), _slowest(scene)
    is_force = actuator == "force"
    values = Command(scene, "force").high * CENTRED if is_force else grid(scene, actuator)
    return searched(scene, lambda value: held(scene, actuator, value), values, seed, source)


def _slowest(scene: Scene) -> str:
    """Return the actuator that is worth holding: the stretch, else the damping, else the force."""
    if scene.actuation.stretch is not None:
        return "stretch"
    return "force" if scene.actuation.device is None else device_of(scene)


ENTRIES = (
    Entry("no-control", (), uncontrolled, 1, "any"),
    Entry("best-constant", (), best_constant, 2, "any"),
)
