"""The recorded sample intervals of a simulation, and the position of instants in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError
from mm_gym.excitation import kinds, record
from mm_gym.excitation.impulses import pass_impulses, write_impulses
from mm_gym.excitation.kinds import next_corner, write_rows_of_jets
from mm_gym.lanes import layout
from mm_gym.plant.plant import Plant
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.parts import advance


@dataclass(frozen=True, eq=False)
class Recording:
    """The n sample intervals of a simulation."""

    plant: Plant
    parameters: Array  # (rows,) its lane with the drawn values
    # (n + 1, 4) the initial state, then the state at the end of each sample interval: x1, x2 [m],
    # v1, v2 [m/s]; (n + 1, 5) if the interface has a state of its own
    states: Array
    starts: Array  # (n, 4) or (n, 5) the state at the start of each, after impulses at that instant
    # (n, 2) the force [N] and stretch [-] held over each; (n, 3) with a damping or voltage behind
    applied: Array
    # (n, 2 * terms) excitation but harmonics and records: coefficients of force [N] and of ground
    # acceleration [m/s^2] as polynomials in the elapsed part of the interval [-]
    jets: Array

    @property
    def last(self) -> int:
        """Index of the last sample interval."""
        return len(self.starts) - 1

    @cached_property
    def impulses(self) -> Array:
        """(k, 4) the impulses within sample intervals, in their order.

        Each is the index of its interval, the time [s] since the interval's start, and by what it
        changes v1 and v2 [m/s]. Those at an interval's start are in `starts`.
        """
        found = np.empty((0, 4))
        if self.plant.support.excitation[kinds.IMPULSES]:
            for _ in range(2):  # the first time they are counted
                lane = self.parameters[:, None].copy()
                count = write_impulses(self.plant.model, lane, len(self.starts), found)
                found = np.empty((count, 4)) if len(found) < count else found
        return found

    def impulses_of(self, row: int) -> Array:
        """Return the impulses (k, 3) within a sample interval, without its index."""
        first, last = np.searchsorted(self.impulses[:, 0], (row, row + 1))
        return self.impulses[first:last, 1:]


class Place(NamedTuple):
    """Position of (n,) instants: the sample interval of each, and the time [s] since its start."""

    row: NDArray[np.intp]
    part: Array


def blank(plant: Plant, start: Array, steps: int) -> Recording:
    """Return the recording of a number of control steps before they are simulated.

    For no control step it has one sample interval, which shows the initial force and stretch.
    """
    n = max(1, steps) * plant.support.intervals_per_step
    first = start[plant.support.state_rows]
    held = start[held_rows(plant)]
    states, applied = np.empty((n + 1, len(first))), np.empty((n, len(held)))
    states[0], applied[:] = first, held
    jets = np.zeros((n, 2 * plant.support.terms))
    return Recording(plant, start, states, np.tile(first, (n, 1)), applied, jets)


def held_rows(plant: Plant) -> list[int]:
    """Return the rows of what is held over a control step: force, stretch, a semi-active device."""
    return [layout.FORCE, layout.STRETCH, *([layout.DAMPING] if plant.support.damped_row else [])]


def first(recording: Recording, count: int) -> Recording:
    """Return the first `count` sample intervals of a recording."""
    parts = {name: getattr(recording, name)[:count] for name in ("starts", "applied", "jets")}
    return replace(recording, states=recording.states[: count + 1], **parts)


def run(lanes: Lanes, commands: Array, recording: Recording, first: int = 0) -> None:
    """Simulate a control step for each row of commands (k, 2) [N, -], or (k, 3) [N, -, N s/m].

    There is one lane. The recording is written from the sample interval `first` on.
    """
    plant, last = lanes.plant, first + len(commands) * lanes.plant.support.intervals_per_step
    status = plant.entries.run_of(excited=plant.support.sampled)(
        plant.model,
        plant.task,
        lanes.kernels,
        lanes.values,
        lanes.streams,
        commands,
        recording.starts[first:last],
        recording.states[first + 1 : last + 1],
        recording.applied[first:last],
        recording.jets[first:last],
    )
    lanes.raise_for(status, unfinished=1)


def lanes_at(recording: Recording, start: tuple[Array, ...], elapsed: float = 0.0) -> Array:
    """Return lanes (rows, k) some time [s] after the starts of sample intervals.

    A start is states (k, n), what is applied (k, m) and jets (k, 2 * terms) then, and the times
    (k,) [s] at which the intervals began.
    """
    plant, (states, applied, jets, times) = recording.plant, start
    support = plant.support
    lanes = np.tile(recording.parameters[:, None], (1, len(states)))
    lanes[support.state_rows] = states.T
    lanes[held_rows(plant)] = applied.T
    if support.damped_row:
        lanes[support.damped_row] = applied[:, 2]
    lanes[support.jets : support.jets + 2 * support.terms] = jets.T
    for harmonic in plant.support.harmonic_rows:
        frequency = lanes[harmonic + layout.FREQUENCY]
        angle = lanes[harmonic + layout.PHASE] + frequency * times + frequency * elapsed
        lanes[harmonic + layout.COSINE] = np.cos(angle)
        lanes[harmonic + layout.SINE] = np.sin(angle)
    return lanes


def column(recording: Recording, row: int, elapsed: float, duration: float) -> Array:
    """Return the lane (rows,) at some time after a sample interval's start, for a duration [s].

    Its state is that of the start.
    """
    rows, began = np.array([row]), row * recording.plant.support.sample_interval
    jets = jets_over(recording, rows, elapsed, duration)
    start = recording.starts[rows], recording.applied[rows], jets, np.array([began])
    lane = lanes_at(recording, start, elapsed)[:, 0]
    for harmonic in recording.plant.support.harmonic_rows:
        turn = lane[harmonic + layout.FREQUENCY] * duration
        lane[harmonic + layout.ROTATE_COSINE] = np.cos(turn)
        lane[harmonic + layout.ROTATE_SINE] = np.sin(turn)
    return lane


def lane_at(recording: Recording, row: int) -> Array:
    """Return the lane (rows, 1) at a sample interval's start, as `Entries.cross` takes it."""
    support = recording.plant.support
    lane = column(recording, row, 0.0, support.sample_interval)[:, None].copy()
    lane[support.jets : support.jets + 2 * support.terms, 0] = recording.jets[row]
    lane[layout.BEGAN], lane[layout.NOW] = 0.0, row // support.intervals_per_step
    pass_impulses(recording.plant.model, lane, float(row))
    return lane


def jets_over(
    recording: Recording, rows: NDArray[np.intp], elapsed: float, duration: float
) -> Array:
    """Return the jets (k, 2 * terms) over a part of k sample intervals, see `column`."""
    jets = np.empty((len(rows), recording.jets.shape[1]))
    times = recording.plant.support.sample_interval * rows.astype(np.float64)
    model, lane = recording.plant.model, recording.parameters[:, None].copy()
    write_rows_of_jets(model, lane, recording.jets[rows], times, elapsed, duration, jets)
    return jets


def pieces(recording: Recording, row: int, duration: float) -> Iterator[tuple[float, float, Array]]:
    """Walk through the beginning of a sample interval, from impulse to impulse.

    It stops at corners of records too where the plant does. For each piece it yields the start
    since that of the sample interval and the length [s], and the lane (rows, 1) at its start; at
    the next piece the lane is at its end, before impulses there.
    """
    plant, elapsed = recording.plant, 0.0
    rows = plant.support.state_rows
    began = row * plant.support.sample_interval
    values, state = recording.parameters[:, None].copy(), recording.starts[row]
    impulses = recording.impulses_of(row)
    while elapsed < duration:
        end = min([duration, *impulses[impulses[:, 0] > elapsed, 0]])
        if stops_at_corners(plant):
            end = next_corner(plant.model, values, began, elapsed, end, 0)
        values[:, 0] = column(recording, row, elapsed, end - elapsed)
        values[rows, 0] = state
        yield elapsed, end - elapsed, values
        status = advance(plant, values, end - elapsed)
        if status > layout.ENDED:
            msg = f"{plant.method.name}: {layout.MESSAGES[status]}"
            raise SimulationError(msg)
        state, elapsed = values[rows, 0], end
        state[2:4] += impulses[impulses[:, 0] == elapsed, 1:].sum(axis=0)


def states_at(recording: Recording, place: Place) -> Array:
    """Return the states (n, 4) at positions, with the interface's own behind them."""
    rows = recording.plant.support.state_rows
    sampled = recording.states[place.row]
    for i in np.flatnonzero(place.part):
        *_, (_, _, lane) = pieces(recording, int(place.row[i]), float(place.part[i]))
        sampled[i] = lane[rows, 0]
    return sampled


def breaks(recording: Recording, row: int) -> list[tuple[float, Array]]:
    """Return where the motion is not smooth within a sample interval.

    That is at impulses and at corners of records: times [s] since its start, and by what v1 and v2
    [m/s] jump there.
    """
    jumps = {float(time): np.array(jump) for time, *jump in recording.impulses_of(row)}
    plant, lane = recording.plant, recording.parameters[:, None].copy()
    interval = plant.support.sample_interval
    corner = next_corner(plant.model, lane, row * interval, 0.0, interval, 0)
    while corner < interval:
        jumps.setdefault(corner, np.zeros(2))
        corner = next_corner(plant.model, lane, row * interval, corner, interval, 0)
    return sorted(jumps.items())


def stops_at_corners(plant: Plant) -> bool:
    """Tell whether the plant is propagated from corner to corner of its records."""
    return plant.entries.stops_at_corners and bool(plant.support.excitation[kinds.CORNERS])


def locate(recording: Recording, instants: Array) -> Place:
    """Return the positions of instants [s]; one on the grid is the start of a sample interval."""
    interval = recording.plant.support.sample_interval
    phase = instants / interval
    nearest = np.round(phase)
    on_grid = np.abs(phase - nearest) <= 1e-12 * np.maximum(nearest, 1.0)
    index = np.where(on_grid, nearest, np.floor(phase)).astype(np.intp)
    return Place(index, np.where(on_grid, 0.0, instants - index * interval))


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
    for harmonic, ground in zip(plant.support.harmonic_rows, support.ground, strict=True):
        angle = p[harmonic + layout.PHASE] + p[harmonic + layout.FREQUENCY] * time
        out[:, int(ground)] += p[harmonic + layout.AMPLITUDE] * np.sin(angle)
    for target, values in _records(recording, time):
        out[:, target] += values
    return out


def _records(recording: Recording, time: Array) -> Iterator[tuple[int, Array]]:
    """Yield the target and the values (n,) of each record at times of the episode [s]."""
    described, p = recording.plant.support.excitation, recording.parameters
    for part in recording.plant.support.sources:
        if part[kinds.KIND] != kinds.RECORD:
            continue
        row, block = int(part[kinds.ROW]), described[int(part[kinds.OWN + record.TABLE]) :]
        (times, values), factor = record.points_in(block, int(p[row + record.NUMBER]))
        own: Array = p[row + record.START] + time / p[row + record.TIME_SCALE]
        for end in (float(times[0]), float(times[-1])):  # rounding must not carry an instant over
            own = np.where(np.abs(own - end) <= record.ROUND_OFF * end, end, own)
        scale = p[row + record.SCALE] * factor
        yield int(part[kinds.TARGET]), scale * np.interp(own, times, values, 0.0, 0.0)
