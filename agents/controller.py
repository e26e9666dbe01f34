"""What a controller is, and the simplest ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene


class Controller(Protocol):
    """Acts on many lanes at once."""

    name: str

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare for the episodes that have just begun in the lanes of `env`."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return actions (lanes, k) in [-1, 1]."""
        ...


class StretchCommand:
    """Turns a wanted stretch into the action towards it, whatever the actuator's command means."""

    def __init__(self, scene: Scene) -> None:
        actuator = scene.actuation.stretch
        if actuator is None or scene.actuation.force is not None:
            msg = "the scene must have a stretch actuator and no other"
            raise ValueError(msg)
        self.actuator = actuator
        self.time_step = scene.control.time_step

    def __call__(
        self, wanted: NDArray[np.float64], present: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return actions (lanes, 1) towards a wanted stretch (lanes,) from the present (lanes,)."""
        low, high = self.actuator.minimum, self.actuator.maximum
        if self.actuator.command == "position":
            action = (wanted - 0.5 * (high + low)) / (0.5 * (high - low))
        else:
            assert self.actuator.rate_limit is not None  # noqa: S101 - the scene guarantees it
            action = (wanted - present) / (self.actuator.rate_limit * self.time_step)
        return np.clip(action, -1.0, 1.0)[:, None]


class Zero:
    """No force; the stretch stays where the episode began."""

    name = "no control"

    def __init__(self, scene: Scene) -> None:
        self.command = StretchCommand(scene) if scene.actuation.stretch is not None else None
        self.columns = (scene.actuation.force is not None) + (scene.actuation.stretch is not None)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Remember each lane's stretch."""
        self.initial = env.drawn("initial.stretch") if self.command else np.zeros(env.num_envs)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return zero force, or hold the initial stretch."""
        if self.command is None:
            return np.zeros((len(observation), self.columns))
        return self.command(self.initial, info["applied"][:, -1])


class ConstantStretch:
    """Go to one stretch and stay."""

    def __init__(self, scene: Scene, stretch: float) -> None:
        self.name = f"constant stretch {stretch:.3f}"
        self.stretch = stretch
        self.command = StretchCommand(scene)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the action towards the stretch."""
        present = info["applied"][:, -1]
        return self.command(np.full(len(present), self.stretch), present)
