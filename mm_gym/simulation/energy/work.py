"""Energy and what changes it: eqs 9 to 12 of docs/model.md.

All integrals are of the motion from each sample interval's start.

Piecewise linear plants: exact quadratic forms of the state, doubled together with the propagator
(`rate_kernel`), so a stiff interface, a kink of friction or a step of many periods costs no
accuracy. A motion with a cubic spring or finite stretch: Taylor series of the energy rate,
integrated term by term between the friction's kinks (`rate_series_kernel`).

Interfaces in value form: quadrature along the motion, which the plant's own method makes
(`quadrature`); such a balance says nothing of the method.

The others have in common with the methods the laws of the forces (one file each in `law`), the
search for changes of regime (`law.events`), and the excitation (`excitation`); the energy of an
interface is that which trajectories show (`simulation.response`). No method propagates a state for
them, except from impulse to impulse and from corner to corner of a record (`recording.pieces`): the
series are those of `sensitivity.series_kernel`. So a balance that closes confirms how the plants
propagate, and not the laws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law import carriage_spring, springs
from mm_gym.simulation.energy import quadrature, rate_kernel
from mm_gym.simulation.recording import Place, Recording, jets_over, pieces, stops_at_corners
from mm_gym.simulation.response import damped, interface_energy

CONTROL, CHANGE, DISSIPATED, DISTURBANCE = range(4)
"""Columns of the work of each kind; CHANGE is that of changing the stretch, or the voltage."""


@dataclass(frozen=True, eq=False)
class Work:
    """Energy [J] passed through since the first instant, (n,) each.

    energy - energy[0] = control + stretch + disturbance - dissipated

    Attributes
    ----------
    control
        Work of the control force: on the carriage, or between the masses on both.
    stretch
        Work of changing the stretch: the jump of the springs' potential at the offset of that
        instant. And the same of a magnetorheological damper whose voltage changes.
    disturbance
        Work of disturbing forces, and of the ground's inertial forces, in the frame of the ground.
    dissipated
        Energy lost in the carriage's damper and in the interface.
    throughput
        The first instant's energy, and the absolute work of every step and kind added up: the scale
        of the balance's round-off. Where the carriage's spring has a negative coefficient, the
        largest `gross_energy` so far takes the place of the first instant's energy.
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
    carriage = plain(carriage_spring.carriage_energy)(
        p[layout.K1], p[layout.ALPHA], p[layout.BETA], x1
    )
    springs = spring_energy(p, x2 - x1, stretch)
    return 0.5 * (p[layout.M1] * v1**2 + p[layout.M2] * v2**2) + carriage + springs


def gross_energy(p: Array, state: Array, stretch: Array) -> Array:
    """Return the energies (n,) [J] of `mechanical_energy` added up by their magnitudes."""
    q = p.copy()
    q[[layout.ALPHA, layout.BETA]] = np.abs(p[[layout.ALPHA, layout.BETA]])
    return mechanical_energy(q, state, stretch)


def spring_energy(p: Array, offset: Array, stretch: Array) -> Array:
    """Return the energy (n,) [J] of the sphere's springs in excess of the centred sphere's."""
    return plain(springs.spring_energy)(p[layout.K0], p[layout.L0], stretch, offset)


def work_of(recording: Recording, place: Place, state: Array, energy: Array) -> Work:
    """Add up the work of every kind until each instant of a trajectory."""
    steps, step = int(place.row.max()), recording.plant.support.sample_interval
    per_step = np.zeros((steps, 4))
    run = _reach(recording, recording.states[1 : steps + 1], recording.starts[:steps])
    per_step[:, CONTROL] = recording.applied[:steps, 0] * run
    per_step[:, DISSIPATED:] = _integrals(recording, np.arange(steps), step)
    jumps = energy_jumps(recording, steps)
    totals, throughput = _until(per_step)[place.row], _until(np.abs(per_step))[place.row]
    totals += np.cumsum(jumps, axis=0)[place.row]
    throughput += np.cumsum(np.abs(jumps), axis=0)[place.row]
    on_grid = place.part == 0.0  # there the state is the one before the impulse
    totals[on_grid, DISTURBANCE] -= jumps[place.row[on_grid], DISTURBANCE]
    for i in np.flatnonzero(place.part):
        n, part = int(place.row[i]), np.zeros(4)
        run = _reach(recording, state[i], recording.starts[n])
        part[CONTROL] = recording.applied[n, 0] * run
        part[DISSIPATED:] = _integrals(recording, np.array([n]), float(place.part[i]))[0]
        totals[i] += part
        throughput[i] += np.abs(part)
    totals -= totals[0].copy()
    scale = energy[0] + (throughput - throughput[0]).sum(axis=1)
    p, stretch = recording.parameters, recording.applied[np.minimum(place.row, recording.last), 1]
    if min(p[layout.ALPHA], p[layout.BETA]) < 0.0:  # energies of both signs cancel
        scale += np.maximum.accumulate(gross_energy(p, state[:, :4], stretch)) - energy[0]
    control, change, dissipated, disturbance = totals.T
    return Work(control, change, disturbance, dissipated, scale)


def _reach(recording: Recording, end: Array, start: Array) -> Array:
    """Return how far [m] the control force has moved its points, between the masses x1 - x2."""
    way = end[..., :2] - start[..., :2]
    return way[..., 0] - way[..., 1] if recording.plant.support.is_between else way[..., 0]


def _until(per_step: Array) -> Array:
    """Return the sums (steps + 1, 4) until the start of each step."""
    return np.vstack([np.zeros((1, 4)), np.cumsum(per_step, axis=0)])


def energy_jumps(recording: Recording, steps: int) -> Array:
    """Return the energies (steps + 1, 4) that come in at the start of each step.

    An instant between two steps shows the later stretch and voltage, so the change belongs to it.
    """
    jumps, p = np.zeros((steps + 1, 4)), recording.parameters
    inner = slice(1, min(steps, recording.last) + 1)
    offset = recording.states[inner, 1] - recording.states[inner, 0]
    new, old = recording.applied[inner, 1], recording.applied[: inner.stop - 1, 1]
    jumps[inner, CHANGE] = spring_energy(p, offset, new) - spring_energy(p, offset, old)
    support = recording.plant.support
    if support.damped_row in support.interface_rows:
        held, states = recording.applied[: inner.stop], recording.states[inner]
        stored = [
            interface_energy(support, damped(support, p, applied), states)
            for applied in (held[1:], held[:-1])
        ]
        jumps[inner, CHANGE] += stored[0] - stored[1]
    if recording.plant.support.sampled:
        first = slice(inner.stop)
        after, before = recording.starts[first], recording.states[first]
        impulse = after[:, 2:4] ** 2 - before[:, 2:4] ** 2
        jumps[first, DISTURBANCE] = 0.5 * impulse @ p[[layout.M1, layout.M2]]
    return jumps


def _integrals(recording: Recording, rows: NDArray[np.intp], duration: float) -> Array:
    """Return what is dissipated and what disturbances add, (k, 2) [J], in k intervals so far."""
    times = recording.plant.support.sample_interval * rows.astype(np.float64)
    jets = jets_over(recording, rows, 0.0, duration)
    divided = np.isin(rows, recording.impulses[:, 0]) | stops_at_corners(recording.plant)
    whole, energies = ~divided, np.empty((len(rows), 2))
    start = (recording.starts[rows], recording.applied[rows], jets, times)
    undivided = tuple(array[whole] for array in start)
    energies[whole] = _integrate(recording, undivided, duration)
    for k in np.flatnonzero(divided):
        energies[k] = _piecewise(recording, int(rows[k]), duration)
    return energies


def _piecewise(recording: Recording, row: int, duration: float) -> Array:
    """Return both energies (2,) over the beginning of a sample interval, piece by piece."""
    total, support, applied = np.zeros(2), recording.plant.support, recording.applied[[row]]
    masses = recording.parameters[[layout.M1, layout.M2]]
    impulses = {time: jump for time, *jump in recording.impulses_of(row).tolist()}
    for elapsed, length, lane in pieces(recording, row, duration):
        if elapsed in impulses:
            jump = np.array(impulses[elapsed])
            total[1] += masses @ (jump * (lane[2:4, 0] - 0.5 * jump))
        jets = lane[support.jets : support.jets + 2 * support.terms].T.copy()
        times = np.array([row * support.sample_interval + elapsed])
        start = (lane[support.state_rows].T.copy(), applied, jets, times)
        total += _integrate(recording, start, length)[0]
    return total


def _integrate(recording: Recording, start: tuple[Array, ...], duration: float) -> Array:
    """Return energies (k, 2) from states, what is applied, jets over the duration, and times."""
    if recording.plant.support.is_general:
        return quadrature.integrals(recording, start, duration)
    p, applied = recording.parameters, start[1]
    nonlinear = p[layout.BETA] != 0.0 or p[layout.L0] > 0.0
    # The exact forms bound the motion between kinks by an energy, which has no lower bound where
    # alpha < 0; and they pay only where many intervals share them.
    varies = len(np.unique(applied[:, 1:], axis=0)) > 1
    by_series = nonlinear or (p[layout.VR] > 0.0 and (p[layout.ALPHA] < 0.0 or varies))
    # At a corner of a record the energy rate has a kink: series, whose pieces begin there.
    if not (by_series or stops_at_corners(recording.plant)):
        work, model = np.zeros((len(applied), 2)), recording.plant.model[: layout.MODEL_OWN].copy()
        model[layout.SAMPLE_INTERVAL] = duration
        if rate_kernel.step_integrals(p, model, *start, duration, work) == layout.OK:
            return work
    return quadrature.integrals_by_series(recording, start, duration)
