"""Extremum seeking: the stretch that moves the carriage least, found without a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import require_number
from agents.controllers.stretch_command import StretchCommand

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class ExtremumSeeking:
    """Wobble the stretch slowly, see whether the motion grows with it, and go the other way.

    The logarithm of the carriage's energy, averaged, passes a high-pass filter; multiplied by the
    wobble it is the slope of the cost, against which the stretch moves. Krstic and Wang, *Stability
    of extremum seeking feedback for general nonlinear dynamic systems*, Automatica 36 (2000).

    Parameters
    ----------
    wobble
        Amplitude of the wobble over the range of the stretch [-].
    period
        Of the wobble, in periods of the carriage [-].
    gain
        Rate of the stretch over its range, per slope of the logarithm and period of the carriage.
    """

    def __init__(
        self, scene: Scene, wobble: float = 0.07, period: float = 8.0, gain: float = 0.03
    ) -> None:
        for name, value in (("wobble", wobble), ("period", period), ("gain", gain)):
            require_number(name, value, np.finfo(np.float64).tiny)
        self.name = f"extremum seeking, gain {gain:.2g}"
        self.command = StretchCommand(scene)
        actuator, step = self.command.actuator, scene.control.time_step
        self.low, self.high = actuator.minimum, actuator.maximum
        frequency = np.sqrt(scene.carriage.stiffness / scene.carriage.mass)
        self.frequency = frequency
        self.turn = step * frequency / period  # of the wobble in a step [rad]
        self.wobble = wobble * (self.high - self.low)
        self.gain = gain * step * frequency / (2.0 * np.pi) * (self.high - self.low) / wobble
        self.forget = np.exp(-step * frequency / (2.0 * np.pi))  # averages over a period

    def begin(self, lanes: int) -> None:
        """Begin to seek from the stretch that is there."""
        self.step = 0
        self.centre: Values | None = None
        self.energy, self.mean = np.zeros(lanes), np.zeros(lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return the action towards the stretch that is tried."""
        present = applied[:, -1]
        if self.centre is None:
            self.centre = present.copy()
        energy = (self.frequency * state[:, 0]) ** 2 + state[:, 2] ** 2
        self.energy = self.forget * self.energy + (1.0 - self.forget) * energy
        cost = np.log(np.maximum(self.energy, np.finfo(np.float64).tiny))
        slow = 1.0 - self.turn
        self.mean = cost if self.step == 0 else slow * self.mean + (1.0 - slow) * cost
        if self.step * self.turn > 2.0 * np.pi:  # the filters have settled
            slope = (cost - self.mean) * np.sin(self.step * self.turn)
            self.centre = np.clip(self.centre - self.gain * slope, self.low, self.high)
        self.step += 1
        return self.command(self.centre + self.wobble * np.sin(self.step * self.turn), present)
