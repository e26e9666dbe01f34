"""What a simulation remembers of its recording, and where instants lie in them."""

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
        What was simulated, and the lane (rows,) as it was drawn.
    states, starts
        (n + 1, 4) what each sample interval reached, behind the initial state; (n, 4) what each one started
        from: impulses lie in between.
    applied
        (n, 2): force [N] and stretch [-] held.
    jets
        (n, 2 * terms): coefficients of force and ground acceleration besides the harmonics.
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
    """Where (n,) instants lie: the sample interval of each, and the time [s] since its start."""

    row: NDArray[np.intp]
    part: Array


def blank(plant: Plant, start: Array, steps: int) -> Recording:
    """Return those of a simulation of some control steps before it has run.

    With no step to run it has one sample interval all the same, at rest, that shows what is held.
    """
    n = max(1, steps) * plant.support.intervals_per_step
    states, applied = np.empty((n + 1, 4)), np.empty((n, 2))
    states[0], applied[:] = start[:4], start[[at.FORCE, at.STRETCH]]
    jets = np.zeros((n, 2 * plant.support.terms))
    return Recording(plant, start, states, np.tile(start[:4], (n, 1)), applied, jets)


def first(recording: Recording, count: int) -> Recording:
    """Return the first ones only."""
    return Recording(
        recording.plant,
        recording.parameters,
        recording.states[: count + 1],
        recording.starts[:count],
        recording.applied[:count],
        recording.jets[:count],
    )


def run(lanes: Lanes, commands: Array, recording: Recording, first: int = 0) -> None:
    """Simulate a control step for each row of commands [N, -], from a sample interval on.

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
    """Return the lane (rows,) from which a sample interval was propagated, set for a duration [s]."""
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
    """Return the sample intervals that instants [s] lie in; those on the grid begin one."""
    step = recording.plant.support.sample_interval
    phase = instants / step
    nearest = np.round(phase)
    on_grid = np.abs(phase - nearest) <= 1e-12 * np.maximum(nearest, 1.0)
    index = np.where(on_grid, nearest, np.floor(phase)).astype(np.intp)
    return Place(index, np.where(on_grid, 0.0, instants - index * step))


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

    Where the excitation jumps, the value is the one after; at the very end, the one before.
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
