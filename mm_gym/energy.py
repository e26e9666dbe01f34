"""Energy and what changes it: eqs 9 to 12 of docs/model.md.

All integrals are of the motion from each control step's start.

Piecewise linear plants: exact quadratic forms of the state, doubled together with the propagator
(`kernels.power`), so a stiff interface, a kink of friction or a step of many periods costs no
accuracy. A motion with a cubic spring or finite stretch: Taylor series of the power, integrated
term by term between the friction's kinks (`kernels.power_series`). Neither shares code with the
plants, so a balance that closes confirms their states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.kernels import layout as at
from mm_gym.kernels import power, power_series

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.plant import Plant

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Record:
    """What a simulation remembers of its control steps.

    Attributes
    ----------
    plant
        What was simulated.
    states, applied
        (steps + 1, 4) and (steps, 2): the states at the control steps, and force [N] and stretch
        [-] held between.
    index, part
        (n,) control step that each instant of the trajectory lies in, and the time [s] since its
        start.
    """

    plant: Plant
    states: Array
    applied: Array
    index: NDArray[np.intp]
    part: Array


@dataclass(frozen=True, eq=False)
class Work:
    """Energy [J] passed through since the first instant, (n,) each.

    energy - energy[0] = control + stretch + disturbance - dissipated

    Attributes
    ----------
    control
        Work of the control force on the carriage.
    stretch
        Work of changing the stretch: the jump of the springs' potential at the offset of that
        instant.
    disturbance
        Work of disturbing forces, and of the ground's inertial forces, in the frame of the ground.
    dissipated
        Energy lost in the carriage's damper and in the interface.
    throughput
        The first instant's energy, and the absolute work of every step and kind added up: the scale
        of the balance's round-off.
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
    """Return the energy (n,) [J] of the sphere's springs in excess of the centred sphere's: eq. 10.

    For finite stretch, with e = offset / l0: k0 l0^2 e^2 (1 + 2 / (stretch (stretch^2 - e^2))), the
    integral of the neo-Hookean pair written without differences of nearly equal numbers; l0 ->
    infinity gives k2 offset^2 / 2.
    """
    if not p[at.K0]:
        return np.zeros_like(offset)
    shortened = (offset / p[at.L0]) ** 2 if p[at.L0] else 0.0
    return p[at.K0] * offset**2 * (1.0 + 2.0 / (stretch * (stretch**2 - shortened)))


def work_of(record: Record, parameters: Array, state: Array, energy: Array) -> Work:
    """Add up the work of every kind until each instant of a trajectory."""
    steps = int(record.index.max())
    applied = record.applied[:steps]
    per_step = np.zeros((steps, 4))
    per_step[:, 0] = applied[:, 0] * np.diff(record.states[: steps + 1, 0])
    # An instant between two steps shows the later stretch, so the change belongs to it.
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
    """Return energies (k, 2), dissipated and disturbing, over the beginnings of k control steps."""
    work, model = np.zeros((len(rows), 2)), record.plant.model
    nonlinear = p[at.BETA] > 0.0 or p[at.L0] > 0.0
    integrate = power_series.step_integrals if nonlinear else power.step_integrals
    tones, ground = int(model[at.TONE_COUNT]), int(model[at.GROUND])
    states, applied = record.states[rows], record.applied[rows]
    times = record.plant.time_step * rows.astype(np.float64)
    status = cast("int", integrate(p, tones, ground, states, applied, times, duration, work))
    if status > at.ENDED:
        msg = f"work: {at.MESSAGES[status]}"
        raise SimulationError(msg)
    return work
