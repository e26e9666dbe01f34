"""The scene's actuators as a controller knows them: their limits, rates and lags, and commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import columns, require_actuator
from mm_gym import DesignError

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene

FIELD = "carriage.linear_coefficient"


class Actuators:
    """Limits, rate limits and lags of force [N] and stretch [-], in the order of the action.

    A controller knows the middle of what is drawn.

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
        travel, lags = (
            [nominal(scene, f"actuation.{name}.{field}") for name in columns(scene)]
            for field in ("rate_limit", "lag")
        )
        self.travel = step * np.array(travel)
        self.lag_factor = np.array([1.0 if lag == 0.0 else -np.expm1(-step / lag) for lag in lags])
        self.is_rate = np.array([part.command == "rate" for part in parts])
        self.at_once = bool(
            np.isinf(self.travel).all()
            and (self.lag_factor == 1.0).all()
            and not self.is_rate.any()
        )
        self.middle, self.half = 0.5 * (self.high + self.low), 0.5 * (self.high - self.low)

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


def nominal(scene: Scene, name: str) -> float:
    """Return a number by dotted name or, if it is drawn, the middle of its range.

    What is not stated is infinite, as a rate limit is.
    """
    stated = scene.value_of(name)
    return float(np.mean(scene.range_of(name, np.inf if stated is None else stated)))


class Command:
    """Turn a wanted value into the action towards it, whether position or rate is commanded.

    Parameters
    ----------
    scene
        A scene with the actuator.
    name
        "force", "stretch", "damping" or "voltage".

    Attributes
    ----------
    low, high
        Limits of the value [N, -, N s/m, V].
    column
        Place of the actuator among all.
    """

    def __init__(self, scene: Scene, name: str) -> None:
        require_actuator(scene, name)
        actuators, self.name, self.column = Actuators(scene), name, columns(scene).index(name)
        self.low, self.high = (float(ends[self.column]) for ends in (actuators.low, actuators.high))
        self.travel = float(actuators.travel[self.column])
        self.is_rate = bool(actuators.is_rate[self.column])

    def present(self, applied: Values) -> Values:
        """Return the values (lanes,) among what the actuators have (lanes, k)."""
        return applied[:, self.column]

    def __call__(self, wanted: Values, present: Values) -> Values:
        """Return actions (lanes, 1) towards values (lanes,) from the present ones (lanes,).

        A wanted value beyond the actuator's range stands for the end of the range.
        """
        wanted = np.clip(wanted, self.low, self.high)
        if self.is_rate:
            action = (wanted - present) / self.travel
        else:
            action = (wanted - 0.5 * (self.high + self.low)) / (0.5 * (self.high - self.low))
        return np.clip(action, -1.0, 1.0)[:, None]


def require_stable_rest(scene: Scene, law: str) -> None:
    """Raise `DesignError` for a law that leaves the carriage to its spring, if that drives it off.

    Such laws tune the springs of the sphere, which cannot hold the carriage at x1 = 0.
    """
    if min(scene.randomization.get(FIELD, (scene.carriage.linear_coefficient,))) < 0.0:
        got = scene.randomization.get(FIELD, scene.carriage.linear_coefficient)
        msg = (
            f"{FIELD}: got {got}; allowed for the {law}: at least 0; it tunes the springs about "
            "x1 = 0, which is unstable"
        )
        raise DesignError(msg)
