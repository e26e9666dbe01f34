"""The clipped LQR: springs whose stiffness is switched to give a regulator's force."""

from collections.abc import Mapping
from functools import partial

import control
import numpy as np

from agents.control.actuators import Command, Lead, require_stable_rest
from agents.control.controller import Acted, Law, Memory
from agents.control.feedback import Both, Feedback
from agents.control.kalman_filter import solvable
from agents.control.scene import (
    internal_force,
    natural_frequency,
    nominal,
    plant_of,
    require_number,
)
from agents.controllers.lqr import LQR, state_weight
from agents.controllers.registry import Entry, Free, Tunable, regulator_entry
from agents.controllers.searched import searched_pair
from mm_gym import Scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness
from mm_gym.arrays import Array

ROUND_OFF = 1e-12  # of a pole over the fastest one


class ClippedLQR(Law):
    """Choose the stiffness whose force is closest to that of an actuator in the springs' place.

    A regulator is designed for the internal force between carriage and sphere about one stretch;
    the springs give its force F with k2 = k2(stretch) + F / (x2 - x1), as far as their range goes;
    a small weight makes that on-off stiffness. F is that of the state by which springs will have
    moved, see `Lead`. Dyke et al., *Modeling and control of magnetorheological dampers for seismic
    response reduction*, Smart Materials and Structures 5 (1996). Raise `DesignError` if the
    carriage is unstable at rest, or there is no regulator: nothing holds it there.

    Parameters
    ----------
    stretch
        About which the regulator is designed [-].
    weight
        Of the internal force over carriage.stiffness * objective.displacement_scale, squared [-].
    further
        (4, 4): added to the weight of the state in the reward.
    lead
        Factor of the time by which the state is moved ahead [-].
    """

    def __init__(
        self,
        scene: Scene,
        stretch: float,
        weight: float,
        further: Array | None = None,
        lead: float = 1.0,
    ) -> None:
        require_stable_rest(scene, "clipped LQR")
        require_number("weight", weight, np.finfo(np.float64).tiny)
        self.name = f"clipped LQR about {stretch:.2f}, weight {weight:.2g}"
        self.command, self.lead = Command(scene, "stretch"), Lead(scene, factor=lead)
        self.about, self.stiffness = stretch, nominal(scene, "springs.stiffness")
        self.k2 = spring_stiffness(stretch, self.stiffness)
        unit = nominal(scene, "carriage.stiffness") * scene.objective.displacement_scale
        a, _ = plant_of(scene).linear(stretch)
        state = state_weight(scene) + (0.0 if further is None else further)
        self.gain = gain_of(a, internal_force(scene)[:, None], state, weight / unit**2)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        present = self.command.present(applied)
        ahead = self.lead(state, present)
        return self.towards(ahead @ self.gain, ahead, present), memory

    def towards(self, force: Array, state: Array, present: Array) -> Array:
        """Return the action towards the stretch at which springs have forces (lanes,) [N]."""
        with np.errstate(divide="ignore", invalid="ignore"):
            k2 = self.k2 - np.nan_to_num(force / (state[:, 1] - state[:, 0]))
        return self.command(stretch_for_stiffness(k2, self.stiffness), present)


def gain_of(a: Array, b: Array, state: Array, force: float) -> Array:
    """Return the gain (n,) of the regulator of a' = a x + b u, with weights of state and force.

    Raise `DesignError` if there is none.
    """
    with solvable("the Riccati equation"):
        gain, _, poles = control.lqr(a, b, state, [[force]], method="scipy")
        slowest, fastest = np.max(np.real(poles)), np.max(np.abs(poles))
        if not slowest < -ROUND_OFF * fastest:  # rounding decides whether the solver sees it
            msg = f"a motion that the force does not reach does not decay ({slowest:.1e}/s)"
            raise ValueError(msg)
    return np.asarray(gain)[0]


def best_lqr_with_clipped_lqr(scene: Scene) -> Feedback:
    """Search the stretch and the weight next to a regulator of the force."""
    return searched_pair(
        scene,
        lambda stretch, weight: Both(LQR(scene, stretch), ClippedLQR(scene, stretch, weight)),
    )


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return the stretch about which the regulator is designed, its weights, and two factors.

    They are of the lead, and of the stiffness that the springs have where no force is wanted.
    Weights are of squares over those of objective.displacement_scale, and of the velocity that the
    carriage's natural frequency makes of it.
    """
    command = Command(scene, "stretch")
    span = command.high - command.low
    return {
        "stretch": Free(
            command.low + 0.2 * span, 0.15 * span, ratio=False, low=command.low, high=command.high
        ),
        "force": Free(1.0, 1.0),
        "velocity": Free(0.1, 1.0),
        "stroke": Free(0.01, 1.5),
        "slip": Free(0.01, 1.5),
        "lead": Free(1.0, 0.3, ratio=False, low=0.0),
        "centre": Free(1.0, 0.15),
    }


def weighted_clipped_lqr(scene: Scene, numbers: Mapping[str, float]) -> ClippedLQR:
    """Return the clipped LQR of free numbers."""
    law = ClippedLQR(
        scene, numbers["stretch"], numbers["force"], free_weights(scene, numbers), numbers["lead"]
    )
    law.name = "clipped LQR, free weights"
    law.k2 *= numbers["centre"]
    return law


def free_weights(scene: Scene, numbers: Mapping[str, float]) -> Array:
    """Return the weights (4, 4) of the carriage's velocity, the stroke and the slip velocity."""
    length = scene.objective.displacement_scale
    speed = length * natural_frequency(scene)
    rows = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]])
    scales = np.array([speed, length, speed])
    each = np.array([numbers["velocity"], numbers["stroke"], numbers["slip"]])
    return np.einsum("k,ki,kj->ij", each / scales**2, rows, rows)


WEIGHTED = Tunable("weighted-clipped-lqr", free_numbers, weighted_clipped_lqr)

ENTRIES = (
    Entry(
        "clipped-lqr",
        ("stretch",),
        lambda scene: searched_pair(scene, partial(ClippedLQR, scene)),
        21,
        label="clipped LQR",
    ),
    WEIGHTED.entry(("stretch",), 28, label="clipped LQR, free weights"),
    regulator_entry(
        "lqr-and-clipped-lqr",
        ("force", "stretch"),
        best_lqr_with_clipped_lqr,
        31,
        label="LQR + clipped LQR",
    ),
)
