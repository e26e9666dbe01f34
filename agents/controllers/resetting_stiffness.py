"""Resetting stiffness: springs that store energy stiff and let it go when they soften."""

import numpy as np

from agents.control.actuators import Command, Lead, require_stable_rest
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import nominal
from agents.controllers.registry import Entry
from mm_gym import Scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness
from mm_gym.arrays import Array


class ResettingStiffness(Law):
    """Springs stiff while the offset grows, soft while it shrinks.

    They soften at the largest offset, which takes energy out, and stiffen about the middle. Yang,
    Kim and Agrawal, *Resetting semiactive stiffness damper for seismic response control*, J.
    Struct. Eng. 126 (2000); Jabbari and Bobrow, *Vibration suppression with resettable device*, J.
    Eng. Mech. 128 (2002).

    Parameters
    ----------
    passive
        Stiffen only as far as the energy allows that softening has taken out since the episode
        began, so that the springs never give more than they took. Otherwise they may inject energy,
        as stiffening at an offset does.
    """

    def __init__(self, scene: Scene, *, passive: bool) -> None:
        require_stable_rest(scene, "resetting stiffness")
        self.name = f"resetting stiffness, {'passive' if passive else 'may inject energy'}"
        self.passive = passive
        self.command, self.lead = Command(scene, "stretch"), Lead(scene)
        self.stiffness = nominal(scene, "springs.stiffness")

    def begin(self, lanes: int) -> Memory:
        names = ("taken", "k2", "half") if self.passive else ()
        return {name: np.zeros(lanes) for name in names}

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        present = self.command.present(applied)
        ahead = self.lead(state, present)
        grows = (ahead[:, 1] - ahead[:, 0]) * (ahead[:, 3] - ahead[:, 2]) > 0.0
        wanted = np.where(grows, self.command.low, self.command.high)
        if self.passive:
            wanted, memory = self._affordable(memory, wanted, state, present)
        return self.command(wanted, present), memory

    def _affordable(self, memory: Memory, wanted: Array, state: Array, present: Array) -> Acted:
        """Return the stretch nearest to the wanted one whose energy has been taken out before."""
        half = 0.5 * (state[:, 1] - state[:, 0]) ** 2
        k2 = spring_stiffness(present, self.stiffness)
        taken = memory["taken"] + memory["half"] * (memory["k2"] - k2)
        with np.errstate(divide="ignore", invalid="ignore"):
            most = k2 + np.where(half > 0.0, np.maximum(taken, 0.0) / half, np.inf)
        least = np.minimum(stretch_for_stiffness(most, self.stiffness), present)
        return np.maximum(wanted, least), {"taken": taken, "k2": k2, "half": half}


ENTRIES = (
    Entry(
        "resetting-stiffness-passive",
        ("stretch",),
        lambda scene: ResettingStiffness(scene, passive=True),
        23,
        label="resetting stiffness, passive",
    ),
    Entry(
        "resetting-stiffness",
        ("stretch",),
        lambda scene: ResettingStiffness(scene, passive=False),
        24,
    ),
)
