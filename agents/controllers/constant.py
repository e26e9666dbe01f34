"""Constant control: one action, one force, one stretch, damping or voltage throughout."""

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Controller, Info, Law, Memory, Observation
from agents.control.feedback import Both, Feedback
from agents.control.observed_state import ObservedActuators
from agents.control.scene import require_number
from agents.controllers.registry import Entry
from agents.controllers.searched import grid, searched
from agents.scoring import VALIDATION_SEED
from mm_gym import Scene
from mm_gym.arrays import Array

CENTRED = np.linspace(-0.5, 0.5, 17)  # forces over the force limit that are tried

FORMATS = {"stretch": "{:.3f}", "damping": "{:.3g} N s/m", "voltage": "{:.3g} V"}
"""How names tell what is held."""


class ConstantAction(Controller):
    """The same action throughout."""

    def __init__(self, scene: Scene, action: float = 0.0) -> None:
        self.name = "zero action" if action == 0.0 else f"constant action {action:.3f}"
        self.values = np.full(len(scene.actuation.names), action)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        return np.tile(self.values, (len(observation), 1)), memory


class ConstantForce(Law):
    """Push with one force [N]."""

    def __init__(self, scene: Scene, force: float = 0.0) -> None:
        command = Command(scene, "force")
        require_number("force", force, command.low, command.high)
        self.name = f"constant force {force:.3f} N" if force else "no force"
        self.value = force / command.high

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return np.full((len(state), 1), self.value), memory


class Held(Law):
    """Go to one value and stay; by default stay at the one that the episode begins with.

    Raise `DesignError` if there is no such actuator, or the value is beyond its limits.

    Parameters
    ----------
    actuator
        "stretch" [-], "damping" [N s/m] or "voltage" [V].
    """

    def __init__(self, scene: Scene, actuator: str, value: float | None = None) -> None:
        self.command, self.value = Command(scene, actuator), value
        self.name = f"initial {actuator}"
        if value is not None:
            require_number(actuator, value, self.command.low, self.command.high)
            self.name = f"constant {actuator} {FORMATS[actuator].format(value)}"

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


def constant_stretch(scene: Scene, stretch: float | None = None) -> Law:
    """Return the law that holds a stretch [-], and nothing else moves."""
    return _held(scene, Held(scene, "stretch", stretch))


def constant_damping(scene: Scene, damping: float | None = None) -> Law:
    """Return the law that holds a damping [N s/m] or a voltage [V], and nothing else moves."""
    return _held(scene, Held(scene, device_of(scene), damping))


def device_of(scene: Scene) -> str:
    """Return which actuator a semi-active device has, "damping" or "voltage"."""
    return "damping" if scene.actuation.voltage is None else "voltage"


def _held(scene: Scene, law: Held) -> Law:
    """Return a law of one actuator, by its name, with the others at rest."""
    laws = [
        law
        if name == law.command.name
        else (ConstantForce(scene) if name == "force" else Held(scene, name))
        for name in scene.actuation.names
    ]
    return law if len(laws) == 1 else Both(*laws)


def no_control(scene: Scene) -> Law:
    """Return the law of no force, and of stretch and damping that the episode begins with."""
    if scene.actuation.stretch is not None:
        law = constant_stretch(scene)
    elif scene.actuation.device is not None:
        law = constant_damping(scene)
    else:
        law = ConstantForce(scene)
    law.name = "no control"
    return law


def uncontrolled(scene: Scene) -> Feedback:
    """Return no control, which needs no state."""
    return Feedback(scene, no_control(scene), ObservedActuators(scene))


def best_constant(scene: Scene, seed: int = VALIDATION_SEED) -> Feedback:
    """Return the best of what never moves: a stretch, else a damping, else a force.

    With the seed of the final evaluation it is the best in hindsight.
    """
    source = ObservedActuators(scene)
    if scene.actuation.stretch is not None:
        values, make = grid(scene, "stretch"), constant_stretch
    elif scene.actuation.device is not None:
        values, make = grid(scene, device_of(scene)), constant_damping
    else:
        values, make = Command(scene, "force").high * CENTRED, ConstantForce
    return searched(scene, lambda value: make(scene, value), values, seed, source)


ENTRIES = (
    Entry("no-control", (), uncontrolled, 1, "any"),
    Entry("best-constant", (), best_constant, 2, "any"),
)
