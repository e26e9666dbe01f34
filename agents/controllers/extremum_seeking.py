"""Extremum seeking: the stretch that moves the carriage least, found without a model."""

import numpy as np

from agents.control.actuators import Command
from agents.control.controller import Acted, Law, Memory
from agents.control.scene import natural_frequency
from agents.controllers.registry import Entry
from mm_gym import Scene
from mm_gym.arrays import Array

WOBBLE = 0.07  # amplitude of the wobble over the range of the stretch [-]
PERIOD = 8.0  # of the wobble, in periods of the carriage [-]
GAIN = 0.03  # rate of the stretch over its range, per slope of the logarithm and carriage's period


class ExtremumSeeking(Law):
    """Wobble the stretch slowly, see whether the motion grows with it, and go the other way.

    The logarithm of the carriage's energy, averaged, passes a high-pass filter; multiplied by the
    wobble it is the slope of the cost, against which the stretch moves. Krstic and Wang, *Stability
    of extremum seeking feedback for general nonlinear dynamic systems*, Automatica 36 (2000).
    """

    name = f"extremum seeking, gain {GAIN:.2g}"

    def __init__(self, scene: Scene) -> None:
        self.command = Command(scene, "stretch")
        step, scope = scene.control.time_step, self.command.high - self.command.low
        self.frequency = frequency = natural_frequency(scene)
        self.turn = step * frequency / PERIOD  # of the wobble in a step [rad]
        self.wobble = WOBBLE * scope
        self.gain = GAIN * step * frequency / (2.0 * np.pi) * scope / WOBBLE
        self.forget = np.exp(-step * frequency / (2.0 * np.pi))  # averages over a period

    def begin(self, lanes: int) -> Memory:
        names = ("centre", "energy", "mean")
        return {"step": np.zeros(lanes, np.int64)} | {name: np.zeros(lanes) for name in names}

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        step, present = memory["step"], self.command.present(applied)
        centre = np.where(step == 0, present, memory["centre"])
        energy = (self.frequency * state[:, 0]) ** 2 + state[:, 2] ** 2
        energy = self.forget * memory["energy"] + (1.0 - self.forget) * energy
        cost = np.log(np.maximum(energy, np.finfo(np.float64).tiny))
        slow = 1.0 - self.turn
        mean = np.where(step == 0, cost, slow * memory["mean"] + (1.0 - slow) * cost)
        slope = (cost - mean) * np.sin(step * self.turn)
        moved = np.clip(centre - self.gain * slope, self.command.low, self.command.high)
        centre = np.where(step * self.turn > 2.0 * np.pi, moved, centre)  # filters have settled
        wanted = centre + self.wobble * np.sin((step + 1) * self.turn)
        kept = {"step": step + 1, "centre": centre, "energy": energy, "mean": mean}
        return self.command(wanted, present), kept


ENTRIES = (Entry("extremum-seeking", ("stretch",), ExtremumSeeking, 54, "further"),)
