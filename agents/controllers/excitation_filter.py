"""The state of the filters that shape random excitation, and what they are about to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from agents.controllers.disturbance import state_scales
from agents.controllers.model import Model
from mm_gym import DesignError

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import LinearSystem, Scene

UNMODELLED = 1e-3
"""Standard deviation of what else disturbs the motion in a step over the objective's scales [-]."""


class ExcitationFilter:
    """A Kalman filter of the shaping filters' states, from what a model of the motion missed.

    Parameters
    ----------
    scene
        The scene whose motion is observed.
    system
        Its sampled plant; the first states are the motion.

    Attributes
    ----------
    rows
        Those of the shaping filters in the system.
    state
        (lanes, rows) of the shaping filters, estimated.

    Raises
    ------
    DesignError
        If no random noise excites the scene.
    """

    def __init__(self, scene: Scene, system: LinearSystem) -> None:
        names = [signal.name for signal in system.states]
        self.rows = rows = [k for k, name in enumerate(names) if ".filter" in name]
        if not rows:
            msg = "excitation: it has no noise whose next values could be expected"
            raise DesignError(msg)
        self.scene = scene
        self.turn, self.shown = system.A[np.ix_(rows, rows)], system.A[:4, rows]
        own, both = system.process_noise[np.ix_(rows, rows)], system.process_noise[rows, :4]
        unmodelled = np.diag((UNMODELLED * state_scales(scene)) ** 2)
        missed = system.process_noise[:4, :4] + unmodelled
        self.noise = np.block([[own, both], [both.T, missed]])  # the same drives both
        self.stationary = solve_discrete_lyapunov(self.turn, own)

    def begin(self, lanes: int) -> None:
        """Begin in the stationary distribution."""
        self.model = Model(self.scene, lanes)
        self.last: Values | None = None
        self.state: Values = np.zeros((lanes, len(self.turn)))
        self.spread = self.stationary

    def observe(self, state: Values, applied: Values) -> None:
        """Learn from the states (lanes, 4) that a step with (lanes, k) applied led to."""
        if self.last is not None:
            self.model.begin(self.last)
            self._correct(state - self.model.advance(applied)[0])
        self.last = state.copy()

    def ahead(self, steps: int) -> Values:
        """Return what is expected to be added to the motion (steps, lanes, 4) in steps to come."""
        added, state = np.empty((steps, len(self.state), 4)), self.state
        for step in added:
            step[:] = state @ self.shown.T
            state = state @ self.turn.T
        return added

    def _correct(self, missed: Values) -> None:
        """Advance by a step in which the model missed the motion (lanes, 4) by so much."""
        count = len(self.turn)
        seen = self.shown @ self.spread @ self.shown.T + self.noise[count:, count:]
        cross = self.turn @ self.spread @ self.shown.T + self.noise[:count, count:]
        gain = np.linalg.solve(seen, cross.T).T
        left, noise = self.turn - gain @ self.shown, np.hstack([np.eye(count), -gain])
        self.spread = left @ self.spread @ left.T + noise @ self.noise @ noise.T  # Joseph's form
        self.state = self.state @ left.T + missed @ gain.T
