"""Constant control: one action, one force or one stretch throughout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.both import Both
from agents.controllers.controller import columns, require_actuator, require_number
from agents.controllers.stretch_command import StretchCommand

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Law, Reads, Values
    from mm_gym import MovingMassVectorEnv, Scene


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
        self.command = StretchCommand(scene)
        if stretch is not None:
            require_number(
                "stretch", stretch, self.command.actuator.minimum, self.command.actuator.maximum
            )

    def begin(self, lanes: int) -> None:
        """Forget the last episode's stretch."""
        self.wanted: Values | None = None

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the stretch."""
        present = applied[:, -1]
        if self.wanted is None:
            self.wanted = present.copy()
            if self.stretch is not None:
                self.wanted[:] = self.stretch
        return self.command(self.wanted, present)


def constant_stretch(scene: Scene, stretch: float | None = None) -> Law:
    """Return the law that holds a stretch, as `ConstantStretch`, and pushes with no force."""
    law = ConstantStretch(scene, stretch)
    return law if scene.actuation.force is None else Both(ConstantForce(scene), law)


def no_control(scene: Scene) -> Law:
    """Return the law of no force and of the stretch that the episode begins with."""
    no_stretch = scene.actuation.stretch is None
    law = ConstantForce(scene) if no_stretch else constant_stretch(scene)
    law.name = "no control"
    return law
