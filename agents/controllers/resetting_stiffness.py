"""Resetting stiffness: springs that store energy stiff and let it go when they soften."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.lead import Lead
from agents.controllers.stretch_command import StretchCommand, require_stable_rest
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class ResettingStiffness:
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
        self.command, self.lead = StretchCommand(scene), Lead(scene)
        self.stiffness = scene.springs.stiffness

    def begin(self, lanes: int) -> None:
        """Begin without energy taken out."""
        self.taken = np.zeros(lanes)
        self.last: Values | None = None

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the stiff or the soft end."""
        present, actuator = applied[:, -1], self.command.actuator
        ahead = self.lead(state, present)
        grows = (ahead[:, 1] - ahead[:, 0]) * (ahead[:, 3] - ahead[:, 2]) > 0.0
        wanted = np.where(grows, actuator.minimum, actuator.maximum)
        if self.passive:
            wanted = self._affordable(wanted, state, present)
        return self.command(wanted, present)

    def _affordable(self, wanted: Values, state: Values, present: Values) -> Values:
        """Return the stretch nearest to the wanted one whose energy has been taken out before."""
        half = 0.5 * (state[:, 1] - state[:, 0]) ** 2
        k2 = spring_stiffness(present, self.stiffness)
        if self.last is not None:
            self.taken += self.last[1] * (self.last[0] - k2)
        self.last = k2, half
        with np.errstate(divide="ignore", invalid="ignore"):
            most = k2 + np.where(half > 0.0, np.maximum(self.taken, 0.0) / half, np.inf)
        return np.maximum(wanted, np.minimum(stretch_for_stiffness(most, self.stiffness), present))
