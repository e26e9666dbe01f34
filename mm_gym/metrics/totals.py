"""Peaks, integrals and energies of lanes, added up interval by interval."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout as at
from mm_gym.law import carriage_spring
from mm_gym.metrics.cubic import cubic
from mm_gym.metrics.response import Response
from mm_gym.scene.mechanics import GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class End(NamedTuple):
    """The starts or the ends of n intervals in each lane.

    Attributes
    ----------
    state
        (4, lanes, n) x1, x2 [m], v1, v2 [m/s].
    acceleration
        (2, lanes, n) of carriage and sphere [m/s^2], absolute.
    ground
        (lanes, n) acceleration of the ground [m/s^2].
    damping
        (lanes, n) of the carriage [N s/m], in the interval.
    """

    state: Array
    acceleration: Array
    ground: Array
    damping: Array


class Totals:
    """Peaks, integrals and energies of lanes so far.

    Between the ends of an interval displacement, stroke, velocity and base force are cubics from
    values and rates at both; the acceleration, whose rate is not known, is a line.

    Parameters
    ----------
    parameters
        (rows, lanes) of the motions.
    is_between
        Whether the control force acts between the masses, and not between ground and carriage.

    Raises
    ------
    SimulationError
        If a carriage has no mass: its acceleration is not finite.
    """

    def __init__(self, parameters: Array, *, is_between: bool) -> None:
        if not parameters[at.M1].all():
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
        displacement, velocity, stroke, base_force = (
            cubic(first, last, duration)
            for first, last in zip(
                self._smooth(start, force), self._smooth(end, force), strict=True
            )
        )
        counts, fastest = duration > 0.0, velocity.peak()
        first, last = start.acceleration[0], end.acceleration[0]
        moved, speed, way = displacement, fastest, end.state[at.X1] - start.state[at.X1]
        if self._is_between:
            moved, speed = stroke, cubic(_slip(start), _slip(end), duration).peak()
            way = way - (end.state[at.X2] - start.state[at.X2])
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
            weight=(p[at.M1] + p[at.M2]) * GRAVITY,
            **{f"peak_{name}": value.copy() for name, value in peaks.items()},
            **rms,
            **energies,
        )

    def _smooth(self, end: End, control: Array) -> list[tuple[Array, Array]]:
        """Return value and rate of displacement, velocity, stroke and force on the base.

        The reaction to a control force (lanes, n) [N] that acts on the ground is part of the last.
        """
        k1, alpha, beta = (self._p[row][:, None] for row in (at.K1, at.ALPHA, at.BETA))
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
    return end.state[at.V2] - end.state[at.V1], end.acceleration[1] - end.acceleration[0]
