"""Energy rates along a motion: by quadrature in value form, by series of nonlinear plants."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError
from mm_gym.excitation.kinds import FIRST
from mm_gym.lanes import layout
from mm_gym.methods.support import fastest_rate
from mm_gym.plant.plant import Plant
from mm_gym.sensitivity.layout import TANGENTS
from mm_gym.sensitivity.model import model_of
from mm_gym.simulation.energy import rate_series_kernel
from mm_gym.simulation.recording import Recording, lanes_at
from mm_gym.simulation.response import interface_energy, interface_force

NODES = 8  # of a panel

LONGEST = 0.2
"""Panel, in units of the shortest time constant: the error is then some 1e-14 of the integral, but
where the interface's force has a kink in time."""

FEWEST = 32  # panels in any interval, for those kinks

HALVINGS = 10
"""Of the first panel: own states may relax much faster than the masses move, from the values that
an episode, an impulse or a new voltage finds them at."""

TOLERANCE = 1e-12
"""Of the motion to the nodes, or the next power of ten that a stiff interface allows."""


def integrals_by_series(recording: Recording, start: tuple[Array, ...], duration: float) -> Array:
    """Return what is dissipated and what disturbances add, (k, 2) [J]; see `work._integrate`.

    Between the kinks of friction, term by term.
    """
    lanes = lanes_at(recording, start)
    shorter = replace(recording.plant.support, sample_interval=duration, excitation=np.zeros(FIRST))
    model = model_of(shorter, (), len(lanes), 0)
    values = np.vstack([lanes, np.zeros((TANGENTS + 2, lanes.shape[1]))])
    status = rate_series_kernel.propagate(model, values, 0, lanes.shape[1])
    if status > layout.ENDED:
        msg = f"work: {layout.MESSAGES[status]}"
        raise SimulationError(msg)
    return values[-2:].T


def integrals(recording: Recording, start: tuple[Array, ...], duration: float) -> Array:
    """Return the same by Gauss and Legendre's quadrature along the motion that the plant makes.

    What the interface stores is not dissipated.
    """
    plant, states = _tight(recording.plant), start[0]
    lanes = lanes_at(recording, start)
    panels = max(FEWEST, math.ceil(fastest_rate(plant.support) * duration / LONGEST))
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    total = np.zeros((len(states), 2))
    graded = 0.5 ** np.arange(HALVINGS if plant.support.interface.states else 0, 0, -1)
    edges = np.concatenate([[0.0], graded, np.arange(1.0, panels + 1.0)]) / panels
    for begin, end in itertools.pairwise(edges.tolist()):
        for node, weight in zip(nodes, weights, strict=True):
            part = begin + 0.5 * (1.0 + float(node)) * (end - begin)
            powers = _powers(plant, lanes, *_at(plant, lanes, part, duration))
            total += 0.5 * float(weight) * (end - begin) * duration * powers
    final, *_ = _at(plant, lanes, 1.0, duration)
    stored = [interface_energy(plant.support, lanes, state) for state in (states, final)]
    total[:, 0] -= stored[1] - stored[0]
    return total


@lru_cache(maxsize=64)
def _tight(plant: Plant) -> Plant:
    """Return the plant with the tightest tolerance, its own at most, that its method can plan."""
    own, interval = plant.settings, plant.support.sample_interval
    found = plant.method.planned(plant.support, own._replace(tolerance=TOLERANCE))
    is_tighter = found is not None and found.tolerance < own.tolerance
    return (replace(plant, settings=found) if is_tighter else plant).at_interval(interval)


def _at(plant: Plant, lanes: Array, part: float, duration: float) -> tuple[Array, Array, Array]:
    """Return states (k, n), and what disturbs them (k,) [N, m/s^2], at a part of intervals."""
    support, moved = plant.support, lanes.copy()
    jets = slice(support.jets, support.jets + 2 * support.terms)
    # They are polynomials in the elapsed part of an interval.
    moved[jets] *= np.tile(part ** np.arange(support.terms), 2)[:, None]
    push, shake = moved[jets].reshape(2, support.terms, lanes.shape[1]).sum(axis=1)
    for row, ground in zip(support.harmonic_rows, support.ground, strict=True):
        turn = lanes[row + layout.FREQUENCY] * (part * duration)
        cosine, sine = lanes[row + layout.COSINE], lanes[row + layout.SINE]
        exciting = shake if ground else push
        turned = sine * np.cos(turn) + cosine * np.sin(turn)
        exciting += lanes[row + layout.AMPLITUDE] * turned
    # The constants of a whole interval: to make those of each would take longer than the motion.
    model = plant.model.copy()
    model[layout.SAMPLE_INTERVAL] = part * duration
    status = plant.entries.propagate(model, moved, 0, moved.shape[1])
    if status > layout.ENDED:
        msg = f"work: {layout.MESSAGES[status]}"
        raise SimulationError(msg)
    return moved[support.state_rows].T, push, shake


def _powers(plant: Plant, p: Array, state: Array, push: Array, shake: Array) -> Array:
    """Return the power (k, 2) [W] that dampers take and disturbances give: (11) of the model."""
    support = plant.support
    v1, v2 = state[:, 2], state[:, 3]
    link = interface_force(support, p, state)
    given = push * v1 - shake * (p[layout.M1] * v1 + p[layout.M2] * v2)
    return np.column_stack([p[layout.D] * v1**2 + link * (v2 - v1), given])
