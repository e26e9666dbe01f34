"""The protocol of all controllers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene


FULL_STATE, OBSERVATION = "full state", "observation"
"""What a law may read: the true state and what is drawn, which no sensor shows, or what an agent
sees and what its own actuators have reached."""


class Controller(Protocol):
    """A law that acts on many lanes at once.

    Attributes
    ----------
    name
        As in tables and figures.
    reads
        `FULL_STATE` or `OBSERVATION`.
    """

    name: str
    reads: str

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare for the episodes that have just begun in the lanes of `env`."""

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float64]:
        """Return actions (lanes, k) in [-1, 1].

        Parameters
        ----------
        observation
            (lanes, n): what an agent sees.
        info
            What a law of control theory may know besides: "state" (lanes, 4), x1, x2 [m], v1, v2
            [m/s]; "applied" (lanes, k), the force [N] and the stretch [-] that are actuated.
        """
        ...


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the names of the actuators, in the order of the action."""
    return tuple(
        name for name in ("force", "stretch") if getattr(scene.actuation, name) is not None
    )
