"""Constant control: one action, one force, one stretch or one damping throughout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.both import Both
from agents.controllers.controller import columns, require_actuator, require_number
from agents.controllers.damping_command import DampingCommand
from agents.controllers.stretch_command import StretchCommand

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Law, Reads, Values
    from mm_gym import MovingMassVectorEnv, Scene


UNITS = {"damping": "N s/m", "voltage": "V"}
"""Of what a semi-active device holds."""


class ConstantAction:
    """The same action throughout."""

    reads: Reads = "observation"

    def __init__(self, scene: Scene, action: float = 0.0) -> None:
        self.name = "zero action" if action == 0.0 else f"constant action {action:.3f}"
        self.values = np.full(len(columns(scene)), action)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the action for every lane."""
        return np.tile(self.values, (len(observation), 1))


class ConstantForce:
    """Push with one force [N]."""

    def __init__(self, scene: Scene, force: float = 0.0) -> None:
        require_actuator(scene, "force")
        actuator = scene.actuation.force
        assert actuator is not None  # noqa: S101 - as required
        require_number("force", force, -actuator.limit, actuator.limit)
        self.name = f"constant force {force:.3f} N" if force else "no force"
        self.value = force / actuator.limit

    def begin(self, lanes: int) -> None:
        """Nothing to prepare."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return the force over the limit."""
        return np.full((len(state), 1), self.value)


class ConstantStretch:
    """Go to one stretch [-] and stay; by default stay at the one that the episode begins with."""

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        self.name = "initial stretch" if stretch is None else f"constant stretch {stretch:.3f}"
        self.stretch = stretch
        self.command, self.column = StretchCommand(scene), columns(scene).index("stretch")
        if stretch is not None:
            require_number(
                "stretch", stretch, self.command.actuator.minimum, self.command.actuator.maximum
            )

    def begin(self, lanes: int) -> None:
        """Forget the last episode's stretch."""
        self.wanted: Values | None = None

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the stretch."""
        present = applied[:, self.column]
        if self.wanted is None:
            self.wanted = present.copy()
            if self.stretch is not None:
                self.wanted[:] = self.stretch
        return self.command(self.wanted, present)


class ConstantDamping:
    """Go to one damping [N s/m] and stay; by default stay at the one that the episode begins with.

    Of a magnetorheological damper it is the voltage [V].

    Raises
    ------
    DesignError
        If no damping is actuated, or the value is beyond its limits.
    """

    def __init__(self, scene: Scene, damping: float | None = None) -> None:
        device = device_of(scene)
        self.command = DampingCommand(scene, device)
        self.name = f"initial {device}"
        if damping is not None:
            require_number(device, damping, self.command.low, self.command.high)
            self.name = f"constant {device} {damping:.3g} {UNITS[device]}"
        self.damping = damping

    def begin(self, lanes: int) -> None:
        """Forget the last episode's damping."""
        self.wanted: Values | None = None

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the damping."""
        present = applied[:, self.command.column]
        if self.wanted is None:
            self.wanted = present.copy()
            if self.damping is not None:
                self.wanted[:] = self.damping
        return self.command(self.wanted, present)


def constant_stretch(scene: Scene, stretch: float | None = None) -> Law:
    """Return the law that holds a stretch, as `ConstantStretch`, and nothing else moves."""
    return _held(scene, ConstantStretch(scene, stretch), "stretch")


def constant_damping(scene: Scene, damping: float | None = None) -> Law:
    """Return the law that holds a damping, as `ConstantDamping`, and nothing else moves."""
    return _held(scene, ConstantDamping(scene, damping), device_of(scene))


def device_of(scene: Scene) -> str:
    """Return which actuator a semi-active device has, "damping" or "voltage"."""
    return "damping" if scene.actuation.voltage is None else "voltage"


def _held(scene: Scene, law: Law, own: str) -> Law:
    """Return a law of one actuator, by its name, with the others at rest."""
    rest = {"force": ConstantForce, "stretch": ConstantStretch}
    all_laws = [
        law if name == own else rest.get(name, ConstantDamping)(scene) for name in columns(scene)
    ]
    return law if len(all_laws) == 1 else Both(*all_laws)


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
