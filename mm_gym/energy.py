"""Energy and what changes it: eqs 9-12 of docs/model.md. All integrals are of the motion from each control step's start.

Piecewise linear plants: exact quadratic forms of the state, doubled together with the propagator (`kernels.power`), so
a stiff interface, a kink of friction or a step of many periods costs no accuracy. A motion with a cubic spring or
finite stretch: Gauss-Legendre quadrature at states that the plant itself propagates, halving where it has not
converged; a change of friction's regime is thereby enclosed until it no longer matters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.kernels import layout as at
from mm_gym.kernels import power
from mm_gym.lanes import Lanes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.plant import Plant

    Array = NDArray[np.float64]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)

CONVERGED = 1e-13
"""Largest change that halving makes to a step's integral, relative to the energy it passes through."""

DEEPEST = 48
"""Halvings of a control step: an interval of dt / 2^48 around a jump of the power no longer matters."""


@dataclass(frozen=True, eq=False)
class Record:
    """What a simulation remembers of its control steps.

    Attributes
    ----------
    plant
        What was simulated.
    states, applied
        (steps + 1, 4) and (steps, 2): the states at the control steps, and force [N] and stretch [-] held between.
    index, part
        (n,) control step that each instant of the trajectory lies in, and the time [s] since its start.
    """

    plant: Plant
    states: Array
    applied: Array
    index: NDArray[np.intp]
    part: Array


@dataclass(frozen=True, eq=False)
class Work:
    """Energy [J] passed through since the first instant, (n,) each: energy - energy[0] = control + stretch + disturbance - dissipated.

    Attributes
    ----------
    control
        Work of the control force on the carriage.
    stretch
        Work of changing the stretch: the jump of the springs' potential at the offset of that instant.
    disturbance
        Work of disturbing forces, and of the ground's inertial forces, in the frame of the ground.
    dissipated
        Energy lost in the carriage's damper and in the interface.
    throughput
        The first instant's energy, and the absolute work of every step and kind added up: the scale of the balance's round-off.
    """

    control: Array
    stretch: Array
    disturbance: Array
    dissipated: Array
    throughput: Array

    @property
    def total(self) -> Array:
        """What the energy has grown by (n,) [J], according to the work."""
        return self.control + self.stretch + self.disturbance - self.dissipated


def mechanical_energy(p: Array, state: Array, stretch: Array) -> Array:
    """Return kinetic and elastic energy (n,) [J] of states (n, 4), eq. 9 of docs/model.md."""
    x1, x2, v1, v2 = state.T
    carriage = p[at.K1] * (0.5 * p[at.ALPHA] * x1**2 + 0.25 * p[at.BETA] * x1**4)
    return (
        0.5 * (p[at.M1] * v1**2 + p[at.M2] * v2**2) + carriage + spring_energy(p, x2 - x1, stretch)
    )


def spring_energy(p: Array, offset: Array, stretch: Array) -> Array:
    """Return the sphere's springs' energy (n,) [J] in excess of the centred sphere's, eq. 10 of docs/model.md.

    For finite stretch, with e = offset / l0: k0 l0^2 e^2 (1 + 2 / (stretch (stretch^2 - e^2))), the integral of the
    neo-Hookean pair written without differences of nearly equal numbers; l0 -> infinity gives k2 offset^2 / 2.
    """
    if not p[at.K0]:
        return np.zeros_like(offset)
    shortened = (offset / p[at.L0]) ** 2 if p[at.L0] else 0.0
    return p[at.K0] * offset**2 * (1.0 + 2.0 / (stretch * (stretch**2 - shortened)))


def work_of(record: Record, parameters: Array, state: Array, energy: Array) -> Work:
    """Add up the work of every kind until each instant of a trajectory."""
    steps = int(record.index.max())
    starts, applied = record.states[:steps], record.applied[:steps]
    per_step = np.zeros((steps, 4))
    per_step[:, 0] = applied[:, 0] * np.diff(record.states[: steps + 1, 0])
    # An instant on a step's boundary shows the stretch from there on, so the change there belongs to it.
    changes = np.zeros(steps + 1)
    inner = min(steps + 1, len(record.applied))
    offset = record.states[1:inner, 1] - record.states[1:inner, 0]
    new, old = record.applied[1:inner, 1], record.applied[: inner - 1, 1]
    changes[1:inner] = spring_energy(parameters, offset, new) - spring_energy(
        parameters, offset, old
    )
    dt = record.plant.time_step
    per_step[:, 2:] = _integrals(record, parameters, np.arange(steps), dt)
    until = np.vstack([np.zeros((1, 4)), np.cumsum(per_step, axis=0)])
    until[:, 1] = np.cumsum(changes)
    passed = np.concatenate([[0.0], np.cumsum(np.abs(per_step).sum(axis=1))]) + np.cumsum(
        np.abs(changes)
    )
    totals, throughput = until[record.index], passed[record.index]  # copies
    for i in np.flatnonzero(record.part):
        n = int(record.index[i])
        part = np.zeros(4)
        part[0] = record.applied[n, 0] * (state[i, 0] - record.states[n, 0])
        part[2:] = _integrals(record, parameters, np.array([n]), float(record.part[i]))[0]
        totals[i] += part
        throughput[i] += np.abs(part).sum()
    totals -= totals[0].copy()
    throughput += energy[0] - throughput[0]
    return Work(totals[:, 0], totals[:, 1], totals[:, 3], totals[:, 2], throughput)


def _integrals(record: Record, p: Array, rows: NDArray[np.intp], duration: float) -> Array:
    """Return energies (k, 2) dissipated and brought in by the disturbance over the beginnings of k control steps."""
    work = np.zeros((len(rows), 2))
    if p[at.BETA] or (p[at.K0] and p[at.L0]):
        return _by_quadrature(record, p, rows, duration)
    model, times = record.plant.model, record.plant.time_step * rows
    status = power.step_integrals(
        p,
        int(model[at.TONE_COUNT]),
        int(model[at.GROUND]),
        record.states[rows],
        record.applied[rows],
        times,
        duration,
        work,
    )
    if status > at.ENDED:
        msg = f"work: {at.MESSAGES[status]}"
        raise SimulationError(msg)
    return work


def _by_quadrature(record: Record, p: Array, rows: NDArray[np.intp], duration: float) -> Array:
    """Return the integrals over the steps, every interval halved until halving no longer changes them."""
    work = np.zeros((len(rows), 2))
    at_start = mechanical_energy(p, record.states[rows], record.applied[rows, 1])
    open_intervals = [
        (0.0, duration, np.arange(len(rows)), _panel(record, p, rows, 0.0, duration), 0)
    ]
    while open_intervals:
        begin, end, members, coarse, halvings = open_intervals.pop()
        middle = 0.5 * (begin + end)
        left = _panel(record, p, rows[members], begin, middle)
        right = _panel(record, p, rows[members], middle, end)
        scale = at_start[members] + np.abs(coarse).sum(axis=1)
        close = np.abs(left + right - coarse).max(axis=1) <= CONVERGED * scale
        if halvings == DEEPEST:
            close[:] = True
        np.add.at(work, members[close], (left + right)[close])
        if not np.all(close):
            rest = members[~close]
            open_intervals.append((begin, middle, rest, left[~close], halvings + 1))
            open_intervals.append((middle, end, rest, right[~close], halvings + 1))
    return work


def _panel(record: Record, p: Array, rows: NDArray[np.intp], begin: float, end: float) -> Array:
    """Return the Gauss-Legendre integral of both powers between two times of the steps, (k, 2)."""
    half = 0.5 * (end - begin)
    total = np.zeros((len(rows), 2))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        time = begin + half * (1.0 + float(node))
        state = _states_after(record, p, rows, time)
        total += (
            weight * half * _powers(record.plant, p, state, record.plant.time_step * rows + time)
        )
    return total


def _states_after(record: Record, p: Array, rows: NDArray[np.intp], time: float) -> Array:
    """Return the states (k, 4) a time [s] after the starts of k control steps, by the plant's own method."""
    part = record.plant.at_time_step(time)
    idle = part.task.copy()
    idle[[at.HAS_FORCE, at.HAS_STRETCH]] = 0.0  # what was applied stays applied
    lanes = Lanes(replace(part, task=idle), len(rows))
    lanes.values[:] = p[:, None]
    lanes.values[:4] = record.states[rows].T
    lanes.values[[at.FORCE, at.STRETCH]] = record.applied[rows].T
    for tone in range(at.TONES, len(p), at.TONE_ROWS):
        angle = p[tone + at.PHASE] + p[tone + at.FREQUENCY] * (record.plant.time_step * rows)
        lanes.values[tone + at.COSINE], lanes.values[tone + at.SINE] = np.cos(angle), np.sin(angle)
    lanes.raise_for(lanes.advance(np.empty((len(rows), 0))))
    return lanes.values[:4].T.copy()


def _powers(plant: Plant, p: Array, state: Array, time: Array) -> Array:
    """Return the powers (k, 2) [W] dissipated and brought in by the disturbance."""
    v1, v2 = state[:, 2], state[:, 3]
    powers = np.column_stack(
        [p[at.D] * v1**2 + interface_force(p, v2 - v1) * (v2 - v1), np.zeros(len(v1))]
    )
    for j, ground in enumerate(plant.support.ground):
        tone = at.TONES + at.TONE_ROWS * j
        value = p[tone + at.AMPLITUDE] * np.sin(p[tone + at.FREQUENCY] * time + p[tone + at.PHASE])
        powers[:, 1] += -value * (p[at.M1] * v1 + p[at.M2] * v2) if ground else value * v1
    return powers


def interface_force(p: Array, w: Array) -> Array:
    """Return f(w) [N], the force of the interface on the carriage: eq. 9 of the paper, or c w."""
    if not p[at.VR]:
        return p[at.C] * w
    slip = np.sign(w) * (p[at.MU2] * p[at.FN] + p[at.CHI] * (np.abs(w) - p[at.VR]))
    return np.where(np.abs(w) <= p[at.VR], p[at.MU1] * p[at.FN] / p[at.VR] * w, slip)
