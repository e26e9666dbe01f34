"""The LQR with feed-forward: it also counters what random excitation is about to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from agents.controllers.disturbance import state_scales
from agents.controllers.lqg import MOTION, force_price, regulator
from agents.controllers.model import Model
from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import LinearSystem, Scene

UNMODELLED = 1e-3
"""Standard deviation of what else disturbs the motion in a step over the objective's scales [-]."""


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
        price, plant = force_price(scene), compile_scene(scene)
        assert scene.actuation.force is not None  # noqa: S101 - `force_price` refuses otherwise
        self.scene, self.limit = scene, scene.actuation.force.limit
        at = None if stretch is None else {"initial.stretch": stretch}
        system = plant.state_space(["force"], MOTION, sampled=True, at=at)
        names = [signal.name for signal in system.states]
        filters = [k for k, name in enumerate(names) if ".filter" in name]
        if not filters:
            msg = "excitation: it has no noise whose next values could be expected"
            raise DesignError(msg)
        gain = regulator(plant, scene, at, price, system)[1]
        self.of_motion, self.of_filters = gain[:4], gain[filters]
        self.of_force = gain[names.index("force")] if "force" in names else 0.0
        self.filter = ExcitationFilter(system, filters, UNMODELLED * state_scales(scene))

    def begin(self, lanes: int) -> None:
        """Expect nothing yet."""
        self.model = Model(self.scene, lanes)
        self.filter.begin(lanes)
        self.last: Values | None = None

    def action(self, state: Values, applied: Values) -> Values:
        """Return the force over the limit."""
        if self.last is not None:
            self.model.begin(self.last)
            self.filter.correct(state - self.model.advance(applied)[0])
        self.last = state.copy()
        force = state @ self.of_motion + self.filter.state @ self.of_filters
        return -(force + self.of_force * applied[:, 0])[:, None] / self.limit


class ExcitationFilter:
    """A Kalman filter of the shaping filters' states, from what a model of the motion missed.

    Parameters
    ----------
    system
        The sampled plant; its first states are the motion.
    rows
        Those of the shaping filters.
    unmodelled
        (4,) standard deviations of what else disturbs the motion in a step [m, m, m/s, m/s].
    """

    def __init__(self, system: LinearSystem, rows: list[int], unmodelled: Values) -> None:
        self.turn, self.shown = system.A[np.ix_(rows, rows)], system.A[:4, rows]
        own, both = system.process_noise[np.ix_(rows, rows)], system.process_noise[rows, :4]
        missed = system.process_noise[:4, :4] + np.diag(unmodelled**2)
        self.noise = np.block([[own, both], [both.T, missed]])  # the same drives both
        self.stationary = solve_discrete_lyapunov(self.turn, own)

    def begin(self, lanes: int) -> None:
        """Begin in the stationary distribution."""
        self.state: Values = np.zeros((lanes, len(self.turn)))
        self.spread = self.stationary

    def correct(self, missed: Values) -> None:
        """Advance by a step in which the model missed the motion (lanes, 4) by so much."""
        count = len(self.turn)
        seen = self.shown @ self.spread @ self.shown.T + self.noise[count:, count:]
        cross = self.turn @ self.spread @ self.shown.T + self.noise[:count, count:]
        gain = np.linalg.solve(seen, cross.T).T
        left, noise = self.turn - gain @ self.shown, np.hstack([np.eye(count), -gain])
        self.spread = left @ self.spread @ left.T + noise @ self.noise @ noise.T  # Joseph's form
        self.state = self.state @ left.T + missed @ gain.T
