"""Impulses of the last control steps, found from the jump of the carriage's velocity."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout as at
from mm_gym.law.carriage_spring import carriage_force
from mm_gym.law.dry_friction import interface_force
from mm_gym.law.springs import spring_force
from mm_gym.rendering import history as rows

if TYPE_CHECKING:
    from mm_gym.rendering.history import Past
    from mm_gym.rendering.subject import Subject

SHOWN = 0.3
"""Time [s] on the screen for which an impulse is shown."""

MOST_TURN = 0.7
"""Longest control step, times the carriage's natural frequency [rad]: the trapezoidal rule's error
of what other forces do is then below 5 % of the velocity's change."""

LEAST = 0.05
"""Smallest impulse that is told from that error, of the largest one."""


def can_be_seen(subject: Subject) -> bool:
    """Tell whether the control steps are short enough to find impulses, and all forces known."""
    if not subject.knows_forces:
        return False
    largest = subject.impulse or subject.ground_impulse
    return largest > 0.0 and 2.0 * pi * subject.time_step <= MOST_TURN * subject.period


def recent_impulse(subject: Subject, past: Past) -> float:
    """Return the newest impulse within `SHOWN`, 0 if there is none.

    That on the carriage [N s], or, in a scene that has none of them, the jump of the ground's
    velocity [m/s].
    """
    count = max(2, round(SHOWN * subject.frames)) + 1
    now = past.rows[:, -count:]
    mass = past.lane[at.M1]
    if now.shape[1] < 2 or mass == 0.0:  # noqa: PLR2004 - a change needs two states
        return 0.0
    before, after = now[:, :-1].copy(), now[:, 1:]
    held = [at.FORCE, at.STRETCH, at.DAMPING]
    before[held] = after[held]  # over the control step
    ends = (_force(subject, past.lane, states) for states in (before, after))
    mean = 0.5 * sum(ends) / mass
    mean -= 0.5 * (before[rows.SHAKE] + after[rows.SHAKE])
    jumps = after[at.V1] - before[at.V1] - subject.time_step * mean
    sizes = mass * jumps if subject.impulse else -jumps
    found = np.flatnonzero(np.abs(sizes) > LEAST * (subject.impulse or subject.ground_impulse))
    return float(sizes[found[-1]]) if found.size else 0.0


def _force(subject: Subject, lane: rows.Array, states: rows.Array) -> rows.Array:
    """Return the force on the carriage [N] at several moments (rows, n) of a lane."""
    spring, pair, interface = map(plain, (carriage_force, spring_force, interface_force))
    x1, offset = states[at.X1], states[at.X2] - states[at.X1]
    c, d = (
        states[at.DAMPING] if row == subject.damped_row else np.full(len(x1), lane[row])
        for row in (at.C, at.D)
    )
    regimes = lane[at.VR], lane[at.KINETIC_FORCE], lane[at.CHI]
    slips = (states[at.V2] - states[at.V1]).tolist()
    total = np.array([interface(c, *regimes, w) for c, w in zip(c.tolist(), slips, strict=True)])
    total += pair(lane[at.K0], lane[at.L0], states[at.STRETCH], offset)
    total += states[rows.PUSH] + states[at.FORCE] - d * states[at.V1]
    return total - spring(lane[at.K1], lane[at.ALPHA], lane[at.BETA], x1)
