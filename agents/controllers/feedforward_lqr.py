"""The LQR with feed-forward: it also counters what random excitation is about to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.clipped_lqr import ClippedLQR, best_lqr_with_clipped_lqr
from agents.controllers.controller import Law, force_weight, plant_of
from agents.controllers.excitation_filter import ExcitationFilter
from agents.controllers.feedback import Both, Feedback
from agents.controllers.forecast import SHAPED
from agents.controllers.lqg import regulator
from agents.controllers.lqr import STATES
from agents.controllers.registry import Entry, without_weight

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Memory, Values
    from mm_gym import Scene


class FeedforwardLQR(Law):
    """Feed back the motion, and the state of the filter that shapes the random excitation.

    How the motion differs from the model's prediction shows what the excitation did in the last
    step; a Kalman filter finds the shaping filter's state from that. The regulator is optimal for
    the conditional mean of what is to come. Suhardjo, Spencer and Sain, *Feedback-feedforward
    control of structures under seismic excitation*, Struct. Saf. 8 (1990).

    Parameters
    ----------
    scene
        A scene with a force, and with random noise among its excitation.
    stretch
        Stretch of the springs about which it is designed [-]; by default the initial one.

    Raises
    ------
    DesignError
        If no random noise excites the scene, or as for `lqg.design_lqg`.
    """

    name = "LQR with feed-forward"

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        force_weight(scene)
        plant = plant_of(scene)
        assert scene.actuation.force is not None  # noqa: S101 - `force_weight` refuses otherwise
        self.limit = scene.actuation.force.limit
        at = None if stretch is None else {"initial.stretch": stretch}
        system = plant.state_space(["force"], STATES, sampled=True, at=at)
        names = [signal.name for signal in system.states]
        self.filter = ExcitationFilter(scene, system)
        gain = regulator(plant, scene, at, system)[1]
        self.of_motion, self.of_filters = gain[:4], gain[self.filter.rows]
        self.of_force = gain[names.index("force")] if "force" in names else 0.0

    def begin(self, lanes: int) -> Memory:
        """Expect nothing yet."""
        return self.filter.begin(lanes)

    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the force over the limit."""
        memory = self.filter.observe(memory, state, applied)
        force = state @ self.of_motion + memory["state"] @ self.of_filters
        return -(force + self.of_force * applied[:, 0])[:, None] / self.limit, memory


def best_feedforward_lqr_with_clipped_lqr(scene: Scene) -> Feedback:
    """Search the clipped LQR as next to a regulator, then give the regulator feed-forward."""
    found = best_lqr_with_clipped_lqr(scene).law
    assert isinstance(found, Both)  # noqa: S101 - as it was made
    clipped = found.laws[1]
    assert isinstance(clipped, ClippedLQR)  # noqa: S101 - as it was made
    return Feedback(scene, Both(FeedforwardLQR(scene, clipped.about), clipped))


def without_shaped_noise(scene: Scene) -> str | None:
    """Return that nothing in a scene can be fed forward, or None."""
    if {part.kind for part in scene.excitation}.intersection(SHAPED):
        return None
    return f"which expects the next values of {', '.join(SHAPED)}, and the excitation has none"


ENTRIES = (
    Entry(
        "feedforward-lqr-and-clipped-lqr",
        ("force", "stretch"),
        best_feedforward_lqr_with_clipped_lqr,
        32,
        label="LQR with feed-forward + clipped LQR",
        refuses=lambda scene: without_shaped_noise(scene) or without_weight(scene),
        told=True,
    ),
)
