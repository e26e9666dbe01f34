"""The recorded sample intervals of a simulation, and the position of instants in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.plant.plant import Plant
    from mm_gym.simulation.lanes import Lanes

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """The n sample intervals of a simulation.

    Attributes
    ----------
    plant, parameters
        What was simulated, and its lane (rows,) with the drawn values.
    states
        (n + 1, 4) the initial state, then the state at the end of each sample interval: x1, x2 [m],
        v1, v2 [m/s].
    starts
        (n, 4) the state at the start of each, after the impulses at that instant.
    applied
        (n, 2) the force [N] and stretch [-] held over each.
    jets
        (n, 2 * terms) the excitation besides harmonics: coefficients of force [N] and of ground
        acceleration [m/s^2] as polynomials in the elapsed part of the interval [-].
    """

    plant: Plant
    parameters: Array
    states: Array
    starts: Array
    applied: Array
    jets: Array

    @property
    def last(self) -> int:
        """Index of the last sample interval."""
        return len(self.starts) - 1


class Place(NamedTuple):
    """Position of (n,) instants: the sample interval of each, and the time [s] since its start."""

    row: NDArray[np.intp]
    part: Array


def blank(plant: Plant, start: Array, steps: int) -> Recording:
    """Return the recording of a number of control steps before they are simulated.

    For no control step it has one sample interval, which shows the initial force and stretch.
    """
    n = max(1, steps) * plant.support.intervals_per_step
    states, applied = np.empty((n + 1, 4)), np.empty((n, 2))
    states[0], applied[:] = start[:4], start[[at.FORCE, at.STRETCH]]
    jets = np.zeros((n, 2 * plant.support.terms))
    return Recording(plant, start, states, np.tile(start[:4], (n, 1)), applied, jets)


def first(recording: Recording, count: int) -> Recording:
    """Return the first `count` sample intervals of a recording."""
    return Recording(
        recording.plant,
        recording.parameters,
        recording.states[: count + 1],
        recording.starts[:count],
        recording.applied[:count],
        recording.jets[:count],
    )


def run(lanes: Lanes, commands: Array, recording: Recording, first: int = 0) -> None:
    """Simulate a control step for each row of commands (k, 2) [N, -].

    The recording is written from the sample interval `first` on.

    Raises
    ------
    SimulationError
        If the propagation cannot be completed.
    """
    plant, last = lanes.plant, first + len(commands) * lanes.plant.support.intervals_per_step
    status = plant.method.entries.run(
        plant.model,
        plant.task,
        lanes.values,
        lanes.streams,
        commands,
        recording.starts[first:last],
        recording.states[first + 1 : last + 1],
        recording.applied[first:last],
        recording.jets[first:last],
    )
    lanes.raise_for(status)


def column(recording: Recording, row: int, duration: float) -> Array:
    """Return the lane (rows,) at the start of a sample interval, set for a duration [s]."""
    support, lane = recording.plant.support, recording.parameters.copy()
    lane[:4], lane[[at.FORCE, at.STRETCH]] = recording.starts[row], recording.applied[row]
    lane[support.jets : support.jets + 2 * support.terms] = recording.jets[row]
    for harmonic in harmonic_rows(recording.plant):
        angle, turn = phase(recording, harmonic, row), lane[harmonic + at.FREQUENCY] * duration
        lane[harmonic + at.COSINE], lane[harmonic + at.SINE] = np.cos(angle), np.sin(angle)
        lane[harmonic + at.ROTATE_COSINE], lane[harmonic + at.ROTATE_SINE] = (
            np.cos(turn),
            np.sin(turn),
        )
    return lane


def locate(recording: Recording, instants: Array) -> Place:
    """Return the positions of instants [s]; one on the grid is the start of a sample interval."""
    interval = recording.plant.support.sample_interval
    phase = instants / interval
    nearest = np.round(phase)
    on_grid = np.abs(phase - nearest) <= 1e-12 * np.maximum(nearest, 1.0)
    index = np.where(on_grid, nearest, np.floor(phase)).astype(np.intp)
    return Place(index, np.where(on_grid, 0.0, instants - index * interval))


def harmonic_rows(plant: Plant) -> range:
    """Return the first row of each harmonic."""
    return range(
        at.HARMONICS, at.HARMONICS + at.HARMONIC_ROWS * len(plant.support.ground), at.HARMONIC_ROWS
    )


def phase(recording: Recording, harmonic: int, index: int) -> float:
    """Return the phase [rad] of a harmonic at the start of a sample interval."""
    time, p = index * recording.plant.support.sample_interval, recording.parameters
    return float(p[harmonic + at.PHASE] + p[harmonic + at.FREQUENCY] * time)


def excitation(recording: Recording, place: Place) -> Array:
    """Return the disturbing force [N] and the acceleration of the ground [m/s^2], (n, 2).

    At a jump it is the value after it; at the end of the recording, the value before it.
    """
    plant, p = recording.plant, recording.parameters
    out, support = np.zeros((len(place.row), 2)), plant.support
    inner = np.minimum(place.row, recording.last)
    parts = (place.part + (place.row - inner) * support.sample_interval) / support.sample_interval
    for target in range(2):
        for n in range(support.terms):
            out[:, target] += recording.jets[inner, target * support.terms + n] * parts**n
    time = place.row * support.sample_interval + place.part
    for harmonic, ground in zip(harmonic_rows(plant), support.ground, strict=True):
        angle = p[harmonic + at.PHASE] + p[harmonic + at.FREQUENCY] * time
        out[:, int(ground)] += p[harmonic + at.AMPLITUDE] * np.sin(angle)
    return out
