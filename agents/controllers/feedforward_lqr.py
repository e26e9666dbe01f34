"""The LQR with feed-forward: it also counters what random excitation is about to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.excitation_filter import ExcitationFilter
from agents.controllers.lqg import MOTION, force_price, regulator
from mm_gym import compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class FeedforwardLQR:
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
        force_price(scene)
        plant = compile_scene(scene)
        assert scene.actuation.force is not None  # noqa: S101 - `force_price` refuses otherwise
        self.limit = scene.actuation.force.limit
        at = None if stretch is None else {"initial.stretch": stretch}
        system = plant.state_space(["force"], MOTION, sampled=True, at=at)
        names = [signal.name for signal in system.states]
        self.filter = ExcitationFilter(scene, system)
        gain = regulator(plant, scene, at, system)[1]
        self.of_motion, self.of_filters = gain[:4], gain[self.filter.rows]
        self.of_force = gain[names.index("force")] if "force" in names else 0.0

    def begin(self, lanes: int) -> None:
        """Expect nothing yet."""
        self.filter.begin(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the force over the limit."""
        self.filter.observe(state, applied)
        force = state @ self.of_motion + self.filter.state @ self.of_filters
        return -(force + self.of_force * applied[:, 0])[:, None] / self.limit
