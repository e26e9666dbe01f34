"""What a controller is, and the simplest ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene
    from mm_gym.scene.actuators import StretchActuator


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
        if actuator is None:
            msg = "actuation.stretch: missing; the scene must have a stretch actuator"
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


def stretch_of(
    k2: NDArray[np.float64], twice_k0: NDArray[np.float64] | float, actuator: StretchActuator
) -> NDArray[np.float64]:
    """Return the stretch of a stiffness k2 [N/m], within the actuator's range.

    It is eq. 15 of the paper inverted, (2 / (k2 / 2 k0 - 1))^(1/3).
    """
    excess = k2 / twice_k0 - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        stretch = np.where(excess > 0.0, (2.0 / excess) ** (1.0 / 3.0), np.inf)
    return np.clip(stretch, actuator.minimum, actuator.maximum)


class ConstantAction:
    """The same action throughout."""

    def __init__(self, scene: Scene, action: float = 0.0) -> None:
        self.name = "zero action" if action == 0.0 else f"constant action {action:.3f}"
        self.action = np.full(len(columns(scene)), action)

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the action for every lane."""
        return np.tile(self.action, (len(observation), 1))


class RandomActions:
    """Actions drawn uniformly, the same in every evaluation."""

    name = "random actions"

    def __init__(self, scene: Scene) -> None:
        self.columns = len(columns(scene))

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin the random numbers anew."""
        self.generator = np.random.default_rng(0)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return actions drawn from [-1, 1]."""
        return self.generator.uniform(-1.0, 1.0, (len(observation), self.columns))


class Zero:
    """No force; the stretch stays where the episode began."""

    name = "no control"

    def __init__(self, scene: Scene) -> None:
        self.command = StretchCommand(scene) if scene.actuation.stretch is not None else None
        self.columns = len(columns(scene))

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Hold the stretch of the first step."""
        self.initial: NDArray[np.float64] | None = None

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return zero force, or hold the initial stretch."""
        action = np.zeros((len(observation), self.columns))
        if self.command is not None:
            if self.initial is None:
                self.initial = info["applied"][:, -1].copy()
            action[:, -1:] = self.command(self.initial, info["applied"][:, -1])
        return action


class ConstantForce:
    """Push with one force."""

    def __init__(self, scene: Scene, force: float = 0.0) -> None:
        actuator = scene.actuation.force
        if actuator is None:
            msg = "actuation.force: missing; there is no force to hold"
            raise ValueError(msg)
        self.name = f"constant force {force:.3f} N" if force else "no force"
        self.share = force / actuator.limit

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Nothing to prepare."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the force as a share of the limit."""
        return np.full((len(observation), 1), self.share)


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


class Both:
    """One law for the force and one for the stretch."""

    def __init__(self, force: Controller, stretch: Controller) -> None:
        self.name = f"{force.name} + {stretch.name}"
        self.force, self.stretch = force, stretch

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare both."""
        self.force.reset(env)
        self.stretch.reset(env)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return the two columns."""
        laws = (self.force, self.stretch)
        return np.concatenate([law.act(observation, info) for law in laws], axis=1)


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the names of the actuators, in the order of the action."""
    return tuple(
        name for name in ("force", "stretch") if getattr(scene.actuation, name) is not None
    )
