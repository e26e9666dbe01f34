"""The scene's actuators as a controller knows them: from its own commands to what they reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import Scene

    Values = NDArray[np.float64]


class Actuators:
    """Limits, rate limits and lags of force [N] and stretch [-], in the order of the action.

    Attributes
    ----------
    low, high
        (k,) limits [N, -].
    travel
        (k,) most that an actuator moves in a control step [N, -], infinite without a rate limit.
    lag_factor
        (k,) fraction of the way to its command that it goes in a control step [-].
    is_rate
        (k,) whether an action commands a rate.
    at_once
        Whether all actuators reach their commands within the step.
    """

    def __init__(self, scene: Scene) -> None:
        parts = [getattr(scene.actuation, name) for name in columns(scene)]
        step = scene.control.time_step
        limits = [
            (-part.limit, part.limit) if name == "force" else (part.minimum, part.maximum)
            for name, part in zip(columns(scene), parts, strict=True)
        ]
        self.low, self.high = np.array(limits).T
        self.travel = np.array(
            [np.inf if part.rate_limit is None else part.rate_limit * step for part in parts]
        )
        self.lag_factor = np.array(
            [1.0 if part.lag == 0.0 else -np.expm1(-step / part.lag) for part in parts]
        )
        self.is_rate = np.array([part.command == "rate" for part in parts])
        self.at_once = bool(
            np.isinf(self.travel).all()
            and (self.lag_factor == 1.0).all()
            and not self.is_rate.any()
        )
        self.middle, self.half = 0.5 * (self.high + self.low), 0.5 * (self.high - self.low)

    def begin(self, applied: Values) -> None:
        """Begin with what the actuators have (lanes, k) [N, -]."""
        self.applied = applied.copy()
        self.asked = applied.copy()

    def advance(self, actions: Values) -> Values:
        """Return what the actuators reach (lanes, k) in the next control step, and keep it."""
        self.applied, self.asked = self.reached(actions, self.applied, self.asked)
        return self.applied

    def reached(self, actions: Values, applied: Values, asked: Values) -> tuple[Values, Values]:
        """Return what the actuators reach and the values commanded so far, (lanes, k) both.

        Parameters
        ----------
        actions
            (lanes, k) [-], clipped to [-1, 1].
        applied, asked
            (lanes, k): what they have, and the values commanded so far, which only rates change.
        """
        actions = np.minimum(np.maximum(actions, -1.0), 1.0)
        commanded = self.middle + self.half * actions
        if self.at_once:
            return commanded, commanded
        wanted = commanded
        if self.is_rate.any():
            with np.errstate(invalid="ignore"):  # no rate, but 0 times infinity
                rated = np.clip(asked + self.travel * actions, self.low, self.high)
            wanted = np.where(self.is_rate, rated, commanded)
        aim = applied + self.lag_factor * (wanted - applied)
        aim = np.minimum(np.maximum(aim, applied - self.travel), applied + self.travel)
        return np.minimum(np.maximum(aim, self.low), self.high), wanted
