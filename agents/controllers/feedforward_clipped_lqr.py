"""The clipped LQR with feed-forward: it switches springs for what noise is about to do, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np
from scipy.linalg import expm

from agents.controllers.clipped_lqr import free_numbers as free_numbers_of_motion
from agents.controllers.clipped_lqr import free_weights, weighted_clipped_lqr
from agents.controllers.controller import Law, plant_of
from agents.controllers.excitation_filter import UNMODELLED, ExcitationFilter
from agents.controllers.feedback import Feedback
from agents.controllers.feedforward_lqr import without_shaped_noise
from agents.controllers.lqr import STATES, state_weight
from agents.controllers.registry import Entry
from agents.controllers.tunable import Free, Tunable
from mm_gym.analysis import stretch_for_stiffness

if TYPE_CHECKING:
    from collections.abc import Mapping

    from agents.controllers.controller import Acted, Memory, Values
    from mm_gym import Scene


class FeedforwardClippedLQR(Law):
    """Choose the stiffness whose force is closest to that of a regulator with feed-forward.

    The regulator of the clipped LQR also feeds back the states of the filters that shape the random
    excitation, which a Kalman filter finds from what the model of the motion missed. It is optimal
    for the conditional mean of what is to come; the springs then give what they can of its force.
    Suhardjo, Spencer and Sain, *Feedback-feedforward control of structures under seismic
    excitation*, Struct. Saf. 8 (1990).

    Parameters
    ----------
    numbers
        As of `free_numbers`.

    Raises
    ------
    DesignError
        If no random noise excites the scene, or as for `ClippedLQR`.
    """

    name = "clipped LQR with feed-forward, free weights"

    def __init__(self, scene: Scene, numbers: Mapping[str, float]) -> None:
        plant, at = plant_of(scene), {"initial.stretch": numbers["stretch"]}
        weights = free_weights(scene, numbers)
        self.clipped = weighted_clipped_lqr(scene, numbers)
        sampled = plant.state_space([], STATES, sampled=True, at=at)
        self.filter = ExcitationFilter(scene, sampled, numbers["unmodelled"] * UNMODELLED)
        system = plant.state_space([], STATES, at=at)
        rows = [*range(4), *self.filter.rows]
        a = system.A[np.ix_(rows, rows)]
        b = np.zeros((len(rows), 1))
        b[2], b[3] = 1.0 / scene.carriage.mass, -1.0 / scene.sphere.mass
        weight = np.zeros_like(a)
        weight[:4, :4] = state_weight(scene) + weights
        unit = scene.carriage.stiffness * scene.objective.displacement_scale
        gain, _, _ = control.lqr(a, b, weight, [[numbers["force"] / unit**2]], method="scipy")
        self.gain = np.asarray(gain)[0]
        self.gain[4:] *= numbers["feedforward"]
        self.ahead = self._ahead(a)

    def _ahead(self, a: Values) -> tuple[Values, Values]:
        """Return what the filters' states (f,) add to state and filters in the lead's time.

        That is to the motion (4, f), at the stretch of the design, and to themselves (f, f).
        """
        moved = expm(a * self.clipped.lead.time)
        return moved[:4, 4:], moved[4:, 4:]

    def begin(self, lanes: int) -> Memory:
        """Expect nothing yet."""
        return self.filter.begin(lanes)

    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the action towards the stretch of the wanted stiffness."""
        memory = self.filter.observe(memory, state, applied)
        clipped, (to_motion, kept) = self.clipped, self.ahead
        present, filters = clipped.command.present(applied), memory["state"]
        ahead = clipped.lead(state, present) + filters @ to_motion.T
        force = ahead @ self.gain[:4] + filters @ kept.T @ self.gain[4:]
        with np.errstate(divide="ignore", invalid="ignore"):
            k2 = clipped.k2 - np.nan_to_num(force / (ahead[:, 1] - ahead[:, 0]))
        wanted = stretch_for_stiffness(k2, clipped.stiffness)
        return clipped.command(wanted, present), memory


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return those of the clipped LQR, and factors of the filters' gain and unmodelled noise."""
    return {
        **free_numbers_of_motion(scene),
        "feedforward": Free(1.0, 0.5, ratio=False),
        "unmodelled": Free(1.0, 1.5),
    }


FEEDFORWARD = Tunable(
    "feedforward-clipped-lqr",
    free_numbers,
    lambda scene, numbers: Feedback(scene, FeedforwardClippedLQR(scene, numbers)),
)

ENTRIES = (
    Entry(
        FEEDFORWARD.name,
        ("stretch",),
        FEEDFORWARD.best,
        29,
        label="clipped LQR with feed-forward, free weights",
        refuses=without_shaped_noise,
        tunable=FEEDFORWARD,
    ),
)
