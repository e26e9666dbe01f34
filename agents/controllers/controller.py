"""The protocols of controllers, of the laws in them, and of where a law gets the state from."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from mm_gym import DesignError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene

    Values: TypeAlias = NDArray[np.float64]

Reads: TypeAlias = Literal["observation", "full state", "episode"]
"""What a controller may read: what an agent sees; the true state besides; also what was drawn."""


class Controller(Protocol):
    """What acts on many lanes at once."""

    name: str

    @property
    def reads(self) -> Reads:
        """What it reads; only who reads the full state is given `info`."""
        ...

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare for the episodes that have just begun in the lanes of `env`."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return actions (lanes, k) in [-1, 1].

        Parameters
        ----------
        observation
            (lanes, n): what an agent sees.
        info
            "state" (lanes, 4), x1, x2 [m], v1, v2 [m/s]; "applied" (lanes, k), what is actuated of
            force [N], stretch [-] and damping [N s/m]. Empty for a controller that reads the
            observation.
        """
        ...


class Law(Protocol):
    """A control law: from the state to the action."""

    name: str

    def begin(self, lanes: int) -> None:
        """Prepare for so many new episodes."""

    def action(self, state: Values, applied: Values) -> Values:
        """Return actions (lanes, k), which are clipped to [-1, 1] afterwards.

        Parameters
        ----------
        state
            (lanes, 4): x1, x2 [m], v1, v2 [m/s].
        applied
            (lanes, k): force [N], stretch [-] and damping [N s/m] that the actuators have.
        """
        ...


class StateSource(Protocol):
    """What tells a law the state: the truth, or an estimate from the observation."""

    reads: Reads

    def begin(self, lanes: int) -> None:
        """Prepare for so many new episodes."""

    def read(self, observation: NDArray[np.float32], info: dict[str, Any]) -> tuple[Values, Values]:
        """Return the states (lanes, 4) and what the actuators have (lanes, k)."""
        ...

    def send(self, action: Values) -> None:
        """Take note of the actions (lanes, k) that were chosen."""


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the names of the actuators, in the order of the action."""
    return scene.actuation.names


def require_actuator(scene: Scene, name: str) -> None:
    """Raise `DesignError` if the scene lacks an actuator: "force", "stretch" or "damping"."""
    if getattr(scene.actuation, name) is None:
        msg = f"actuation.{name}: missing; the scene must have a {name} actuator"
        raise DesignError(msg)


def require_number(name: str, value: float, low: float = 0.0, high: float = inf) -> None:
    """Raise `DesignError` unless a number is finite, at least `low` and at most `high`."""
    if not (low <= value <= high and abs(value) < inf):
        end = "" if high == inf else f" and at most {high:g}"
        msg = f"{name}: got {value!r}; allowed: a finite number of at least {low:g}{end}"
        raise DesignError(msg)
