"""The derivatives of what actuators apply: command, rate limit, lag and limits.

At a limit, or beyond it by no more than rounding, the derivative is that on its inner side; an
action beyond [-1, 1] changes nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.step.task import ACTUATORS, LAG_FACTOR

ROUND_OFF = 2.0**-50
"""Rounding of a command at a limit, relative to the limit."""


class Actuator(NamedTuple):
    """An actuator as the task array has it."""

    name: str  # "force" [N], "stretch" [-], "damping" [N s/m] or "voltage" [V]
    row: int  # of a lane: what it applies
    asked_row: int  # what a rate adds up to
    low: float
    high: float
    rate: float  # largest change in a control step; of lanes that differ in it, the middle
    lag_factor: float  # fraction of the way that its lag lets it go; the same
    is_rate: bool  # whether it is commanded by rate
    own: int  # first row of what each lane has for itself, or 0

    def reach(self, lanes: Array) -> tuple[Array | float, Array | float]:
        """Return the largest change in a control step, and the lag factor, of lanes."""
        if not self.own:
            return self.rate, self.lag_factor
        return lanes[self.own + layout.TRAVEL], lanes[self.own + layout.LAG_FACTOR]

    @property
    def has_memory_of_command(self) -> bool:
        """Whether what it was asked for is a state other than what it applies."""
        return self.is_rate and self.lag_factor < 1.0


class Slopes(NamedTuple):
    """Derivatives (count,) of what is applied and asked, with respect to both and to the action."""

    applied_by_applied: Array
    applied_by_asked: Array
    applied_by_action: Array
    asked_by_asked: Array
    asked_by_action: Array


def actuators_of(task: Array, device: str) -> tuple[Actuator, ...]:
    """Return the actuators of a task array, in the order of the action.

    The semi-active device has a name of its own, `Support.device`.
    """
    found: list[Actuator] = []
    for name, (slot, row, asked, own) in zip(("force", "stretch", device), ACTUATORS, strict=True):
        has, low, high, rate, is_rate, factor = task[slot : slot + LAG_FACTOR + 1].tolist()
        if has > 0.0:
            shared = low, high, rate, factor, is_rate > 0.0
            found.append(Actuator(name, row, asked, *shared, int(task[own])))
    return tuple(found)


def slopes(actuator: Actuator, lanes: Array, action: Array) -> Slopes:
    """Return the derivatives over a control step from lanes (rows, count), by actions (count,)."""
    applied, asked = lanes[actuator.row], lanes[actuator.asked_row]
    low, high, (rate, factor) = actuator.low, actuator.high, actuator.reach(lanes)
    inside = (np.abs(action) <= 1.0).astype(np.float64)
    command = np.clip(action, -1.0, 1.0)
    if actuator.is_rate:
        aim = asked + rate * command
        kept = _within(aim, low, high)
        wanted, wanted_by_asked = np.clip(aim, low, high), kept
        wanted_by_action = kept * rate * inside
    else:
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        wanted, wanted_by_asked = middle + half * command, np.zeros_like(applied)
        wanted_by_action = half * inside
    if actuator.is_rate and not actuator.has_memory_of_command:
        # What is asked is applied: one state.
        zero = np.zeros_like(applied)
        return Slopes(wanted_by_asked, zero, wanted_by_action, zero, zero)
    goal = applied + factor * (wanted - applied)
    is_free = _within(goal, applied - rate, applied + rate)
    unlimited = np.clip(goal, applied - rate, applied + rate)
    kept = _within(unlimited, low, high)
    by_wanted = kept * is_free * factor
    by_applied = kept * np.where(is_free > 0.0, 1.0 - factor, 1.0)
    return Slopes(
        by_applied,
        by_wanted * wanted_by_asked,
        by_wanted * wanted_by_action,
        wanted_by_asked,
        wanted_by_action,
    )


def _within(value: Array, low: Array | float, high: Array | float) -> Array:
    margin = ROUND_OFF * np.maximum(np.abs(low), np.abs(high))
    return ((low - margin <= value) & (value <= high + margin)).astype(np.float64)
