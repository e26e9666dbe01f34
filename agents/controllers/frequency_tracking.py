"""Absorbers tuned to the frequency of a force: known, or found in the motion by an estimator."""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from agents.control.actuators import Command, require_stable_rest
from agents.control.controller import (
    Acted,
    Controller,
    Info,
    Law,
    Memory,
    Observation,
    Reads,
    chosen,
    joined,
    part,
)
from agents.control.model import ForceObserver
from agents.control.scene import natural_frequency, nominal, pace
from agents.controllers.registry import Entry, Free, Tunable, unless
from agents.scoring import FREQUENCY
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.analysis import spring_stiffness, stretch_for_stiffness
from mm_gym.arrays import Array

GAIN = 15.0  # of the frequency-locked loop [1/s]


class FrequencyEstimator(Protocol):
    """Estimate a frequency in each lane, step by step."""

    name: str

    def begin(self, lanes: int) -> Memory:
        """Return the memory of so many new episodes."""
        ...

    def frequency(self, memory: Memory, state: Array, applied: Array) -> Acted:
        """Return the frequencies (lanes,) [rad/s], NaN as long as they are unknown; the memory."""
        ...


class LinearPrediction:
    """Two past forces predict the next: p[n+1] + p[n-1] = 2 cos(w h) p[n] for a harmonic force.

    The forces come from a `ForceObserver`, so that the motion's own transients do not disturb; the
    factor is fitted by least squares that forget. Kay, *Modern Spectral Estimation* (1988),
    section 11.4, has it as Prony's method.
    """

    name = "linear prediction of the force"

    KEPT = 0.98  # of the sums of squares in a control step

    def __init__(self, scene: Scene) -> None:
        self.observer, self.step = ForceObserver(scene), scene.control.time_step

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(observer=self.observer.begin(lanes)),
            "seen": np.zeros(lanes, np.int64),
            "forces": np.zeros((lanes, 3)),  # p[n-1], p[n], p[n+1]
            "products": np.zeros((lanes, 2)),
        }

    def frequency(self, memory: Memory, state: Array, applied: Array) -> Acted:
        force, known, own = self.observer.force(part(memory, "observer"), state, applied)
        seen = memory["seen"] + known
        forces = np.column_stack([memory["forces"][:, 1:], force])
        before, middle, after = forces.T
        new = np.column_stack([middle * (before + after), 2.0 * middle**2])
        whole, products = seen >= forces.shape[1], memory["products"]
        products = chosen(whole, self.KEPT * products + new, products)
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = products[:, 0] / products[:, 1]
        frequency = np.arccos(np.clip(cosine, -1.0, 1.0)) / self.step
        memory = {"seen": seen, "forces": forces, "products": products}
        return np.where(whole, frequency, np.nan), {**joined(observer=own), **memory}


class ShortTimeFourier:
    """The peak of the force's Fourier transform over the last five periods of the carriage.

    Nagarajaiah and Varadarajan, *Short time Fourier transform algorithm for wind response control
    of buildings with variable stiffness TMD*, Eng. Struct. 27 (2005).
    """

    name = "short-time Fourier transform"

    WINDOW, LINES = 5.0, 64  # periods of the carriage on its spring, and frequencies

    def __init__(self, scene: Scene, band: tuple[float, float]) -> None:
        step, self.observer = scene.control.time_step, ForceObserver(scene)
        period = 2.0 * np.pi / natural_frequency(scene)
        self.length = max(4, round(self.WINDOW * period / step))
        self.frequencies = np.linspace(*band, self.LINES)
        time = step * np.arange(self.length)
        self.wave = np.hanning(self.length) * np.exp(-1j * np.outer(self.frequencies, time))

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(observer=self.observer.begin(lanes)),
            "seen": np.zeros(lanes, np.int64),
            "past": np.zeros((lanes, self.length)),
        }

    def frequency(self, memory: Memory, state: Array, applied: Array) -> Acted:
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
        Of the integrator [-], and of the loop [1/s], by default `GAIN` at the scene's `pace`.
    """

    name = "frequency-locked loop"
    SUBSTEPS = 16
    """A control step spans half a radian; the loop's equations are integrated more finely."""

    def __init__(
        self, scene: Scene, start: float, damping: float = 1.0, gain: float | None = None
    ) -> None:
        self.step, self.start = scene.control.time_step, start
        self.observer = ForceObserver(scene)
        self.damping, self.gain = damping, GAIN * pace(scene) if gain is None else gain

    def begin(self, lanes: int) -> Memory:
        return {
            **joined(observer=self.observer.begin(lanes)),
            "value": np.zeros((lanes, 2)),  # in phase and in quadrature
            "estimate": np.full(lanes, self.start),
            "last": np.zeros(lanes),
        }

    def frequency(self, memory: Memory, state: Array, applied: Array) -> Acted:
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


def reachable_band(scene: Scene) -> tuple[float, float]:
    """Return the frequencies [rad/s] with which the springs can make the sphere resonate."""
    command = Command(scene, "stretch")
    ends = spring_stiffness([command.high, command.low], nominal(scene, "springs.stiffness"))
    low, high = np.sqrt(ends / nominal(scene, "sphere.mass"))
    return float(low), float(high)


class FrequencyTracking(Law):
    """Hold the stretch at which the sphere resonates with the frequency that is estimated.

    As `MatchingStretch`, from measured signals alone. Until the estimate begins the stretch stays.
    The ratio is that of the sphere's own frequency to the one that is estimated.
    """

    def __init__(self, scene: Scene, estimator: FrequencyEstimator, ratio: float = 1.0) -> None:
        require_stable_rest(scene, "frequency tracking")
        self.name = f"frequency tracking, {estimator.name}"
        self.estimator, self.command = estimator, Command(scene, "stretch")
        self.mass = nominal(scene, "sphere.mass") * ratio**2
        self.stiffness = nominal(scene, "springs.stiffness")
        self.begin = estimator.begin

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        frequency, memory = self.estimator.frequency(memory, state, applied)
        present = self.command.present(applied)
        matching = stretch_for_stiffness(self.mass * frequency**2, self.stiffness)
        return self.command(np.where(np.isnan(frequency), present, matching), present), memory


class MatchingStretch(Controller):
    """Hold the stretch at which the sphere resonates with a known harmonic force.

    Its stiffness is k2 = m2 w^2. Den Hartog, *Mechanical Vibrations* (1956), section 3.2: at that
    frequency an undamped absorber stills the carriage.

    Raises `DesignError` if the carriage is unstable at rest.
    """

    name = "matching stretch (knows the frequency)"
    reads: Reads = "episode"

    def __init__(self, scene: Scene) -> None:
        require_stable_rest(scene, "matching stretch")
        self.command = Command(scene, "stretch")

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        k2 = env.drawn("sphere.mass") * env.drawn(FREQUENCY) ** 2
        return {"stretch": stretch_for_stiffness(k2, env.drawn("springs.stiffness"))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        present = self.command.present(info["applied"])
        return self.command(memory["stretch"], present), memory


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return start [rad/s], damping and gain [1/s] of a frequency-locked loop, and the ratio."""
    low, high = reachable_band(scene)
    return {
        "start": Free(0.5 * (low + high), 0.2 * (high - low), ratio=False, low=low, high=high),
        "damping": Free(1.0, 0.3),
        "gain": Free(GAIN * pace(scene), 0.5),
        "ratio": Free(1.0, 0.03),
    }


def _tuned_loop(scene: Scene, numbers: Mapping[str, float]) -> FrequencyTracking:
    loop = FrequencyLockedLoop(scene, numbers["start"], numbers["damping"], numbers["gain"])
    law = FrequencyTracking(scene, loop, numbers["ratio"])
    law.name += ", tuned"
    return law


_not_harmonic = unless(
    lambda scene: {part.kind for part in scene.excitation} == {"harmonic"},
    "which looks for the frequency of a harmonic, and the excitation is another one",
)


def _tracker(name: str, order: int, estimator: Callable[[Scene], FrequencyEstimator]) -> Entry:
    return Entry(
        name,
        ("stretch",),
        lambda scene: FrequencyTracking(scene, estimator(scene)),
        order,
        label=f"frequency tracking, {name}",
        refuses=_not_harmonic,
    )


ENTRIES = (
    Tunable("tuned-frequency-locked-loop", free_numbers, _tuned_loop).entry(
        ("stretch",), 27, label="frequency tracking, tuned loop", refuses=_not_harmonic
    ),
    _tracker("linear-prediction", 25, LinearPrediction),
    _tracker(
        "frequency-locked-loop",
        26,
        lambda scene: FrequencyLockedLoop(scene, 0.5 * sum(reachable_band(scene))),
    ),
    _tracker(
        "short-time-fourier", 27, lambda scene: ShortTimeFourier(scene, reachable_band(scene))
    ),
    Entry(
        "matching-stretch",
        ("stretch",),
        MatchingStretch,
        60,
        "informed",
        refuses=unless(
            lambda scene: FREQUENCY in scene.randomization,
            f"which reads {FREQUENCY}, and randomization does not draw it",
        ),
    ),
)
