"""The parts of a linear system: its signals, its sources of excitation, its outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.lanes import layout as at
from mm_gym.plant.linearise import DRIVERS, Tangent
from mm_gym.state_space.linear_system import Signal
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support
    from mm_gym.plant.filters import RandomImpulses, ShapingFilter

    Array = NDArray[np.float64]


INPUTS = {
    "force": "N",
    "stretch": "-",
    "damping": "N s/m",
    "voltage": "V",
    "disturbance": "N",
    "ground": "m/s^2",
}
"""Inputs and their units."""

STATES = {"x1": "m", "x2": "m", "v1": "m/s", "v2": "m/s"}
FORCE, STRETCH, DAMPING, VOLTAGE, DISTURBANCE, GROUND, ONE = range(len(DRIVERS))


@dataclass(frozen=True)
class ControlLoop:
    """A plant's motion, actuators and sensors, as far as a linear system shows them.

    Attributes
    ----------
    support
        All values that the scene can reach.
    lags
        Of "force", "stretch", "damping" and "voltage": the fraction of the way to a command that
        the actuator goes in a control step [-].
    noise
        Standard deviation [SI] of the noise of each channel that the scene observes, by name.
    time_step
        Length of a control step [s].
    delay
        Age of the newest frame in control steps.
    """

    support: Support
    lags: dict[str, float]
    noise: dict[str, float]
    time_step: float
    delay: int


@dataclass(frozen=True)
class Parts:
    """What a linear system is assembled from.

    Attributes
    ----------
    loop, row
        The plant's control loop, and the lane (rows,) at the point.
    tangent
        The motion about the point.
    filters, impulses
        Random excitation.
    inputs, outputs
        Names.
    held
        Actuators whose force [N], stretch [-] or damping [N s/m] is a state.
    """

    loop: ControlLoop
    row: Array
    tangent: Tangent
    filters: list[ShapingFilter]
    impulses: list[RandomImpulses]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    held: tuple[str, ...]

    @property
    def harmonics(self) -> list[tuple[str, bool, float, float]]:
        """Dotted name, whether it shakes the ground, amplitude and frequency of each harmonic."""
        support = self.loop.support
        found: list[tuple[str, bool, float, float]] = []
        for j, ground in enumerate(support.ground):
            first = at.HARMONICS + at.HARMONIC_ROWS * j
            name = next(n for n, r in support.names.items() if r == first + at.FREQUENCY)
            amplitude, frequency = self.row[first + at.AMPLITUDE], self.row[first + at.FREQUENCY]
            found.append((name.rpartition(".")[0], ground, float(amplitude), float(frequency)))
        return found

    @property
    def names(self) -> list[Signal]:
        """The states but those of the delay."""
        states = [Signal(n, u, float(self.row[k])) for k, (n, u) in enumerate(STATES.items())]
        states += [self.input_signal(name) for name in self.held]
        for name, *_ in self.harmonics:
            states += [Signal(f"{name}.cosine", "-"), Signal(f"{name}.sine", "-")]
        for source in self.filters:
            count = len(source.generator)
            states += [Signal(f"{source.name}.filter{k + 1}", "-") for k in range(count)]
        return states

    def input_signal(self, name: str) -> Signal:
        """Return an input with its unit and point."""
        point = float(self.row[POINTS[name]]) if name in POINTS else 0.0
        return Signal(name, INPUTS[name], point)


class Source(NamedTuple):
    """A source of excitation: its first state, target, output, generator and intensity."""

    row: int
    ground: bool
    output: Array
    generator: Array
    intensity: Array


def sources_of(parts: Parts) -> list[Source]:
    """Return the harmonics, then the filters."""
    found: list[Source] = []
    row = 4 + len(parts.held)
    for _, ground, amplitude, frequency in parts.harmonics:
        turn = frequency * np.array([[0.0, -1.0], [1.0, 0.0]])
        found.append(Source(row, ground, np.array([0.0, amplitude]), turn, np.zeros((2, 2))))
        row += 2
    for source in parts.filters:
        own = source.output, source.generator, source.intensity
        found.append(Source(row, source.ground, *own))
        row += len(source.output)
    return found


def sensor_noise(parts: Parts) -> Array:
    """Return the covariance (p, p) of the sensors' noise."""
    return np.diag([parts.loop.noise.get(name, 0.0) ** 2 for name in parts.outputs])


def outputs_of(parts: Parts, *, sampled: bool) -> tuple[Array, Array, tuple[Signal, ...]]:
    """Return C, D and the outputs, all at the same instant."""
    count, drivers = len(parts.names), parts.tangent.drivers.astype(np.float64)
    c, d = np.zeros((len(parts.outputs), count)), np.zeros((len(parts.outputs), len(parts.inputs)))
    signals: list[Signal] = []
    # What each driver is, in terms of states and inputs.
    driven = {name: (np.zeros(count), np.zeros(len(parts.inputs))) for name in DRIVERS}
    for k, name in enumerate(parts.held):
        driven[name][0][4 + k] = 1.0
    for k, name in enumerate(parts.inputs):
        if name not in parts.held:
            driven[name][1][k] = 1.0
    for row, ground, output, _, _ in sources_of(parts):
        own = slice(row, row + len(output))
        driven["ground" if ground else "disturbance"][0][own] += output
    if sampled:  # the samples' own factor
        first = count - sum(len(source.output) for source in parts.filters)
        for source in parts.filters:
            own = slice(first, first + len(source.output))
            driven["ground" if source.ground else "disturbance"][0][own] = source.sampled_output
            first = own.stop
    for k, name in enumerate(parts.outputs):
        motion, weights, point = _output(parts, drivers, name)
        c[k, :4] = motion
        for driver, weight in weights.items():
            c[k] += weight * driven[driver][0]
            d[k] += weight * driven[driver][1]
        unit = CHANNELS[name].unit if name in CHANNELS else STATES[name]
        signals.append(Signal(name, unit, point))
    return c, d, tuple(signals)


def _output(parts: Parts, drivers: Array, name: str) -> tuple[Array, dict[str, float], float]:
    """Return an output's slopes over x1, x2, v1, v2 and over drivers, and its point."""
    motion, row = np.zeros(4), parts.row
    if name in STATES:
        k = list(STATES).index(name)
        motion[k] = 1.0
        return motion, {}, float(row[k])
    channel = CHANNELS[name]
    if channel.row < 4:  # noqa: PLR2004 - one of the state, or a difference
        motion[channel.row] = 1.0
        point = float(row[channel.row])
        if channel.subtracted != at.NO_ROW:
            motion[channel.subtracted] = -1.0
            point -= float(row[channel.subtracted])
        return motion, {}, point
    if name in ("carriage_acceleration", "sphere_acceleration"):
        k = 2 if name == "carriage_acceleration" else 3
        motion = parts.tangent.a.astype(np.float64)[k]
        # Absolute, so without the ground's own acceleration.
        weights = {driver: float(drivers[k, DRIVERS.index(driver)]) for driver in ABSOLUTE}
        return motion, weights, float(drivers[k, ONE])
    over_offset, over_stretch = parts.tangent.spring
    if name == "spring_force":
        return (
            np.array([-over_offset, over_offset, 0.0, 0.0]),
            {"stretch": over_stretch},
            parts.tangent.spring_force,
        )
    return motion, {SHOWN[name]: 1.0}, float(row[POINTS[name]]) if name in POINTS else 0.0


POINTS = {name: row for name, row in at.APPLIED.items() if name != "force"}
"""Rows of the inputs that are not 0 at the point."""

SHOWN = {
    "applied_force": "force",
    "stretch": "stretch",
    "damping": "damping",
    "voltage": "voltage",
    "disturbance_force": "disturbance",
    "ground_acceleration": "ground",
}
"""The driver that each of the other channels shows."""

ABSOLUTE = ("force", "stretch", "damping", "voltage", "disturbance")
"""Drivers of the absolute accelerations."""
