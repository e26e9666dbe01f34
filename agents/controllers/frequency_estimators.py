"""The frequency of a harmonic force, from the motion alone: three estimators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from agents.controllers.disturbance import ForceObserver

if TYPE_CHECKING:
    from agents.controllers.controller import Values
    from mm_gym import Scene


class FrequencyEstimator(Protocol):
    """Estimate a frequency in each lane, step by step."""

    name: str

    def begin(self, lanes: int) -> None:
        """Prepare for so many new episodes."""

    def frequency(self, state: Values, applied: Values) -> Values:
        """Return the frequencies (lanes,) [rad/s], NaN as long as they are unknown."""
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

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        self.observer.begin(lanes)
        self.forces: list[Values] = []
        self.products = np.zeros((2, lanes))

    def frequency(self, state: Values, applied: Values) -> Values:
        """Return the frequencies; they are known from the fourth step on."""
        force = self.observer.force(state, applied)
        if force is not None:
            self.forces = [*self.forces[-2:], force]
        if len(self.forces) < 3:  # noqa: PLR2004 - p[n-1], p[n], p[n+1]
            return np.full(len(state), np.nan)
        before, middle, after = self.forces
        self.products = self.memory * self.products + (middle * (before + after), 2.0 * middle**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = self.products[0] / self.products[1]
        return np.arccos(np.clip(cosine, -1.0, 1.0)) / self.step


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

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        self.observer.begin(lanes)
        self.past = np.zeros((self.length, lanes))
        self.seen = 0

    def frequency(self, state: Values, applied: Values) -> Values:
        """Return the line of largest magnitude, once the window is half full."""
        force = self.observer.force(state, applied)
        if force is not None:
            self.past = np.concatenate([self.past[1:], force[None]])
            self.seen += 1
        if 2 * self.seen < self.length:
            return np.full(len(state), np.nan)
        return self.frequencies[np.abs(self.wave @ self.past).argmax(axis=0)]


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

    def begin(self, lanes: int) -> None:
        """Begin at the first frequency."""
        self.observer.begin(lanes)
        self.value = np.zeros((2, lanes))  # in phase and in quadrature
        self.estimate = np.full(lanes, self.start)
        self.last = np.zeros(lanes)

    def frequency(self, state: Values, applied: Values) -> Values:
        """Return the frequencies to which the loop has locked so far."""
        force = self.observer.force(state, applied)
        if force is None:
            return self.estimate.copy()
        step = self.step / self.SUBSTEPS
        phase, quadrature = self.value
        for i in range(1, self.SUBSTEPS + 1):
            signal = self.last + (force - self.last) * (i / self.SUBSTEPS)
            error = signal - phase
            phase = phase + step * self.estimate * (self.damping * error - quadrature)
            quadrature = quadrature + step * self.estimate * phase
            power = np.maximum(phase**2 + quadrature**2, np.finfo(np.float64).tiny)
            turn = -self.gain * self.damping * self.estimate * error * quadrature / power
            limit = self.start
            self.estimate = np.clip(self.estimate + step * turn, 0.25 * limit, 4.0 * limit)
        self.value, self.last = np.stack([phase, quadrature]), force
        return self.estimate.copy()
