"""A plant as a linear system: motion, actuators, sensors and excitation in one set of matrices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SceneError, check_name, refuse
from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import noise
from mm_gym.lanes import layout
from mm_gym.methods.support import Support
from mm_gym.plant.linearise import DRIVERS, Tangent, tangent
from mm_gym.plant.point import lane_at
from mm_gym.state_space.linear_system import LinearSystem, Signal
from mm_gym.state_space.matrix_exponential import decimals, exponential
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from mm_gym.plant.task import Observed

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
DISTURBANCE, GROUND, ONE = (DRIVERS.index(name) for name in ("disturbance", "ground", "one"))

FIXED = 4 + len(DRIVERS)
"""States of a whole system before its sources: the motion, and the drivers, which are held."""

LAG_FACTORS = {
    "force": layout.FORCE_LAG_FACTOR,
    "stretch": layout.STRETCH_LAG_FACTOR,
    "damping": layout.DAMPING_LAG_FACTOR,
    "voltage": layout.DAMPING_LAG_FACTOR,
}
"""Actuator -> its slot of the task."""

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
    """What excites: z' = F z + white noise, whose output is the excitation."""

    names: tuple[str, ...]  # of the k states z
    driver: int  # that it adds to: `DISTURBANCE` or `GROUND`
    generator: Array  # (k, k) F [1/s]
    intensity: Array  # (k, k) of the white noise on the states [1/s]
    output: Array  # (k,) the excitation [N] or [m/s^2] per state
    sampled_output: Array  # (k,) the same, linear between its samples
    # (k, k) exp(F h) over a sample interval, and a root of the covariance added in it; empty for
    # harmonics, which are moved with the masses
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
    for first, ground in zip(support.harmonic_rows, support.ground, strict=True):
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
    for slots in support.sources[support.sources[:, kernels.KIND] == kind]:
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
    """What a linear system is assembled from: its motion about a point, what excites, and names."""

    support: Support
    task: Array
    row: Array  # (rows,) the lane at the point
    tangent: Tangent
    sources: list[Source]
    impulses: list[RandomImpulses]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sampled: bool  # whether it is the map of a control step

    @property
    def time_step(self) -> float:
        """The control step [s]."""
        return float(self.task[layout.TIME_STEP])

    @property
    def drivers(self) -> Array:
        """(4, 7): see `Tangent.drivers`."""
        return self.tangent.drivers.astype(np.float64)

    def placed(self, first: int) -> list[tuple[slice, Source]]:
        """Return the sources and their states, whose first is given."""
        ends = (first + np.cumsum([len(source.output) for source in self.sources])).tolist()
        return list(zip(map(slice, [first, *ends], ends), self.sources, strict=False))

    @property
    def lags(self) -> dict[str, float]:
        """Actuator -> the fraction of the way to a command that it goes in a control step [-]."""
        return {name: float(self.task[slot]) for name, slot in LAG_FACTORS.items()}

    @property
    def held(self) -> tuple[str, ...]:
        """Actuators that need a state: with lag, or seen while held."""
        sees = dict(SEES)
        if self.support.is_between:
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


def _outputs_of(parts: Parts) -> tuple[Array, Array, tuple[Signal, ...]]:
    """Return C, D and the outputs, all at the same instant."""
    count = len(parts.names)
    c, d = np.zeros((len(parts.outputs), count)), np.zeros((len(parts.outputs), len(parts.inputs)))
    signals: list[Signal] = []
    # What each driver is, in terms of states and inputs.
    driven = {name: (np.zeros(count), np.zeros(len(parts.inputs))) for name in DRIVERS}
    for k, name in enumerate(parts.held):
        driven[name][0][4 + k] = 1.0
    for k, name in enumerate(parts.inputs):
        if name not in parts.held:
            driven[name][1][k] = 1.0
    for own, source in parts.placed(4 + len(parts.held)):
        output = source.sampled_output if parts.sampled else source.output
        driven[DRIVERS[source.driver]][0][own] = output
    for k, name in enumerate(parts.outputs):
        motion, weights, point = _output(parts, name)
        c[k, :4] = motion
        for driver, weight in weights.items():
            c[k] += weight * driven[driver][0]
            d[k] += weight * driven[driver][1]
        unit = CHANNELS[name].unit if name in CHANNELS else STATES[name]
        signals.append(Signal(name, unit, point))
    return c, d, tuple(signals)


def _output(parts: Parts, name: str) -> tuple[Array, dict[str, float], float]:
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
        slopes = dict(zip(DRIVERS, parts.drivers[k].tolist(), strict=True))
        return motion, {driver: slopes[driver] for driver in ABSOLUTE}, slopes["one"]
    over_offset, over_stretch = parts.tangent.spring
    if name == "spring_force":
        return (
            np.array([-over_offset, over_offset, 0.0, 0.0]),
            {"stretch": over_stretch},
            parts.tangent.spring_force,
        )
    return motion, {SHOWN[name]: 1.0}, float(row[POINTS[name]]) if name in POINTS else 0.0


def state_space_of(
    support: Support,
    task: Array,
    sensors: tuple[Sequence[Observed], int],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    sampled: bool,
    at: Mapping[str, float] | ArrayLike | None,
    about: ArrayLike | None,
) -> LinearSystem:
    """Return a plant as a linear system, see `Plant.state_space`; of sensors the delay is last."""
    asked_inputs = _names("inputs", inputs, INPUTS)
    asked_outputs = _names("outputs", outputs, {**CHANNELS, **STATES})
    for name, value in cast("Mapping[str, float]", at if hasattr(at, "keys") else {}).items():
        if name.startswith(("sensors.", "actuation.")):
            allowed = (
                "mechanics and excitation; sensors and actuators have the middle of their ranges"
            )
            refuse(f"at.{name}", repr(value), allowed)
    row = lane_at(support, at, about)
    parts = Parts(
        support=support,
        task=task,
        row=row,
        tangent=tangent(support, row),
        sources=sources_of(support, row),
        impulses=random_impulses(support, row),
        inputs=asked_inputs,
        outputs=asked_outputs,
        sampled=sampled,
    )
    observed, delay = sensors
    noise = {channel.name: channel.noise for channel in observed}
    # A continuous system has the intensity of the same effect.
    covariance = np.diag([noise.get(name, 0.0) ** 2 for name in asked_outputs])
    late = parts.time_step * delay * np.array([name in CHANNELS for name in asked_outputs])
    return LinearSystem(
        *_matrices(parts, delay if sampled else 0),
        sensor_noise=covariance if sampled else parts.time_step * covariance,
        time_step=parts.time_step if sampled else None,
        dead_time=np.zeros(len(asked_outputs)) if sampled else late,
    )


def _names(what: str, given: Sequence[str], allowed: Mapping[str, object]) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        check_name(what, name, allowed)
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        msg = f"{what}: {twice[0]!r} is listed more than once"
        raise SceneError(msg)
    return names


def _matrices(parts: Parts, delay: int) -> tuple[Any, ...]:
    """Return the fields of the system up to its process noise; a delay has states behind all."""
    a, b, drift, noise = _motion(parts)
    c, d, signals = _outputs_of(parts)
    states, size = parts.names, len(a)
    late = [k for k, name in enumerate(parts.outputs) if name in CHANNELS and delay]
    count = len(late)
    more = count * delay
    a, noise, drift = np.pad(a, (0, more)), np.pad(noise, (0, more)), np.pad(drift, (0, more))
    b, c = np.pad(b, ((0, more), (0, 0))), np.pad(c, ((0, 0), (0, more)))
    for age in range(1, delay + 1):
        own = slice(size + count * (age - 1), size + count * age)
        if age == 1:
            a[own], b[own] = c[late], d[late]
        else:
            a[own, own.start - count : own.start] = np.eye(count)
        states += [Signal(f"{signals[k].name}[-{age}]", *signals[k][1:]) for k in late]
    if late:
        c[late], d[late] = 0.0, 0.0
        c[late, np.arange(size + more - count, size + more)] = 1.0
    inputs = tuple(parts.input_signal(name) for name in parts.inputs)
    return a, b, c, d, tuple(states), inputs, signals, drift, noise


def _motion(parts: Parts) -> tuple[Array, Array, Array, Array]:
    """Return A, B, drift and process noise of motion, actuators and sources."""
    whole, noise, mean = _step(parts) if parts.sampled else _rates(parts)
    held, inputs, size = parts.held, parts.inputs, len(parts.names)
    order = np.array([*range(4), *range(4 + len(held), size)])
    kept = [*range(4), *range(FIXED, len(whole))]
    a, b, drift = np.zeros((size, size)), np.zeros((size, len(inputs))), np.zeros(size)
    process = np.zeros((size, size))
    a[np.ix_(order, order)] = whole[np.ix_(kept, kept)]
    process[np.ix_(order, order)], drift[order] = noise[np.ix_(kept, kept)], mean[kept]
    for k, name in enumerate(inputs):
        column, fraction = whole[:4, 4 + DRIVERS.index(name)], parts.lags.get(name, 1.0)
        at_once = fraction if parts.sampled else float(name not in held)
        b[:4, k] = at_once * column
        if name not in held:
            continue
        row = 4 + held.index(name)
        a[:4, row] = (1.0 - at_once) * column
        if parts.sampled:
            a[row, row], b[row, k] = 1.0 - fraction, fraction
        else:
            lag = -parts.time_step / np.log1p(-fraction)
            a[row, row], b[row, k] = -1.0 / lag, 1.0 / lag
    return a, b, drift, process


def _rates(parts: Parts) -> tuple[Array, Array, Array]:
    """Return the generator, the intensity of white noise and the drift; states as `_interval`'s."""
    total, drivers = parts.placed(FIXED)[-1][0].stop if parts.sources else FIXED, parts.drivers
    whole, noise = np.zeros((total, total)), np.zeros((total, total))
    whole[:4, :4], whole[:4, 4:FIXED] = parts.tangent.a, drivers
    for own, source in parts.placed(FIXED):
        whole[:4, own] = np.outer(drivers[:, source.driver], source.output)
        whole[own, own], noise[own, own] = source.generator, source.intensity
    drift = whole[:, 4 + ONE].copy()
    for impulse in parts.impulses:
        kick = drivers[:, impulse.driver]
        noise[:4, :4] += impulse.rate * impulse.square * np.outer(kick, kick)
        drift[:4] += impulse.rate * impulse.mean * kick
    return whole, noise, drift


def _step(parts: Parts) -> tuple[Array, Array, Array]:
    """Return the map of a control step, the covariance that it adds, and the drift."""
    step, spread, kicks = _interval(parts)
    whole, noise, mean = np.eye(len(step)), np.zeros_like(step), np.zeros(len(step))
    for _ in range(parts.support.intervals_per_step):
        noise = step @ noise @ step.T + spread
        mean = step @ mean + kicks
        whole = step @ whole
    return whole, noise, whole[:, 4 + ONE] + mean


def _interval(parts: Parts) -> tuple[Array, Array, Array]:
    """Return the map of a sample interval, the covariance that it adds, and the mean that it adds.

    The states are x1, x2, v1, v2, then `DRIVERS`, which are held, then the sources.
    """
    interval = parts.support.sample_interval
    harmonics = [source for source in parts.sources if not source.is_random]
    size = FIXED + 2 + 2 * len(harmonics)  # two ramps: of the disturbance and of the ground
    generator = np.full((size, size), Decimal(0))
    generator[:4, :4], generator[:4, 4:FIXED] = parts.tangent.a, parts.tangent.drivers
    for ramp, driver in enumerate((DISTURBANCE, GROUND)):
        generator[4 + driver, FIXED + ramp] = 1 / Decimal(interval)
    for k, source in enumerate(harmonics):
        own = slice(FIXED + 2 + 2 * k, FIXED + 4 + 2 * k)
        driver = parts.tangent.drivers[:, source.driver]
        generator[:4, own] = np.outer(driver, decimals(source.output[None])[0])
        generator[own, own] = decimals(source.generator)
    moved = exponential(generator, interval)
    total = FIXED + sum(len(source.output) for source in parts.sources)
    step, spread, mean = np.zeros((total, total)), np.zeros((total, total)), np.zeros(total)
    kept = [*range(FIXED), *range(FIXED + 2, size)]
    step[: size - 2, : size - 2] = moved[np.ix_(kept, kept)]
    step[4:FIXED, 4:FIXED] = np.eye(len(DRIVERS))
    for own, source in parts.placed(FIXED)[len(harmonics) :]:
        hold = moved[:4, 4 + source.driver]
        ramp = moved[:4, FIXED + int(source.driver == GROUND)]
        now, then = source.sampled_output, source.sampled_output @ source.transition
        step[:4, own] = np.outer(hold, now) + np.outer(ramp, then - now)
        step[own, own] = source.transition
        root = np.zeros((total, len(source.transition)))
        root[:4] = np.outer(ramp, source.sampled_output @ source.spread)
        root[own] = source.spread
        spread += root @ root.T
    for impulse in parts.impulses:
        kicks = _spread_of_kicks(parts.tangent.a, parts.drivers[:, impulse.driver], interval)
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
