"""What a simulation remembers of its substeps, and where instants lie in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.lanes import Lanes
    from mm_gym.plant import Plant

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Substeps:
    """The substeps of a simulation; there are n.

    Attributes
    ----------
    plant, parameters
        What was simulated, and the lane (rows,) as it was drawn.
    states, starts
        (n + 1, 4) what each substep reached, behind the initial state; (n, 4) what each one started
        from: blows lie in between.
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
        """Index of the last substep."""
        return len(self.starts) - 1


class Place(NamedTuple):
    """Where (n,) instants lie: the substep of each, and the time [s] since its start."""

    row: NDArray[np.intp]
    part: Array


def blank(plant: Plant, start: Array, steps: int) -> Substeps:
    """Return those of a simulation of some control steps before it has run.

    With no step to run it has one substep all the same, at rest, that shows what is held.
    """
    n = max(1, steps) * plant.support.substeps
    states, applied = np.empty((n + 1, 4)), np.empty((n, 2))
    states[0], applied[:] = start[:4], start[[at.FORCE, at.STRETCH]]
    jets = np.zeros((n, 2 * plant.support.terms))
    return Substeps(plant, start, states, np.tile(start[:4], (n, 1)), applied, jets)


def first(substeps: Substeps, count: int) -> Substeps:
    """Return the first ones only."""
    return Substeps(
        substeps.plant,
        substeps.parameters,
        substeps.states[: count + 1],
        substeps.starts[:count],
        substeps.applied[:count],
        substeps.jets[:count],
    )


def run(lanes: Lanes, commands: Array, substeps: Substeps, first: int = 0) -> None:
    """Simulate a control step for each row of commands [N, -], from a substep on.

    Raises
    ------
    SimulationError
        If the propagation cannot be completed.
    """
    plant, last = lanes.plant, first + len(commands) * lanes.plant.support.substeps
    status = plant.method.entries.run(
        plant.model,
        plant.task,
        lanes.values,
        lanes.streams,
        commands,
        substeps.starts[first:last],
        substeps.states[first + 1 : last + 1],
        substeps.applied[first:last],
        substeps.jets[first:last],
    )
    lanes.raise_for(status)


def column(substeps: Substeps, row: int, duration: float) -> Array:
    """Return the lane (rows,) from which a substep was propagated, set for a duration [s]."""
    support, lane = substeps.plant.support, substeps.parameters.copy()
    lane[:4], lane[[at.FORCE, at.STRETCH]] = substeps.starts[row], substeps.applied[row]
    lane[support.jets : support.jets + 2 * support.terms] = substeps.jets[row]
    for tone in tone_rows(substeps.plant):
        angle, turn = phase(substeps, tone, row), lane[tone + at.FREQUENCY] * duration
        lane[tone + at.COSINE], lane[tone + at.SINE] = np.cos(angle), np.sin(angle)
        lane[tone + at.ROTATE_COSINE], lane[tone + at.ROTATE_SINE] = np.cos(turn), np.sin(turn)
    return lane


def locate(substeps: Substeps, instants: Array) -> Place:
    """Return the substeps that instants [s] lie in; those on the grid begin one."""
    step = substeps.plant.support.time_step
    phase = instants / step
    nearest = np.round(phase)
    on_grid = np.abs(phase - nearest) <= 1e-12 * np.maximum(nearest, 1.0)
    index = np.where(on_grid, nearest, np.floor(phase)).astype(np.intp)
    return Place(index, np.where(on_grid, 0.0, instants - index * step))


def tone_rows(plant: Plant) -> range:
    """Return the first row of each harmonic."""
    return range(at.TONES, at.TONES + at.TONE_ROWS * len(plant.support.ground), at.TONE_ROWS)


def phase(substeps: Substeps, tone: int, index: int) -> float:
    """Return the phase [rad] of a harmonic at the start of a substep."""
    time, p = index * substeps.plant.support.time_step, substeps.parameters
    return float(p[tone + at.PHASE] + p[tone + at.FREQUENCY] * time)


def excitation(substeps: Substeps, place: Place) -> Array:
    """Return the disturbing force [N] and the acceleration of the ground [m/s^2], (n, 2).

    Where the excitation jumps, the value is the one after; at the very end, the one before.
    """
    plant, p = substeps.plant, substeps.parameters
    out, support = np.zeros((len(place.row), 2)), plant.support
    inner = np.minimum(place.row, substeps.last)
    parts = (place.part + (place.row - inner) * support.time_step) / support.time_step
    for target in range(2):
        for n in range(support.terms):
            out[:, target] += substeps.jets[inner, target * support.terms + n] * parts**n
    time = place.row * support.time_step + place.part
    for tone, ground in zip(tone_rows(plant), support.ground, strict=True):
        angle = p[tone + at.PHASE] + p[tone + at.FREQUENCY] * time
        out[:, int(ground)] += p[tone + at.AMPLITUDE] * np.sin(angle)
    return out
