"""The motion over a part of a sample interval: from an impulse, or to an instant within."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law import springs
from mm_gym.plant.plant import Plant
from mm_gym.state_space.equations import state_space

ROUND_OFF = 2.0**-54  # part of a sum below which a term no longer counts

MOST_PIECES = 32
"""Pieces, of one radian or time constant each, that are cheaper than constants in decimal
arithmetic, which takes milliseconds."""


def advance(plant: Plant, lane: Array, duration: float) -> int:
    """Advance a lane (rows, 1) by a part of a sample interval [s]; return the status.

    Its jets are over this part.
    """
    if plant.entries.takes_parts:
        model = plant.model[: int(plant.model[layout.EXCITATION])].copy()
        model[layout.SAMPLE_INTERVAL] = duration
        return plant.entries.propagate(model, lane, 0, 1)
    if lane[layout.M1, 0] > 0.0:
        generator, state = _exosystem(plant, lane[:, 0], duration)
        turns = [lane[row + layout.FREQUENCY, 0] * duration for row in plant.support.harmonic_rows]
        rates = [1.0, *turns, *np.abs(generator[2:4, :4]).sum(axis=1)]
        if max(rates) <= MOST_PIECES:
            pieces = math.ceil(max(rates))
            x1, x2, way1, way2 = _propagated(generator / pieces, state, pieces)[:4]
            lane[: layout.V2 + 1, 0] = x1, x2, way1 / duration, way2 / duration
            return layout.OK
    return plant.entries.propagate(plant.at_interval(duration).model, lane, 0, 1)


def _propagated(generator: Array, state: Array, pieces: int) -> Array:
    """Return exp(generator)^pieces times a state, by the series of the exponential.

    What it sums are the state's own terms, so that of large jets which cancel no more digits are
    lost than in their sum.
    """
    for _ in range(pieces):
        term, order = state, 0
        while order < len(state) or (abs(term) > ROUND_OFF * abs(state)).any():
            order += 1
            term = generator @ term / order
            state = state + term
    return state


def _exosystem(plant: Plant, lane: Array, duration: float) -> tuple[Array, Array]:
    """Return generator times duration, and state at the start, of a linear motion and its causes.

    The states are x1, x2 [m] and, times the duration, v1, v2; then the held force, sine and cosine
    of each harmonic, and the jets of force and ground, each times the way [m] that it alone causes.
    """
    support, square = plant.support, duration * duration
    m1, m2, k1, d, c = lane[[layout.M1, layout.M2, layout.K1, layout.D, layout.C]]
    k2 = plain(springs.stiffness)(lane[layout.K0], lane[layout.STRETCH])
    k1 = k1 * lane[layout.ALPHA]
    system = state_space({"m1": m1, "m2": m2, "k1": k1, "d": d, "c": c, "k2": k2})
    control = system.control(is_between=support.is_between)
    causes = [(control, lane[[layout.FORCE]], np.zeros((1, 1)))]
    for row, ground in zip(support.harmonic_rows, support.ground, strict=True):
        column = (system.ground if ground else system.force) * lane[row + layout.AMPLITUDE]
        turn = lane[row + layout.FREQUENCY] * duration
        wave = lane[[row + layout.SINE, row + layout.COSINE]]
        causes.append((column, wave, np.array([[0.0, turn], [-turn, 0.0]])))
    if support.terms:
        jets = lane[support.jets : support.jets + 2 * support.terms].reshape(2, -1)
        rates = np.diag(np.arange(1.0, support.terms), 1)
        causes += [(system.force, jets[0], rates), (system.ground, jets[1], rates)]
    size = 4 + sum(len(values) for _, values, _ in causes)
    generator, start, at = np.zeros((size, size)), np.zeros(size), 4
    generator[:2, 2:4] = np.eye(2)
    generator[2:4, :2] = system.a[2:, :2] * square
    generator[2:4, 2:4] = system.a[2:, 2:] * duration
    start[:4] = lane[: layout.V2 + 1] * (1.0, 1.0, duration, duration)
    for column, values, rates in causes:
        way = square * column[2:].astype(np.float64)
        scale = np.abs(way).max() or 1.0
        generator[2:4, at] = way / scale
        end = at + len(values)
        generator[at:end, at:end], start[at:end] = rates, scale * values
        at = end
    return generator, start
