"""The response of a simulated motion."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError, refuse, whole_number
from mm_gym.lanes import layout
from mm_gym.metrics.response import End, Response, Totals
from mm_gym.simulation.energy.work import CHANGE, energy_jumps, spring_energy
from mm_gym.simulation.recording import Place, Recording, excitation, states_at
from mm_gym.simulation.response import acceleration, damped
from mm_gym.simulation.trajectory import Trajectory

PIECES = 8  # pieces that a sample interval is divided into
MOST_PIECES = 1000  # of a vibration with a period in an interval (w h)^4 / 384 is then 4e-12


def response(trajectory: Trajectory, *, pieces: int = PIECES) -> Response:
    """Return the response and effort of a simulated motion, from its start to its last instant.

    The instants of the trajectory do not matter. The motion is evaluated at the start and end of
    each sample interval, before and after impulses and changes of the actuators, and in between.

    Parameters
    ----------
    pieces
        Number of pieces that each sample interval is divided into. For a vibration at w and pieces
        of h, up to (w h)^4 / 384 of the amplitudes are missed, and (w h)^2 / 8 of those of the
        acceleration.

    Raises
    ------
    SimulationError
        If it is no trajectory, or one of one instant, the number of pieces is no integer from 1 to
        1000, or the carriage has no mass.
    """
    if not isinstance(trajectory, Trajectory):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
        allowed = "a Trajectory, as simulate returns it"
        refuse("trajectory", f"{trajectory!r:.60}", allowed, SimulationError)
    pieces = whole_number("pieces", pieces, most=MOST_PIECES, error=SimulationError)
    recording, interval = trajectory.recording, trajectory.recording.plant.support.sample_interval
    end = float(trajectory.time[-1])
    if end <= float(trajectory.time[0]):
        allowed = "a motion that takes time"
        refuse("trajectory", f"one instant, t = {end:g} s", allowed, SimulationError)
    count = int(np.ceil(end / interval * (1.0 - 1e-12)))
    rows, begins, ends, jumps = _smooth_parts(recording, count, end)
    is_between = recording.plant.support.is_between
    totals = Totals(recording.parameters[:, None], is_between=is_between)
    parts = np.linspace(begins, ends, pieces + 1)  # exact at both ends
    instants = (
        _end(recording, rows, part, jumps if k == 0 else None) for k, part in enumerate(parts)
    )
    held = recording.applied[rows, 0][None]
    for start, stop in pairwise(instants):
        totals.add(start, stop, held, (ends - begins)[None] / pieces)
    totals.add_jumps(_stretch_jumps(recording, count)[None])
    return totals.response()


def _smooth_parts(
    recording: Recording, count: int, end: float
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Return the parts of so many sample intervals between impulses, until a time [s].

    They are the interval of each (n,), its begin and end (n,) [s] since the interval's start, and
    by what v1 and v2 jump at its begin (n, 2) [m/s] within the interval.
    """
    interval = recording.plant.support.sample_interval
    lengths = np.minimum(interval, end - np.arange(count) * interval)
    inner = recording.impulses[recording.impulses[:, 0] < count]
    inner = inner[inner[:, 1] < lengths[inner[:, 0].astype(np.intp)]]
    marks = np.zeros((count + len(inner), 4))
    marks[:count, 0], marks[count:] = np.arange(count), inner
    found, places = np.unique(marks[:, :2], axis=0, return_inverse=True)
    jumps = np.zeros(found.shape)
    np.add.at(jumps, places.ravel(), marks[:, 2:])
    rows, begins = found[:, 0].astype(np.intp), found[:, 1]
    ends = np.where(np.diff(rows, append=count) == 0, np.append(begins[1:], 0.0), lengths[rows])
    return rows, begins, ends, jumps


def _stretch_jumps(recording: Recording, intervals: int) -> Array:
    """Return what changes of the stretch bring in [J] at the starts of so many intervals."""
    p, start = recording.parameters, recording.states[0]
    jumps = energy_jumps(recording, intervals - 1)[:, CHANGE]
    stretches = np.array([p[layout.STRETCH], recording.applied[0, 1]])
    jumps[0] += np.diff(spring_energy(p, start[1] - start[0], stretches))[0]
    return jumps


def _end(
    recording: Recording, rows: NDArray[np.intp], part: Array, jumps: Array | None = None
) -> End:
    """Return the motion a time [s] into sample intervals: before impulses, or after them.

    After them it is if jumps (n, 2) of v1 and v2 [m/s] are given: those within the intervals.
    """
    interval = recording.plant.support.sample_interval
    whole = part >= interval
    inner = Place(np.where(whole, rows + 1, rows), np.where(whole, 0.0, part))
    state = states_at(recording, inner)
    if jumps is not None:
        state = np.where(part[:, None] > 0.0, state, recording.starts[rows])
        state[:, 2:4] += jumps
    exciting = excitation(recording, Place(rows, part))
    applied = recording.applied[rows]
    support = recording.plant.support
    absolute = acceleration(support, recording.parameters, state, applied, exciting[:, 0])
    own = damped(support, recording.parameters, applied)
    return End(
        np.ascontiguousarray(state[:, :4].T)[:, None],
        np.ascontiguousarray(absolute.T)[:, None],
        exciting[None, :, 1],
        np.broadcast_to(own[layout.D], (1, len(rows))),
    )
