"""Control steps of a lane by SciPy, from a right-hand side of its own: docs/model.md.

For interfaces in value form, and springs that harden: `double_double_kernel` knows neither.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from .double_double_kernel import AMPLITUDE, GROUND, KIND, LAST, UNTIL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .bounds import Step

    Array = NDArray[np.float64]

CARRIAGE = "mass", "stiffness", "damping", "linear_coefficient", "cubic_coefficient"
SPRINGS = "none", "linear", "small_on_large", "finite_stretch"
KINDS = "none", "viscous", "stribeck", "bouc_wen", "magnetorheological"
FIELDS = {
    "none": (),
    "viscous": ("damping",),
    "stribeck": (
        *("static_coefficient", "kinetic_coefficient", "reference_velocity"),
        *("stribeck_velocity", "slip_damping", "normal_force"),
    ),
    "bouc_wen": (
        *("stiffness", "yield_displacement", "stiffness_ratio", "exponent", "shape", "damping"),
    ),
    "magnetorheological": (
        *("damping", "damping_per_volt", "series_damping", "series_damping_per_volt"),
        *("hysteresis", "hysteresis_per_volt", "stiffness", "accumulator_stiffness"),
        *("accumulator_offset", "gain", "gamma", "beta", "voltage"),
    ),
}
"""Of an interface, in the order in which `_link` takes them."""

RELATIVE, ABSOLUTE, SMALLEST = 1e-13, 1e-17, 1e-7
"""Errors of SciPy's steps: relative, in units of a state's size, and the least size."""

STEPS, FINER = 20, 10
"""Of a control step at least: estimates miss kinks between two stages; and how many times as many
settle a doubt."""


@njit
def _link(kind, p, x, w, y, z):
    """Return the force [N] between the masses but for the springs', and both own rates."""
    if kind == 1:
        return p[0] * w, 0.0, 0.0
    if kind == 2:
        mu = p[1] + (p[0] - p[1]) * math.exp(-((w / p[3]) ** 2))
        return p[5] * mu * w / math.hypot(w, p[2]) + p[4] * w, 0.0, 0.0
    if kind == 3:
        k, uy, alpha, n, beta, c = p[0], p[1], p[2], p[3], p[4], p[5]
        against = beta * abs(w) * np.sign(y) + (1.0 - beta) * w
        return (
            c * w + alpha * k * x + (1.0 - alpha) * k * uy * y,
            (w - abs(y) ** n * against) / uy,
            0.0,
        )
    if kind == 4:
        u = p[12]
        c0, c1, alpha = p[0] + p[1] * u, p[2] + p[3] * u, p[4] + p[5] * u
        flow = (alpha * z + c0 * w + p[6] * (x - y)) / (c0 + c1)
        shear = w - flow
        bent = p[9] * shear - p[10] * abs(shear) * z * abs(z) - p[11] * shear * z**2
        return c1 * flow + p[7] * (x - p[8]), flow, bent
    return 0.0, 0.0, 0.0


@njit
def _angle(shape, frequency, growth, time):
    """Return what a wave turns by [rad]."""
    if shape == 1.0:
        return (frequency + 0.5 * growth * time) * time
    if shape == 2.0 and growth != 0.0:
        return frequency * math.expm1(growth * time) / growth
    return frequency * time


@njit
def _rates(t, state, kinds, body, spring, p, held, lines, oscillators):
    """Return the rates of the states at a time [s] since the control step's start."""
    x1, x2, v1, v2 = state[0], state[1], state[2], state[3]
    y = state[4] if len(state) > 4 else 0.0
    z = state[5] if len(state) > 5 else 0.0
    m1, k1, d, alpha, beta, m2 = body
    u = x2 - x1
    link, first, second = _link(kinds[0], p, u, v2 - v1, y, z)
    if kinds[1] == 1:
        link += spring[0] * (u + spring[1] * u**3)
    elif kinds[1] == 2:
        link += 2.0 * spring[0] * (1.0 + 2.0 / spring[2] ** 3) * u
    elif kinds[1] == 3:
        one, other = spring[2] + u / spring[3], spring[2] - u / spring[3]
        link += spring[0] * spring[3] * (one - one**-2 - other + other**-2)
    push = lines[0] + lines[1] * t
    shake = lines[2] + lines[3] * t
    for j in range(len(oscillators)):
        amplitude, ground, sine, cosine, shape, frequency, growth, begin = oscillators[j]
        s = t - begin
        angle = _angle(shape, frequency, growth, s)
        value = amplitude * (sine * math.cos(angle) + cosine * math.sin(angle))
        if ground > 0.0:
            shake += value
        else:
            push += value
    on_carriage = push + held[0] - d * v1 - k1 * (alpha * x1 + beta * x1**3)
    rates = np.empty(len(state))
    rates[0], rates[1] = v1, v2
    rates[2] = (link + on_carriage) / m1 - shake
    rates[3] = (held[1] - link) / m2 - shake
    if len(state) > 4:
        rates[4] = first
    if len(state) > 5:
        rates[5] = second
    return rates


def end_of(
    numbers: dict[str, float], kinds: tuple[str, str], step: Step, start: Array, steps: int = STEPS
) -> tuple[Array, Array]:
    """Return the end of a control step, and the largest magnitudes on the way.

    Parameters
    ----------
    numbers
        By dotted name, what the lane has in this step: the fields of carriage, sphere, interface
        and springs, and "force" and "reaction" [N] on carriage and sphere.
    kinds
        Of interface and springs.
    step
        What excites it.
    start
        (n,) x1, x2 [m], v1, v2 [m/s], and the interface's own states.
    steps
        Made of the control step at least.
    """

    def values(part: str, fields: Sequence[str]) -> Array:
        return np.array([numbers.get(f"{part}.{field}", 0.0) for field in fields])

    fixed = (
        (KINDS.index(kinds[0]), SPRINGS.index(kinds[1])),
        np.append(values("carriage", CARRIAGE), numbers["sphere.mass"]),
        values("springs", ("stiffness", "cubic_coefficient", "stretch", "rest_length")),
        np.append(values("interface", FIELDS[kinds[0]]), 0.0),
        np.array([numbers["force"], numbers["reaction"]]),
    )
    state, largest, now = start.copy(), np.abs(start), 0.0
    waves, total = _waves(step), step.lengths.sum()
    for k, (length, line) in enumerate(
        zip(step.lengths.sum(axis=1), step.lines.sum(axis=2), strict=True)
    ):
        state[2:4] += step.jumps[k]
        largest = np.maximum(largest, np.abs(state))
        for j in range(len(waves)):
            if step.oscillators[j, KIND] > 0.0 and k == step.oscillators[j, UNTIL]:
                waves[j] = _turned(waves[j], now, step.oscillators[j, LAST])
        slopes = (line[1] - line[0]) / length, (line[3] - line[2]) / length
        lines = np.array(
            [line[0] - slopes[0] * now, slopes[0], line[2] - slopes[1] * now, slopes[1]]
        )
        with np.errstate(over="ignore", invalid="ignore"):  # in steps tried too long
            found = solve_ivp(
                *(_rates, (now, now + length), state, "DOP853"),
                args=(*fixed, lines, waves),
                rtol=RELATIVE,
                atol=ABSOLUTE * np.maximum(largest, SMALLEST),
                max_step=total / steps,
            )
        assert found.success
        state, now = found.y[:, -1], now + length
        largest = np.maximum(largest, np.abs(found.y).max(axis=1))
    return state, largest


def _waves(step: Step) -> Array:
    """Return for each oscillator amplitude, target, sine, cosine, shape, frequency, growth, 0."""
    return np.array(
        [
            (one[AMPLITUDE], one[GROUND], phase[0, 0], phase[1, 0], one[KIND], *phase[2:, 0], 0.0)
            for one, phase in zip(step.oscillators, step.phases, strict=True)
        ]
    ).reshape(-1, 8)


def _turned(wave: Array, now: float, last: float) -> Array:
    """Return a sweep that is over now: a harmonic of its last frequency."""
    angle = math.atan2(wave[2], wave[3]) + _angle(wave[4], wave[5], wave[6], now)
    return np.array([*wave[:2], math.sin(angle), math.cos(angle), 0.0, last, 0.0, now])
