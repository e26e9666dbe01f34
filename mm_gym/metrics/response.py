"""Response and effort of motions: peaks, root mean squares, power and energies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout
from mm_gym.law import carriage_spring
from mm_gym.scene.mechanics import GRAVITY


class Cubic(NamedTuple):
    """A quantity over intervals: q(s) = c0 + c1 s + c2 s^2 + c3 s^3, with s from 0 to 1.

    Between the instants it is right to the fourth order in their spacing. For a vibration at w, the
    spacing h leaves (w h)^4 / 384 of the amplitude: 4e-4 for 10 instants a period.
    """

    c0: Array
    c1: Array
    c2: Array
    c3: Array

    def at(self, s: Array) -> Array:
        """Return the values at s."""
        return self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3))

    def turns(self) -> tuple[Array, Array]:
        """Return where the rate is zero within the interval, else its end, as two arrays of s."""
        a, b, c = 3.0 * self.c3, 2.0 * self.c2, self.c1
        inner = np.maximum(b * b - 4.0 * a * c, 0.0)
        q = -0.5 * (b + np.copysign(np.sqrt(inner), b))  # without a difference of equal numbers
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = q / a, c / q
        first, second = (np.where((s > 0.0) & (s < 1.0), s, 1.0) for s in roots)
        return np.minimum(first, second), np.maximum(first, second)

    def peak(self) -> Array:
        """Return the largest magnitude."""
        ones = np.ones_like(self.c0)
        inner = [np.abs(self.at(s)) for s in (*self.turns(), ones)]
        return np.maximum.reduce([np.abs(self.c0), *inner])

    def variation(self) -> Array:
        """Return how far it goes, there and back: the integral of the magnitude of its rate."""
        first, second = self.turns()
        stops = [self.c0, self.at(first), self.at(second), self.at(np.ones_like(self.c0))]
        return np.abs(np.diff(stops, axis=0)).sum(axis=0)

    def mean_square(self) -> Array:
        """Return the mean of the square over the interval."""
        c0, c1, c2, c3 = self
        return (
            c0 * (c0 + c1 + 2.0 / 3.0 * c2 + 0.5 * c3)
            + c1 * (c1 / 3.0 + 0.5 * c2 + 0.4 * c3)
            + c2 * (0.2 * c2 + c3 / 3.0)
            + c3 * c3 / 7.0
        )


def cubic(start: tuple[Array, Array], end: tuple[Array, Array], duration: Array | float) -> Cubic:
    """Return the cubic of given value and rate at the start and at the end of a duration [s]."""
    (q0, r0), (q1, r1) = start, end
    r0, r1, change = r0 * duration, r1 * duration, q1 - q0
    return Cubic(q0, r0, 3.0 * change - 2.0 * r0 - r1, r0 + r1 - 2.0 * change)


@dataclass(frozen=True, eq=False)
class Response:
    """Response of motions and effort of their control: an entry (lanes,) for each motion.

    A peak is the largest magnitude, max_t |q|. A root mean square is over time, (1/T integral of
    q^2 dt)^(1/2), like the normed responses of the benchmark. Symbols are those of docs/model.md,
    sections 1 and 5.

    Attributes
    ----------
    duration
        T [s].
    weight
        W = (m1 + m2) g [N].
    peak_displacement, rms_displacement
        Of the carriage, x1 [m], relative to the ground.
    peak_velocity
        Of the carriage, v1 [m/s], relative to the ground.
    peak_acceleration, rms_acceleration
        Of the carriage [m/s^2], absolute: including that of the ground, without impulses.
    peak_base_force, rms_base_force
        On the base, the base shear [N]: k1 (alpha + beta x1^2) x1 + d v1 - u, of the carriage's
        spring and damper, and the reaction to the control force; without -u if that acts between
        the masses.
    peak_stroke, rms_stroke
        Relative displacement of the sphere, x2 - x1 [m].
    peak_force, rms_force
        Control force u [N].
    peak_power
        Of the control force [W]: max_t |u v1|. For a force between the masses v1 - v2 replaces v1,
        here and in both energies.
    control_energy
        Energy that the control force supplies and absorbs [J], summed by magnitude:
        integral of |u v1| dt.
    control_work
        Supplied minus absorbed energy [J]: integral of u v1 dt.
    injected, withdrawn
        Energy that changes of the stretch bring in and take out [J], both positive: the jumps of
        (12) of docs/model.md by their sign. Only the injected energy must come from the actuator.
    """

    duration: Array
    weight: Array
    peak_displacement: Array
    rms_displacement: Array
    peak_velocity: Array
    peak_acceleration: Array
    rms_acceleration: Array
    peak_base_force: Array
    rms_base_force: Array
    peak_stroke: Array
    rms_stroke: Array
    peak_force: Array
    rms_force: Array
    peak_power: Array
    control_energy: Array
    control_work: Array
    injected: Array
    withdrawn: Array


class End(NamedTuple):
    """The starts or the ends of n intervals in each lane."""

    state: Array  # (4, lanes, n) x1, x2 [m], v1, v2 [m/s]
    acceleration: Array  # (2, lanes, n) of carriage and sphere [m/s^2], absolute
    ground: Array  # (lanes, n) acceleration of the ground [m/s^2]
    damping: Array  # (lanes, n) of the carriage [N s/m], in the interval


class Totals:
    """Peaks, integrals and energies of lanes so far, by parameters (rows, lanes).

    Between the ends of an interval displacement, stroke, velocity and base force are cubics from
    values and rates at both; the acceleration, whose rate is not known, is a line.
    """

    def __init__(self, parameters: Array, *, is_between: bool) -> None:
        if not parameters[layout.M1].all():
            msg = "carriage.mass: 0 has no finite acceleration; give it some mass"
            raise SimulationError(msg)
        self._p, lanes, self._is_between = parameters, parameters.shape[1], is_between
        self._duration = np.zeros(lanes)
        self._peaks: dict[str, Array] = {}
        self._sums: dict[str, Array] = {}
        self._none = np.zeros(lanes)

    def add(self, start: End, end: End, force: Array, duration: Array) -> None:
        """Add intervals of durations (lanes, n) [s], in which a force (lanes, n) [N] is held.

        Those of duration 0 do not count.
        """
        both = zip(self._smooth(start, force), self._smooth(end, force), strict=True)
        displacement, velocity, stroke, base_force = (cubic(*ends, duration) for ends in both)
        counts, fastest = duration > 0.0, velocity.peak()
        first, last = start.acceleration[0], end.acceleration[0]
        moved, speed, way = displacement, fastest, end.state[layout.X1] - start.state[layout.X1]
        if self._is_between:
            moved, speed = stroke, cubic(_slip(start), _slip(end), duration).peak()
            way = way - (end.state[layout.X2] - start.state[layout.X2])
        self._raise(
            counts,
            displacement=displacement.peak(),
            velocity=fastest,
            acceleration=np.maximum(np.abs(first), np.abs(last)),
            base_force=base_force.peak(),
            stroke=stroke.peak(),
            force=np.abs(force),
            power=np.abs(force) * speed,
        )
        self._add(
            counts,
            displacement=duration * displacement.mean_square(),
            acceleration=duration * (first * first + first * last + last * last) / 3.0,
            base_force=duration * base_force.mean_square(),
            stroke=duration * stroke.mean_square(),
            force=duration * force * force,
            control_energy=np.abs(force) * moved.variation(),
            control_work=force * way,
        )
        self._duration += duration.sum(axis=1)

    def add_jumps(self, jumps: Array) -> None:
        """Add energies (lanes, n) [J] that changes of the stretch bring in."""
        everywhere = np.ones(jumps.shape, np.bool_)
        self._add(everywhere, injected=np.maximum(jumps, 0.0), withdrawn=np.maximum(-jumps, 0.0))

    def response(self) -> Response:
        """Return what there is so far."""
        peaks, sums, p = self._peaks, self._sums, self._p
        if not peaks:
            msg = "no control step was added yet: call add() after each step"
            raise SimulationError(msg)
        rms = {
            f"rms_{name}": np.sqrt(sums[name] / self._duration)
            for name in ("displacement", "acceleration", "base_force", "stroke", "force")
        }
        energies = {
            name: sums.get(name, self._none).copy()
            for name in ("control_energy", "control_work", "injected", "withdrawn")
        }
        return Response(
            duration=self._duration.copy(),
            weight=(p[layout.M1] + p[layout.M2]) * GRAVITY,
            **{f"peak_{name}": value.copy() for name, value in peaks.items()},
            **rms,
            **energies,
        )

    def _smooth(self, end: End, control: Array) -> list[tuple[Array, Array]]:
        """Return value and rate of displacement, velocity, stroke and force on the base."""
        k1, alpha, beta = (self._p[row][:, None] for row in (layout.K1, layout.ALPHA, layout.BETA))
        d = end.damping
        x1, x2, v1, v2 = end.state
        relative = end.acceleration[0] - end.ground
        force = plain(carriage_spring.carriage_force)(k1, alpha, beta, x1) + d * v1
        force = force if self._is_between else force - control
        rate = k1 * (alpha + 3.0 * beta * x1 * x1) * v1 + d * relative
        return [(x1, v1), (v1, relative), (x2 - x1, v2 - v1), (force, rate)]

    def _raise(self, counts: NDArray[np.bool_], **values: Array) -> None:
        for name, value in values.items():
            largest = np.max(value, axis=1, initial=0.0, where=counts)
            self._peaks[name] = np.maximum(self._peaks.get(name, self._none), largest)

    def _add(self, counts: NDArray[np.bool_], **values: Array) -> None:
        for name, value in values.items():
            total = np.sum(value, axis=1, where=counts)
            self._sums[name] = self._sums.get(name, self._none) + total


def _slip(end: End) -> tuple[Array, Array]:
    """Return the slip velocity [m/s] and its rate [m/s^2]."""
    return end.state[layout.V2] - end.state[layout.V1], end.acceleration[1] - end.acceleration[0]
