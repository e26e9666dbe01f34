"""The recent past of every lane: what its pictures show of the last control steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm  # pyright: ignore[reportUnknownVariableType] - SciPy ships no types

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.rendering.subject import Subject
from mm_gym.simulation.lanes import Lanes
from mm_gym.step.outputs import excitation

KEPT = layout.DAMPING + 1  # rows kept of a lane's own: its state, and what the actuators apply

STEP, PUSH, SHAKE, GROUND, GROUND_VELOCITY = range(KEPT, KEPT + 5)
"""Further rows: control steps since the episode began, force of the excitation [N], acceleration
[m/s^2], displacement [m] and velocity [m/s] of the ground, these two as the camera sees them."""

ROWS = KEPT + 5

CAMERA_DAMPING = 0.7  # damping ratio [-] with which the camera follows the ground


@dataclass(frozen=True)
class Past:
    """The last control steps of a lane's episode, oldest first."""

    rows: Array  # (rows, n) float64: rows of the lane, then those of this module
    lane: Array  # (all rows,) float64: the lane as it is now, with its parameters
    # the largest magnitudes since the episode began:
    displacement: float  # of carriage and ground in the picture [m]
    offset: float  # of the sphere [m]
    disturbance: float  # force of the excitation [N]
    acceleration: float  # of the ground [m/s^2]

    def now(self, row: int) -> float:
        """Return a row's newest value."""
        return float(self.rows[row, -1])


class History:
    """What is remembered of all lanes, as far as the strip charts reach back.

    The camera stands on a mass that a spring and a damper hold to the ground, as in a seismometer:
    it follows slow motions of the ground, so that the ground stays in view, and shows fast ones.
    """

    def __init__(self, lanes: Lanes, subject: Subject, columns: int) -> None:
        self._lanes = lanes
        self._subject = subject
        self._ring = np.zeros((columns, ROWS, lanes.count))
        self._peaks = np.zeros((4, lanes.count))
        self._first_of_block = np.arange(lanes.count) // layout.BLOCK * layout.BLOCK
        self._excitation = plain(excitation)
        self.noted = 0
        self.starts = np.zeros(lanes.count, np.bool_)  # which episodes have just begun
        w, step = 2.0 * np.pi * subject.camera_frequency, subject.time_step
        camera = np.zeros((3, 3))
        camera[0, 1], camera[1] = 1.0, (-w * w, -2.0 * CAMERA_DAMPING * w, 1.0)
        self._camera: Array = np.asarray(expm(camera * step), np.float64)[:2]

    def note(self) -> None:
        """Remember the present state of all lanes."""
        values = self._lanes.values
        now = self._ring[self.noted % len(self._ring)]
        now[:KEPT] = values[:KEPT]
        now[STEP] = values[layout.NOW, self._first_of_block] - values[layout.BEGAN]
        self.starts = starts = now[STEP] == 0.0
        model, every = self._lanes.plant.model, slice(None)
        if self._subject.disturbance:
            now[PUSH] = self._excitation(model, values, False, every)
        if self._subject.acceleration:
            now[SHAKE] = self._excitation(model, values, True, every)
            self._follow(now, starts)
        furthest = np.abs(now[layout.X1]) + np.abs(now[GROUND])
        sizes = np.abs((furthest, now[layout.X2] - now[layout.X1], now[PUSH], now[SHAKE]))
        sizes = np.where(np.isfinite(sizes), sizes, 0.0)
        self._peaks = np.where(starts, sizes, np.maximum(self._peaks, sizes))
        self.noted += 1

    def _follow(self, now: Array, starts: NDArray[np.bool_]) -> None:
        """Advance what the camera sees of the ground by a control step."""
        before = self._ring[self.noted % len(self._ring) - 1]
        mean = 0.5 * (before[SHAKE] + now[SHAKE])
        seen = self._camera @ np.stack([before[GROUND], before[GROUND_VELOCITY], mean])
        now[GROUND : GROUND_VELOCITY + 1] = np.where(starts, 0.0, seen)

    def past(self, lane: int) -> Past:
        """Return the recent past of a lane, back to a break or the start of its episode."""
        count = min(self.noted, len(self._ring))
        order = np.arange(self.noted - count, self.noted) % len(self._ring)
        rows = self._ring[order, :, lane]
        breaks = np.flatnonzero(np.diff(rows[:, STEP]) != 1.0)
        first = int(breaks[-1]) + 1 if breaks.size else 0
        peaks = self._peaks[:, lane]
        # A motion that could not be followed ends beyond all numbers.
        shown = np.where(np.isfinite(rows), rows, 0.0)
        return Past(shown[first:].T, self._lanes.values[:, lane].copy(), *map(float, peaks))
