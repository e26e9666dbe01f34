"""The motion of many lanes, as what is written by hand needs it: actuators and excitation."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym import compile_scene
from mm_gym.lanes import layout
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import blank, run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import Scene

    Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recorded:
    """The n sample intervals of a number of lanes.

    Attributes
    ----------
    intervals
        Sample intervals of a control step.
    start, end
        (4, lanes) the states; the end is NaN where two impulses come within one interval.
    applied
        (n, 2, lanes) force [N] and stretch.
    disturbance
        (n, 2, lanes) force [N] or ground acceleration [m/s^2] that is sampled: at the interval's
        start, and what it rises by until its end.
    harmonic
        (3, lanes) amplitude [N], frequency [rad/s] and phase [rad] of the harmonic force.
    impulses
        (n, 3, lanes) what those at the interval's start change v1 by [m/s]; time of another one
        since then [s], and what it changes v1 by.
    interval
        Length of a sample interval [s].
    by_m1
        (lanes,) 1 / mass of the carriage [1/kg].
    """

    intervals: int
    start: Values
    end: Values
    applied: Values
    disturbance: Values
    harmonic: Values
    impulses: Values
    interval: float
    by_m1: Values

    def repeated(self, times: int) -> Recorded:
        """Return the same lanes a number of times, one after the other."""
        arrays = {
            one.name: np.concatenate([value] * times, axis=-1)
            for one in fields(self)
            if isinstance(value := getattr(self, one.name), np.ndarray)
        }
        return replace(self, **arrays)


def record(scene: Scene, actions: NDArray[np.float32]) -> Recorded:
    """Return lanes of the seeds 0, 1, ... under actions (steps, lanes, actuators).

    An actuator goes towards what its action says of its range, as fast as it can.
    """
    plant = compile_scene(scene)
    steps, count, _ = actions.shape
    many, terms = plant.support.intervals_per_step, plant.support.terms
    n = steps * many
    start, end = np.empty((2, 4, count))
    applied, disturbance, impulses = (np.zeros((n, rows, count)) for rows in (2, 2, 3))
    harmonic, by_m1 = np.zeros((3, count)), np.empty(count)
    commands, lanes = _commands(scene, actions), Lanes(plant, 1)
    for i in range(count):
        lanes.seed(i)
        lanes.restart()
        one = blank(plant, lanes.values[:, 0].copy(), steps)
        run(lanes, commands[:, i].copy(), one)
        start[:, i], end[:, i], applied[:, :, i] = one.states[0], one.states[-1], one.applied
        by_m1[i] = 1.0 / one.parameters[layout.M1]
        if plant.support.ground:
            rows = [
                layout.HARMONICS + row for row in (layout.AMPLITUDE, layout.FREQUENCY, layout.PHASE)
            ]
            harmonic[:, i] = one.parameters[rows]
        if terms:
            jets = one.jets.reshape(n, 2, terms)
            disturbance[:, :, i] = jets[:, 0] + jets[:, 1]  # one of the two is excited
        impulses[:, 0, i] = one.starts[:, 2] - one.states[:-1, 2]
        rows = one.impulses[:, 0].astype(int)
        impulses[rows, 1:, i] = one.impulses[:, 1:3]
        if len(np.unique(rows)) < len(rows):
            end[:, i] = np.nan
    interval = plant.support.sample_interval
    return Recorded(many, start, end, applied, disturbance, harmonic, impulses, interval, by_m1)


def _commands(scene: Scene, actions: NDArray[np.float32]) -> Values:
    """Return the commands (steps, lanes, 2): force [N] and stretch."""
    commands = np.zeros((*actions.shape[:2], 2))
    force, stretch = scene.actuation.force, scene.actuation.stretch
    if force is not None:
        commands[:, :, 0] = force.limit * actions[:, :, 0].astype(np.float64)
    if stretch is not None:
        low, high = stretch.minimum, stretch.maximum
        own = actions[:, :, -1].astype(np.float64)
        commands[:, :, 1] = 0.5 * (high + low) + 0.5 * (high - low) * own
    return commands
