"""The state of the filters that shape random excitation, and what they are about to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from agents.controllers.controller import chosen, joined, part
from agents.controllers.disturbance import state_scales
from agents.controllers.model import Innovation
from agents.controllers.observed_state import missed_covariance
from mm_gym import DesignError

if TYPE_CHECKING:
    from agents.controllers.controller import Memory, Values
    from mm_gym import LinearSystem, Scene

UNMODELLED = 1e-3
"""Of what else disturbs the motion, by default."""

LONGEST = 1000
"""Steps after which the filter's gain is taken to have settled."""


class ExcitationFilter:
    """A Kalman filter of the shaping filters' states, from what a model of the motion missed.

    Parameters
    ----------
    scene
        The scene whose motion is observed, by sensors whose errors are not taken for excitation.
    system
        Its sampled plant; the first states are the motion.
    unmodelled
        Standard deviation of what else disturbs the motion in a step over the objective's scales.

    Attributes
    ----------
    rows
        Those of the shaping filters in the system.
    kept, gains
        (steps, rows, rows) and (steps, rows, 4): in each step the filters' states become `kept`
        times the last ones, plus the gain times what the model missed.

    Raises
    ------
    DesignError
        If no random noise excites the scene.
    """

    def __init__(self, scene: Scene, system: LinearSystem, unmodelled: float = UNMODELLED) -> None:
        names = [signal.name for signal in system.states]
        self.rows = rows = [k for k, name in enumerate(names) if ".filter" in name]
        if not rows:
            msg = "excitation: it has no noise, whose next values could be predicted"
            raise DesignError(msg)
        self.innovation = Innovation(scene)
        self.turn, self.shown = system.A[np.ix_(rows, rows)], system.A[:4, rows]
        own, both = system.process_noise[np.ix_(rows, rows)], system.process_noise[rows, :4]
        further = np.diag((unmodelled * state_scales(scene)) ** 2)
        missed = system.process_noise[:4, :4] + further + missed_covariance(scene)
        noise = np.block([[own, both], [both.T, missed]])  # the same drives both
        self.kept, self.gains = self._gains(noise, own, min(LONGEST, scene.control.steps))

    def _gains(self, noise: Values, own: Values, steps: int) -> tuple[Values, Values]:
        """Return `kept` and `gains`, from the stationary distribution on."""
        count, spread = len(self.turn), solve_discrete_lyapunov(self.turn, own)
        kept, gains = np.empty((steps, count, count)), np.empty((steps, count, 4))
        for step in range(steps):
            seen = self.shown @ spread @ self.shown.T + noise[count:, count:]
            cross = self.turn @ spread @ self.shown.T + noise[:count, count:]
            gains[step] = gain = np.linalg.solve(seen, cross.T).T
            kept[step] = left = self.turn - gain @ self.shown
            both = np.hstack([np.eye(count), -gain])
            spread = left @ spread @ left.T + both @ noise @ both.T  # Joseph's form
        return kept, gains

    def begin(self, lanes: int) -> Memory:
        """Begin in the middle of the stationary distribution."""
        return {
            **joined(innovation=self.innovation.begin(lanes)),
            "step": np.zeros(lanes, np.int64),
            "state": np.zeros((lanes, len(self.turn))),
        }

    def observe(self, memory: Memory, state: Values, applied: Values) -> Memory:
        """Return the memory; its "state" (lanes, rows) is that of the shaping filters, estimated.

        Parameters
        ----------
        memory
            Of the step before.
        state
            (lanes, 4) x1, x2 [m], v1, v2 [m/s] now.
        applied
            (lanes, k) what the actuators had in the step that led to it.
        """
        missed, known, own = self.innovation.missed(part(memory, "innovation"), state, applied)
        step, last = np.minimum(memory["step"], len(self.gains) - 1), memory["state"]
        moved = np.einsum("lij,lj->li", self.kept[step], last)
        moved += np.einsum("lij,lj->li", self.gains[step], missed)
        return {
            **joined(innovation=own),
            "step": memory["step"] + known,
            "state": chosen(known, moved, last),
        }

    def ahead(self, memory: Memory, steps: int) -> Values:
        """Return what is expected to be added to the motion (steps, lanes, 4) in steps to come."""
        state = memory["state"]
        added = np.empty((steps, len(state), 4))
        for step in added:
            step[:] = state @ self.shown.T
            state = state @ self.turn.T
        return added
