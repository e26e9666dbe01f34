"""A plant as a linear system: motion, actuators, sensors and excitation in one set of matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import noise
from mm_gym.lanes import layout
from mm_gym.plant.linearise import DRIVERS, Tangent, tangent
from mm_gym.plant.point import lane_at
from mm_gym.state_space.linear_system import LinearSystem, Signal
from mm_gym.state_space.matrix_exponential import decimals, exponential
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.methods.support import Support
    from mm_gym.plant.plant import Plant

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

SEES: dict[str, tuple[str, ...]] = {
    "force": ("carriage_acceleration", "applied_force"),
    "stretch": ("carriage_acceleration", "sphere_acceleration", "spring_force", "stretch"),
    "damping": ("carriage_acceleration", "sphere_acceleration", "damping"),
    "voltage": ("carriage_acceleration", "sphere_acceleration", "voltage"),
}
"""Channels that change at once with what an actuator applies."""

POINTS = {name: row for name, row in layout.APPLIED.items() if name != "force"}
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

ROWS = {kernels.IMPULSE: process.ROWS, kernels.FILTER: noise.ROWS}


@dataclass(frozen=True)
class Source:
    """What excites: z' = F z + white noise, whose output is the excitation.

    Attributes
    ----------
    names
        Of the k states z.
    driver
        The driver that it adds to: `DISTURBANCE` or `GROUND`.
    generator, intensity
        (k, k) F [1/s], and the intensity of the white noise on the states [1/s].
    output, sampled_output
        (k,) the excitation [N] or [m/s^2] per state; the same, linear between its samples.
    transition, spread
        (k, k) exp(F h) over a sample interval, and a root of the covariance added in it; empty for
        harmonics, which are moved with the masses.
    """

    names: tuple[str, ...]
    driver: int
    generator: Array
    intensity: Array
    output: Array
    sampled_output: Array
    transition: Array
    spread: Array

    @property
    def is_random(self) -> bool:
        """Whether it is a filter of noise, not a harmonic."""
        return self.transition.size > 0


@dataclass(frozen=True)
class RandomImpulses:
    """Random impulses: their rate [1/s], and mean and mean square of their size [N s] or [m/s]."""

    driver: int
    rate: float
    mean: float
    square: float


def sources_of(support: Support, row: Array) -> list[Source]:
    """Return the harmonics and then the filters of a lane (rows,), while the envelope is 1."""
    found: list[Source] = []
    for j, ground in enumerate(support.ground):
        first = layout.HARMONICS + layout.HARMONIC_ROWS * j
        name = next(n for n, r in support.names.items() if r == first + layout.FREQUENCY)
        name, output = name.rpartition(".")[0], np.array([0.0, row[first + layout.AMPLITUDE]])
        turn = row[first + layout.FREQUENCY] * np.array([[0.0, -1.0], [1.0, 0.0]])
        names, driver = (f"{name}.cosine", f"{name}.sine"), GROUND if ground else DISTURBANCE
        known = turn, np.zeros((2, 2)), output, output, np.empty((0, 0)), np.empty((0, 0))
        found.append(Source(names, driver, *known))
    for name, slots, first in _parts_of_kind(support, kernels.FILTER):
        found.append(_filter(name, slots, first, support.sample_interval, row))
    return found


def random_impulses(support: Support, row: Array) -> list[RandomImpulses]:
    """Return the random impulses of a lane (rows,)."""
    found: list[RandomImpulses] = []
    for _, slots, first in _parts_of_kind(support, kernels.IMPULSE):
        own = slots[kernels.OWN :]
        size = float(row[first + process.SIZE])
        low, high = (size, size)
        if own[process.IS_RANGE] > 0.0:
            low, high = float(own[process.LOWEST]), float(own[process.HIGHEST])
        rate = float(row[first + process.RATE])
        if rate > 0.0:
            square = (low**2 + low * high + high**2) / 3.0
            found.append(RandomImpulses(_driver(slots), rate, 0.5 * (low + high), square))
    return found


def _parts_of_kind(support: Support, kind: int) -> Iterator[tuple[str, Array, int]]:
    """Yield dotted name, slots and first row of the parts of one kind."""
    described = support.excitation
    for k in range(int(described[0])):
        slots = described[kernels.FIRST + kernels.SIZE * k :][: kernels.SIZE]
        if int(slots[kernels.KIND]) != kind:
            continue
        first = int(slots[kernels.ROW])
        own = range(first, first + ROWS[kind])
        name = next(name for name, row in support.names.items() if row in own)
        yield name.rpartition(".")[0], slots, first


def _driver(slots: Array) -> int:
    return GROUND if slots[kernels.TARGET] > 0.0 else DISTURBANCE


def _filter(name: str, slots: Array, first: int, interval: float, row: Array) -> Source:
    passes_velocity = bool(slots[kernels.OWN + noise.PASSES_VELOCITY] > 0.0)
    own = row[first : first + noise.ROWS]
    filters = own[noise.LOW_PASS : noise.HIGH_PASS_DAMPING + 1].reshape(2, 2)
    matrices = shaping.filter_matrices(filters, interval, passes_velocity=passes_velocity)
    order = shaping.ORDER if own[noise.HIGH_PASS] > 0.0 else shaping.ORDER // 2
    transition = matrices[shaping.TRANSITION : shaping.SPREAD].reshape(shaping.ORDER, -1)
    output = matrices[shaping.OUTPUT : shaping.OUTPUT + order] * own[noise.RMS]
    stationary = _root(matrices[shaping.START_SPREAD : shaping.OUTPUT], order)
    # In continuous time nothing is lost between samples, so the variance is that at an instant.
    deviation = np.linalg.norm(output @ stationary)
    factor = own[noise.RMS] / deviation if deviation > 0.0 else 0.0
    intensity = np.zeros((order, order))
    intensity[1, 1] = own[noise.LOW_PASS]  # (E13) of docs/excitation.md
    return Source(
        names=tuple(f"{name}.filter{k + 1}" for k in range(order)),
        driver=_driver(slots),
        generator=_generator(own, order, passes_velocity=passes_velocity),
        intensity=intensity,
        output=output * factor,
        transition=transition[:order, :order].copy(),
        spread=_root(matrices[shaping.SPREAD : shaping.START_SPREAD], order),
        sampled_output=output,
    )


def _root(packed: Array, order: int) -> Array:
    """Return a Cholesky factor that is packed by rows."""
    root = np.zeros((shaping.ORDER, shaping.ORDER))
    root[np.tril_indices(shaping.ORDER)] = packed
    return root[:order, :order]


def _generator(own: Array, order: int, *, passes_velocity: bool) -> Array:
    """Return F, (E9) to (E11) of docs/excitation.md."""
    low, damping = own[noise.LOW_PASS], 2.0 * own[noise.LOW_PASS_DAMPING]
    high, high_damping = own[noise.HIGH_PASS], 2.0 * own[noise.HIGH_PASS_DAMPING]
    generator = np.zeros((shaping.ORDER, shaping.ORDER))
    generator[0, 1], generator[1, :2] = low, (-low, -damping * low)  # (E9)
    generator[2, 3] = high  # (E11)
    passed = damping if passes_velocity else 0.0  # (E10)
    generator[3] = high * np.array([1.0, passed, -1.0, -high_damping])
    return generator[:order, :order]


@dataclass(frozen=True)
class Parts:
    """What a linear system is assembled from.

    Attributes
    ----------
    plant, row
        The plant, and the lane (rows,) at the point.
    tangent
        The motion about the point.
    sources, impulses
        What excites.
    inputs, outputs
        Names.
    sampled
        Whether it is the map of a control step.
    """

    plant: Plant
    row: Array
    tangent: Tangent
    sources: list[Source]
    impulses: list[RandomImpulses]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sampled: bool

    @property
    def placed(self) -> list[tuple[slice, Source]]:
        """The sources and their states."""
        first = 4 + len(self.held)
        ends = (first + np.cumsum([len(source.output) for source in self.sources])).tolist()
        return list(zip(map(slice, [first, *ends], ends), self.sources, strict=False))

    @property
    def lags(self) -> dict[str, float]:
        """Actuator -> the fraction of the way to a command that it goes in a control step [-]."""
        task = self.plant.task
        of_device = float(task[layout.DAMPING_LAG_FACTOR])
        force, stretch = (
            float(task[layout.FORCE_LAG_FACTOR]),
            float(task[layout.STRETCH_LAG_FACTOR]),
        )
        return {"force": force, "stretch": stretch, "damping": of_device, "voltage": of_device}

    @property
    def held(self) -> tuple[str, ...]:
        """Actuators that need a state: with lag, or seen while held."""
        sees = dict(SEES)
        if self.plant.support.is_between:
            sees["force"] = (*sees["force"], "sphere_acceleration")
        return tuple(
            name
            for name, lag in self.lags.items()
            if name in self.inputs
            and (lag < 1.0 or (self.sampled and any(seen in self.outputs for seen in sees[name])))
        )

    @property
    def names(self) -> list[Signal]:
        """The states but those of the delay."""
        states = [Signal(n, u, float(self.row[k])) for k, (n, u) in enumerate(STATES.items())]
        states += [self.input_signal(name) for name in self.held]
        return states + [Signal(name, "-") for source in self.sources for name in source.names]

    def input_signal(self, name: str) -> Signal:
        """Return an input with its unit and point."""
        point = float(self.row[POINTS[name]]) if name in POINTS else 0.0
        return Signal(name, INPUTS[name], point)


def sensor_noise(parts: Parts) -> Array:
    """Return the covariance (p, p) of the sensors' noise."""
    noise = {channel.name: channel.noise for channel in parts.plant.observed}
    return np.diag([noise.get(name, 0.0) ** 2 for name in parts.outputs])


def outputs_of(parts: Parts) -> tuple[Array, Array, tuple[Signal, ...]]:
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
    for own, source in parts.placed:
        output = source.sampled_output if parts.sampled else source.output
        driven[DRIVERS[source.driver]][0][own] = output
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
        if channel.subtracted != layout.NO_ROW:
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


def state_space_of(
    plant: Plant,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    sampled: bool,
    at: Mapping[str, float] | ArrayLike | None,
    about: ArrayLike | None,
) -> LinearSystem:
    """Return a plant as a linear system; see `mm_gym.plant.plant.Plant.state_space`."""
    asked_inputs = _names("inputs", inputs, INPUTS)
    asked_outputs = _names("outputs", outputs, {**CHANNELS, **STATES})
    row = lane_at(plant.support, at, about)
    parts = Parts(
        plant=plant,
        row=row,
        tangent=tangent(plant.support, row),
        sources=sources_of(plant.support, row),
        impulses=random_impulses(plant.support, row),
        inputs=asked_inputs,
        outputs=asked_outputs,
        sampled=sampled,
    )
    return _sampled(parts) if sampled else _continuous(parts)


def _names(what: str, given: Sequence[str], allowed: Mapping[str, object]) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in allowed:
            near = suggest(str(name), allowed)
            msg = f"{what}: got {name!r}{near}; allowed: {', '.join(allowed)}"
            raise SceneError(msg)
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        msg = f"{what}: {twice[0]!r} is listed more than once"
        raise SceneError(msg)
    return names


def _continuous(parts: Parts) -> LinearSystem:
    states, inputs = parts.names, parts.inputs
    a, b = np.zeros((len(states), len(states))), np.zeros((len(states), len(inputs)))
    drivers = parts.tangent.drivers.astype(np.float64)
    a[:4, :4] = parts.tangent.a.astype(np.float64)
    for k, name in enumerate(parts.held):
        lag = -parts.plant.time_step / np.log1p(-parts.lags[name])
        a[:4, 4 + k] = drivers[:, DRIVERS.index(name)]
        a[4 + k, 4 + k], b[4 + k, inputs.index(name)] = -1.0 / lag, 1.0 / lag
    for k, name in enumerate(inputs):
        if name not in parts.held:
            b[:4, k] = drivers[:, DRIVERS.index(name)]
    noise = np.zeros_like(a)
    for own, source in parts.placed:
        a[:4, own] = np.outer(drivers[:, source.driver], source.output)
        a[own, own], noise[own, own] = source.generator, source.intensity
    drift = np.zeros(len(states))
    drift[:4] = drivers[:, ONE]
    for impulse in parts.impulses:
        kick = drivers[:, impulse.driver]
        noise[:4, :4] += impulse.rate * impulse.square * np.outer(kick, kick)
        drift[:4] += impulse.rate * impulse.mean * kick
    c, d, signals = outputs_of(parts)
    return LinearSystem(
        *(a, b, c, d, tuple(states), tuple(parts.input_signal(name) for name in inputs), signals),
        drift=drift,
        process_noise=noise,
        sensor_noise=parts.plant.time_step * sensor_noise(parts),
        time_step=None,
        dead_time=np.array(
            [parts.plant.delay * parts.plant.time_step * (n in CHANNELS) for n in parts.outputs]
        ),
    )


def _sampled(parts: Parts) -> LinearSystem:
    """Return the map of a control step, with the delay's states behind all others."""
    step, spread, kicks = _interval(parts)
    size, count = len(step), parts.plant.support.intervals_per_step
    whole, noise, mean = np.eye(size), np.zeros((size, size)), np.zeros(size)
    for _ in range(count):
        noise = step @ noise @ step.T + spread
        mean = step @ mean + kicks
        whole = step @ whole
    fixed = 4 + len(DRIVERS)  # motion and drivers; the sources stand behind them
    kept = [*range(4), *range(fixed, size)]
    held = len(parts.held)
    order = np.array([*range(4), *range(4 + held, 4 + held + size - fixed)])
    states, inputs = parts.names, parts.inputs
    a, b = np.zeros((len(states), len(states))), np.zeros((len(states), len(inputs)))
    a[np.ix_(order, order)] = whole[np.ix_(kept, kept)]
    drift, process = np.zeros(len(states)), np.zeros_like(a)
    drift[order] = (whole[:, 4 + ONE] + mean)[kept]
    process[np.ix_(order, order)] = noise[np.ix_(kept, kept)]
    for k, name in enumerate(inputs):
        column = whole[:4, 4 + DRIVERS.index(name)]
        fraction = parts.lags.get(name, 1.0)
        b[:4, k] = fraction * column
        if name in parts.held:
            row = 4 + parts.held.index(name)
            b[row, k], a[row, row] = fraction, 1.0 - fraction
            a[:4, row] = (1.0 - fraction) * column
    return _delayed(parts, a, b, drift, process)


def _interval(parts: Parts) -> tuple[Array, Array, Array]:
    """Return the map of a sample interval, the covariance that it adds, and the mean that it adds.

    The states are x1, x2, v1, v2, then `DRIVERS`, which are held, then the sources.
    """
    fixed, interval = 4 + len(DRIVERS), parts.plant.support.sample_interval
    harmonics = [source for source in parts.sources if not source.is_random]
    size = fixed + 2 + 2 * len(harmonics)  # two ramps: of the disturbance and of the ground
    generator = np.full((size, size), Decimal(0))
    generator[:4, :4], generator[:4, 4:fixed] = parts.tangent.a, parts.tangent.drivers
    for ramp, driver in enumerate((DISTURBANCE, GROUND)):
        generator[4 + driver, fixed + ramp] = 1 / Decimal(interval)
    for k, source in enumerate(harmonics):
        own = slice(fixed + 2 + 2 * k, fixed + 4 + 2 * k)
        driver = parts.tangent.drivers[:, source.driver]
        generator[:4, own] = np.outer(driver, decimals(source.output[None])[0])
        generator[own, own] = decimals(source.generator)
    moved = exponential(generator, interval)
    total = fixed + sum(len(source.output) for source in parts.sources)
    step, spread, mean = np.zeros((total, total)), np.zeros((total, total)), np.zeros(total)
    kept = [*range(fixed), *range(fixed + 2, size)]
    step[: size - 2, : size - 2] = moved[np.ix_(kept, kept)]
    step[4:fixed, 4:fixed] = np.eye(len(DRIVERS))
    first = size - 2
    for source in parts.sources[len(harmonics) :]:
        own = slice(first, first + len(source.transition))
        hold = moved[:4, 4 + source.driver]
        ramp = moved[:4, fixed + int(source.driver == GROUND)]
        now, then = source.sampled_output, source.sampled_output @ source.transition
        step[:4, own] = np.outer(hold, now) + np.outer(ramp, then - now)
        step[own, own] = source.transition
        root = np.zeros((total, len(source.transition)))
        root[:4] = np.outer(ramp, source.sampled_output @ source.spread)
        root[own] = source.spread
        spread += root @ root.T
        first = own.stop
    drivers = parts.tangent.drivers.astype(np.float64)
    for impulse in parts.impulses:
        kicks = _spread_of_kicks(parts.tangent.a, drivers[:, impulse.driver], interval)
        spread[:4, :4] += impulse.rate * impulse.square * kicks
        mean[:4] += impulse.rate * impulse.mean * moved[:4, 4 + impulse.driver]
    return step, spread, mean


def _spread_of_kicks(a: NDArray[np.object_], kick: Array, duration: float) -> Array:
    """Return the integral (4, 4) of exp(A s) kick (exp(A s) kick)' over a duration [s].

    By Gauss and Legendre over a part in which A s is small, which then is doubled.
    """
    rate = float(np.abs(a.astype(np.float64)).sum(axis=0).max())
    doublings = max(0, math.ceil(math.log2(max(rate * duration, 1.0)))) + 2
    part = duration / 2.0**doublings
    nodes, weights = np.polynomial.legendre.leggauss(8)
    moved = [exponential(a, 0.5 * part * (1.0 + float(node))) @ kick for node in nodes]
    spread = 0.5 * part * np.einsum("k,ki,kj->ij", weights, moved, moved)
    transition = exponential(a, part)
    for _ in range(doublings):
        spread += transition @ spread @ transition.T
        transition = transition @ transition
    return spread


def _delayed(parts: Parts, a: Array, b: Array, drift: Array, noise: Array) -> LinearSystem:
    """Return the sampled system; late channels are shifted through states."""
    delay, states, inputs = parts.plant.delay, parts.names, parts.inputs
    c, d, signals = outputs_of(parts)
    late = [k for k, name in enumerate(parts.outputs) if name in CHANNELS and delay]
    size, count = len(states), len(late)
    total = size + count * delay

    def grown(matrix: Array, rows: int, columns: int) -> Array:
        larger = np.zeros((rows, columns))
        larger[: matrix.shape[0], : matrix.shape[1]] = matrix
        return larger

    a, noise = grown(a, total, total), grown(noise, total, total)
    b, c, d = grown(b, total, len(inputs)), grown(c, len(c), total), d.copy()
    for age in range(1, delay + 1):
        own = slice(size + count * (age - 1), size + count * age)
        if age == 1:
            a[own], b[own] = c[late], d[late]
        else:
            a[own, own.start - count : own.start] = np.eye(count)
        states += [Signal(f"{signals[k].name}[-{age}]", *signals[k][1:]) for k in late]
    if late:
        c[late], d[late] = 0.0, 0.0
        c[late, np.arange(total - count, total)] = 1.0
    return LinearSystem(
        *(a, b, c, d, tuple(states), tuple(parts.input_signal(name) for name in inputs), signals),
        drift=np.append(drift, np.zeros(total - size)),
        process_noise=noise,
        sensor_noise=sensor_noise(parts),
        time_step=parts.plant.time_step,
        dead_time=np.zeros(len(parts.outputs)),
    )
