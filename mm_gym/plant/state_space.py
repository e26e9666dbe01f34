"""A plant as a linear system: motion, actuators, sensors and excitation in one set of matrices."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.plant.filters import random_impulses, shaping_filters
from mm_gym.plant.linear_parts import (
    DISTURBANCE,
    GROUND,
    INPUTS,
    ONE,
    STATES,
    ControlLoop,
    Parts,
    outputs_of,
    sensor_noise,
    sources_of,
)
from mm_gym.plant.linearise import DRIVERS, tangent
from mm_gym.plant.point import lane_at
from mm_gym.state_space.linear_system import LinearSystem, Signal
from mm_gym.state_space.matrix_exponential import decimals, exponential
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]


def state_space_of(
    loop: ControlLoop,
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
    row = lane_at(loop.support, at, about)
    parts = Parts(
        loop=loop,
        row=row,
        tangent=tangent(loop.support, row),
        filters=shaping_filters(loop.support, row),
        impulses=random_impulses(loop.support, row),
        inputs=asked_inputs,
        outputs=asked_outputs,
        held=_held(loop, asked_inputs, asked_outputs, sampled=sampled),
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


SEES: dict[str, tuple[str, ...]] = {
    "force": ("carriage_acceleration", "applied_force"),
    "stretch": ("carriage_acceleration", "sphere_acceleration", "spring_force", "stretch"),
    "damping": ("carriage_acceleration", "sphere_acceleration", "damping"),
    "voltage": ("carriage_acceleration", "sphere_acceleration", "voltage"),
}
"""Channels that change at once with what an actuator applies."""


def _held(
    loop: ControlLoop, inputs: tuple[str, ...], outputs: tuple[str, ...], *, sampled: bool
) -> tuple[str, ...]:
    """Return the actuators that need a state: with lag, or seen while held."""
    sees = dict(SEES)
    if loop.support.is_between:
        sees["force"] = (*sees["force"], "sphere_acceleration")
    return tuple(
        name
        for name, lag in loop.lags.items()
        if name in inputs
        and (lag < 1.0 or (sampled and any(channel in outputs for channel in sees[name])))
    )


def _continuous(parts: Parts) -> LinearSystem:
    states, inputs = parts.names, parts.inputs
    a, b = np.zeros((len(states), len(states))), np.zeros((len(states), len(inputs)))
    drivers = parts.tangent.drivers.astype(np.float64)
    a[:4, :4] = parts.tangent.a.astype(np.float64)
    for k, name in enumerate(parts.held):
        lag = -parts.loop.time_step / np.log1p(-parts.loop.lags[name])
        a[:4, 4 + k] = drivers[:, DRIVERS.index(name)]
        a[4 + k, 4 + k], b[4 + k, inputs.index(name)] = -1.0 / lag, 1.0 / lag
    for k, name in enumerate(inputs):
        if name not in parts.held:
            b[:4, k] = drivers[:, DRIVERS.index(name)]
    noise = np.zeros_like(a)
    for row, ground, output, generator, intensity in sources_of(parts):
        own = slice(row, row + len(output))
        a[:4, own] = np.outer(drivers[:, GROUND if ground else DISTURBANCE], output)
        a[own, own], noise[own, own] = generator, intensity
    drift = np.zeros(len(states))
    drift[:4] = drivers[:, ONE]
    for impulse in parts.impulses:
        kick = drivers[:, GROUND if impulse.ground else DISTURBANCE]
        noise[:4, :4] += impulse.rate * impulse.square * np.outer(kick, kick)
        drift[:4] += impulse.rate * impulse.mean * kick
    c, d, signals = outputs_of(parts, sampled=False)
    return LinearSystem(
        *(a, b, c, d, tuple(states), tuple(parts.input_signal(name) for name in inputs), signals),
        drift=drift,
        process_noise=noise,
        sensor_noise=parts.loop.time_step * sensor_noise(parts),
        time_step=None,
        dead_time=np.array(
            [parts.loop.delay * parts.loop.time_step * (n in CHANNELS) for n in parts.outputs]
        ),
    )


def _sampled(parts: Parts) -> LinearSystem:
    """Return the map of a control step, with the delay's states behind all others."""
    step, spread, kicks = _interval(parts)
    size, count = len(step), parts.loop.support.intervals_per_step
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
        fraction = parts.loop.lags.get(name, 1.0)
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
    sources, fixed = sources_of(parts), 4 + len(DRIVERS)
    interval, harmonics = parts.loop.support.sample_interval, parts.harmonics
    size = fixed + 2 + 2 * len(harmonics)  # two ramps: of the disturbance and of the ground
    generator = np.full((size, size), Decimal(0))
    generator[:4, :4], generator[:4, 4:fixed] = parts.tangent.a, parts.tangent.drivers
    for ramp, driver in enumerate((DISTURBANCE, GROUND)):
        generator[4 + driver, fixed + ramp] = 1 / Decimal(interval)
    shift = 4 + len(parts.held)
    for k, (row, ground, output, turn, _) in enumerate(sources[: len(harmonics)]):
        own = slice(fixed + 2 + 2 * k, fixed + 4 + 2 * k)
        driver = parts.tangent.drivers[:, GROUND if ground else DISTURBANCE]
        generator[:4, own] = np.outer(driver, decimals(output[None])[0])
        generator[own, own] = decimals(turn)
        assert row == shift + 2 * k  # noqa: S101 - as `sources_of` orders them
    moved = exponential(generator, interval)
    total = fixed + sum(len(source.output) for source in sources)
    step, spread, mean = np.zeros((total, total)), np.zeros((total, total)), np.zeros(total)
    kept = [*range(fixed), *range(fixed + 2, size)]
    step[: size - 2, : size - 2] = moved[np.ix_(kept, kept)]
    step[4:fixed, 4:fixed] = np.eye(len(DRIVERS))
    first = size - 2
    for source in parts.filters:
        own = slice(first, first + len(source.transition))
        driver = GROUND if source.ground else DISTURBANCE
        hold, ramp = moved[:4, 4 + driver], moved[:4, fixed + int(source.ground)]
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
        driver = GROUND if impulse.ground else DISTURBANCE
        spread[:4, :4] += (
            impulse.rate
            * impulse.square
            * _spread_of_kicks(parts.tangent.a, drivers[:, driver], interval)
        )
        mean[:4] += impulse.rate * impulse.mean * moved[:4, 4 + driver]
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
    loop, states, inputs = parts.loop, parts.names, parts.inputs
    c, d, signals = outputs_of(parts, sampled=True)
    late = [k for k, name in enumerate(parts.outputs) if name in CHANNELS and loop.delay]
    size, count = len(states), len(late)
    total = size + count * loop.delay

    def grown(matrix: Array, rows: int, columns: int) -> Array:
        larger = np.zeros((rows, columns))
        larger[: matrix.shape[0], : matrix.shape[1]] = matrix
        return larger

    a, noise = grown(a, total, total), grown(noise, total, total)
    b, c, d = grown(b, total, len(inputs)), grown(c, len(c), total), d.copy()
    for age in range(1, loop.delay + 1):
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
        time_step=loop.time_step,
        dead_time=np.zeros(len(parts.outputs)),
    )
