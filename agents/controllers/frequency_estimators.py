"""The frequency of a harmonic force, from the motion alone: three estimators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from agents.controllers.controller import chosen, joined, part
from agents.controllers.disturbance import ForceObserver

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Memory, Values
    from mm_gym import Scene


class FrequencyEstimator(Protocol):
    """Estimate a frequency in each lane, step by step."""

    name: str

    def begin(self, lanes: int) -> Memory:
        """Return the memory of so many new episodes."""
        ...

    def frequency(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the frequencies (lanes,) [rad/s], NaN as long as they are unknown; the memory."""
        ...


class LinearPrediction:
    """Two past forces predict the next: p[n+1] + p[n-1] = 2 cos(w h) p[n] for a harmonic force.

    The forces come from a `ForceObserver`, so that the motion's own transients do not disturb; the
    factor is fitted by least squares that forget. Kay, *Modern Spectral Estimation* (1988),
    section 11.4, has it as Prony's method.
    """

    name = "linear prediction of the force"

    def __init__(self, scene: Scene, memory: float = 0.98) -> None:
        self.observer, self.memory = ForceObserver(scene), memory
        self.step = scene.control.time_step

    def begin(self, lanes: int) -> Memory:
        """Return the memory of new episodes: no force is known."""
        return {
            **joined(observer=self.observer.begin(lanes)),
            "seen": np.zeros(lanes, np.int64),
            "forces": np.zeros((lanes, 3)),  # p[n-1], p[n], p[n+1]
            "products": np.zeros((lanes, 2)),
        }

    def frequency(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the frequencies; they are known from the fourth step on."""
        force, known, own = self.observer.force(part(memory, "observer"), state, applied)
        seen = memory["seen"] + known
        forces = np.column_stack([memory["forces"][:, 1:], force])
        before, middle, after = forces.T
        new = np.column_stack([middle * (before + after), 2.0 * middle**2])
        whole, products = seen >= forces.shape[1], memory["products"]
        products = chosen(whole, self.memory * products + new, products)
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = products[:, 0] / products[:, 1]
        frequency = np.arccos(np.clip(cosine, -1.0, 1.0)) / self.step
        memory = {"seen": seen, "forces": forces, "products": products}
        return np.where(whole, frequency, np.nan), {**joined(observer=own), **memory}


class ShortTimeFourier:
    """The peak of the force's Fourier transform over the last half second.

    Nagarajaiah and Varadarajan, *Short time Fourier transform algorithm for wind response control
    of buildings with variable stiffness TMD*, Eng. Struct. 27 (2005).
    """

    name = "short-time Fourier transform"

    def __init__(
        self, scene: Scene, band: tuple[float, float], window: float = 0.5, lines: int = 64
    ) -> None:
        step, self.observer = scene.control.time_step, ForceObserver(scene)
        self.length = max(4, round(window / step))
        self.frequencies = np.linspace(*band, lines)
        time = step * np.arange(self.length)
        self.wave = np.hanning(self.length) * np.exp(-1j * np.outer(self.frequencies, time))

    def begin(self, lanes: int) -> Memory:
        """Return the memory of new episodes: no force is known."""
        return {
            **joined(observer=self.observer.begin(lanes)),
            "seen": np.zeros(lanes, np.int64),
            "past": np.zeros((lanes, self.length)),
        }

    def frequency(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the line of largest magnitude, once the window is half full."""
        force, known, own = self.observer.force(part(memory, "observer"), state, applied)
        past = chosen(known, np.column_stack([memory["past"][:, 1:], force]), memory["past"])
        seen = memory["seen"] + known
        found = self.frequencies[np.abs(self.wave @ past.T).argmax(axis=0)]
        frequency = np.where(2 * seen < self.length, np.nan, found)
        return frequency, {**joined(observer=own), "seen": seen, "past": past}


class FrequencyLockedLoop:
    """A second-order generalised integrator in a frequency-locked loop (SOGI-FLL).

    Rodriguez, Luna, Candela, Mujal, Teodorescu and Blaabjerg, *Multiresonant frequency-locked loop
    for grid synchronization of power converters*, IEEE Trans. Ind. Electron. 58 (2011), eqs 4-7.

    Parameters
    ----------
    start
        Frequency at the start of an episode [rad/s].
    damping, gain
        Of the integrator [-], and of the loop [1/s].
    """

    name = "frequency-locked loop"
    SUBSTEPS = 16
    """A control step spans half a radian; the loop's equations are integrated more finely."""

    def __init__(
        self, scene: Scene, start: float, damping: float = 1.0, gain: float = 15.0
    ) -> None:
        self.step, self.start = scene.control.time_step, start
        self.observer = ForceObserver(scene)
        self.damping, self.gain = damping, gain

    def begin(self, lanes: int) -> Memory:
        """Return the memory of new episodes: the first frequency, and no force."""
        return {
            **joined(observer=self.observer.begin(lanes)),
            "value": np.zeros((lanes, 2)),  # in phase and in quadrature
            "estimate": np.full(lanes, self.start),
            "last": np.zeros(lanes),
        }

    def frequency(self, memory: Memory, state: Values, applied: Values) -> Acted:
        """Return the frequencies to which the loop has locked so far."""
        force, known, own = self.observer.force(part(memory, "observer"), state, applied)
        step, estimate, last = self.step / self.SUBSTEPS, memory["estimate"], memory["last"]
        phase, quadrature = memory["value"].T
        for i in range(1, self.SUBSTEPS + 1):
            signal = last + (force - last) * (i / self.SUBSTEPS)
            error = signal - phase
            phase = phase + step * estimate * (self.damping * error - quadrature)
            quadrature = quadrature + step * estimate * phase
            power = np.maximum(phase**2 + quadrature**2, np.finfo(np.float64).tiny)
            turn = -self.gain * self.damping * estimate * error * quadrature / power
            limit = self.start
            estimate = np.clip(estimate + step * turn, 0.25 * limit, 4.0 * limit)
        moved = {"value": np.column_stack([phase, quadrature]), "estimate": estimate, "last": force}
        moved = {name: chosen(known, new, memory[name]) for name, new in moved.items()}
        return moved["estimate"].copy(), {**joined(observer=own), **moved}
