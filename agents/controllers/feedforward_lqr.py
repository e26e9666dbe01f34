"""LQR and clipped LQR with feed-forward: they counter what random excitation is about to do."""

from collections.abc import Mapping

import numpy as np
from scipy.linalg import expm

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory
from agents.control.feedback import Both, Feedback
from agents.control.scene import STATES, force_weight, internal_force, nominal, plant_of
from agents.controllers.clipped_lqr import (
    ClippedLQR,
    best_lqr_with_clipped_lqr,
    free_weights,
    gain_of,
    weighted_clipped_lqr,
)
from agents.controllers.clipped_lqr import free_numbers as free_numbers_of_motion
from agents.controllers.forecast import SHAPED, UNMODELLED, ExcitationFilter
from agents.controllers.lqg import regulator
from agents.controllers.lqr import state_weight
from agents.controllers.registry import Entry, Free, Tunable, once, unless, without_weight
from mm_gym import Scene
from mm_gym.arrays import Array


class FeedforwardLQR(Law):
    """Feed back the motion, and the state of the filter that shapes the random excitation.

    How the motion differs from the model's prediction shows what the excitation did in the last
    step; a Kalman filter finds the shaping filter's state from that. The regulator is optimal for
    the conditional mean of what is to come. Suhardjo, Spencer and Sain, *Feedback-feedforward
    control of structures under seismic excitation*, Struct. Saf. 8 (1990). It is designed about a
    stretch, by default the initial one. Raise `DesignError` if no random noise excites the scene,
    or as for `lqg.design_lqg`.
    """

    name = "LQR with feed-forward"

    def __init__(self, scene: Scene, stretch: float | None = None) -> None:
        force_weight(scene)
        plant = plant_of(scene)
        self.limit = Command(scene, "force").high
        at = None if stretch is None else {"initial.stretch": stretch}
        system = plant.state_space(["force"], STATES, sampled=True, at=at)
        names = [signal.name for signal in system.states]
        self.filter = ExcitationFilter(scene, system)
        gain = regulator(plant, scene, at, system).gain
        self.of_motion, self.of_filters = gain[:4], gain[self.filter.rows]
        self.of_force = gain[names.index("force")] if "force" in names else 0.0

    def begin(self, lanes: int) -> Memory:
        return self.filter.begin(lanes)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        memory = self.filter.observe(memory, state, applied)
        force = state @ self.of_motion + memory["state"] @ self.of_filters
        return -(force + self.of_force * applied[:, 0])[:, None] / self.limit, memory


def best_feedforward_lqr_with_clipped_lqr(scene: Scene) -> Feedback:
    """Search the clipped LQR as next to a regulator, then give the regulator feed-forward."""
    found = once(best_lqr_with_clipped_lqr, scene).law
    assert isinstance(found, Both)  # noqa: S101 - as it was made
    clipped = found.laws[1]
    assert isinstance(clipped, ClippedLQR)  # noqa: S101 - as it was made
    return Feedback(scene, Both(FeedforwardLQR(scene, clipped.about), clipped))


class FeedforwardClippedLQR(Law):
    """Choose the stiffness whose force is closest to that of a regulator with feed-forward.

    The regulator of the clipped LQR also feeds back the states of the filters that shape the random
    excitation, which a Kalman filter finds from what the model of the motion missed. It is optimal
    for the conditional mean of what is to come; the springs then give what they can of its force.
    Suhardjo, Spencer and Sain, *Feedback-feedforward control of structures under seismic
    excitation*, Struct. Saf. 8 (1990). Raise `DesignError` if no random noise excites the scene, or
    as for `ClippedLQR`.
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
        b[:4, 0] = internal_force(scene)
        weight = np.zeros_like(a)
        weight[:4, :4] = state_weight(scene) + weights
        unit = nominal(scene, "carriage.stiffness") * scene.objective.displacement_scale
        self.gain = gain_of(a, b, weight, numbers["force"] / unit**2)
        self.gain[4:] *= numbers["feedforward"]
        # What the filters' states add to the motion, about the design's stretch, and to themselves.
        moved = expm(a * self.clipped.lead.time)
        self.ahead = moved[:4, 4:], moved[4:, 4:]

    def begin(self, lanes: int) -> Memory:
        return self.filter.begin(lanes)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        memory = self.filter.observe(memory, state, applied)
        clipped, (to_motion, kept) = self.clipped, self.ahead
        present, filters = clipped.command.present(applied), memory["state"]
        ahead = clipped.lead(state, present) + filters @ to_motion.T
        force = ahead @ self.gain[:4] + filters @ kept.T @ self.gain[4:]
        return clipped.towards(force, ahead, present), memory


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return those of the clipped LQR, and factors of the filters' gain and unmodelled noise."""
    return {
        **free_numbers_of_motion(scene),
        "feedforward": Free(1.0, 0.5, ratio=False),
        "unmodelled": Free(1.0, 1.5),
    }


without_shaped_noise = unless(
    lambda scene: not {part.kind for part in scene.excitation}.isdisjoint(SHAPED),
    f"which expects the next values of {', '.join(SHAPED)}, and the excitation has none",
)

ENTRIES = (
    Tunable("feedforward-clipped-lqr", free_numbers, FeedforwardClippedLQR).entry(
        ("stretch",),
        29,
        label="clipped LQR with feed-forward, free weights",
        refuses=without_shaped_noise,
    ),
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
