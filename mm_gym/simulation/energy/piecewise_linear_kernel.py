"""Equations and events of piecewise linear plants, for precise integration.

Where many systems are each followed once (a bifurcation diagram) or an energy rate is integrated
along a known motion, a transition matrix in decimal arithmetic per system would cost more than the
motion. Here it follows by precise integration (`precise_integration_kernel`). Two choices of
coordinates keep that accurate to round-off where `scipy.linalg.expm` is not, for a stick rate of
1e7/s and a carriage of 1e-80 kg alike:

- the state is x1, x2 - x1, V = (m1 v1 + m2 v2) / (m1 + m2), w = v2 - v1. The interface acts on w
  alone, so the stiff direction is a coordinate, and the slow motion is never the difference of
  large numbers;
- in slip the coordinate is w - s v_r, which vanishes where the regime ends.

Events: a step is taken whole if w provably stays in its regime, else it is halved, down to the last
level; see `stays`.

Arguments in common: `p` (rows,), a lane; `k2`, the stiffness of the springs [N/m]; `harmonics`,
their number, and `ground`, whose bit j says whether harmonic j shakes the ground; `terms` of each
jet, in powers of t / `h` [s]; `in_slip`, whether the regime is slip; `z` (n,), the state with what
excites it; `levels` (2, depth + 1, n, n), of `precise_integration_kernel.double_up` for stick, then
slip, and `rows` (2, 2, n), of `slip_rows`; `y` (n,), scratch.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import kernel
from mm_gym.lanes import layout
from mm_gym.law import bounds, dry_friction
from mm_gym.law.events import sign_of

# Entries of z. HARMONICS: amplitude times cosine, and times sine, of each harmonic; then the jets
# of force and ground acceleration, coefficients of (t / h)^n.
X, OFFSET, COMMON, SLIP, SIGN, FORCE, HARMONICS = 0, 1, 2, 3, 4, 5, 6

DEEPEST = 61
"""Most halvings of a step: a position in it, counted in its last level, is a 64-bit integer."""

FINEST = 50
"""Halvings that locate an event: 1e-15 of the first level's step."""

ROUND_OFF = 2.0**-51
"""Relative change of w that its digits do not show."""

LIGHTEST = 1e-80
"""A massless carriage is given this fraction of the sphere's mass, which changes nothing else."""


@kernel
def carriage_mass(p):
    """Return m1, or a mass too small to matter if there is none."""
    return max(p[layout.M1], LIGHTEST * p[layout.M2])


@kernel
def row_times(row, z):
    """Return the product of a row and z."""
    total = 0.0
    for k in range(z.shape[0]):
        total += row[k] * z[k]
    return total


@kernel
def size_of(harmonics, terms):
    """Return the number of entries of z."""
    return HARMONICS + 2 * harmonics + 2 * terms


@kernel
def generator(p, k2, harmonics, ground, terms, h, in_slip):
    """Return A (n, n) of z' = A z in one regime."""
    m1, m2, k1 = carriage_mass(p), p[layout.M2], p[layout.K1] * p[layout.ALPHA]
    d, vr = p[layout.D], p[layout.VR]
    total, inverse = m1 + m2, 1.0 / m1 + 1.0 / m2
    part = m2 / total  # v1 = V - part w
    a = np.zeros((size_of(harmonics, terms), size_of(harmonics, terms)))
    a[X, COMMON], a[X, SLIP], a[OFFSET, SLIP] = 1.0, -part, 1.0
    # (1) and (2) of docs/model.md added up, and (2) less (1).
    a[COMMON, X], a[COMMON, COMMON], a[COMMON, SLIP] = -k1 / total, -d / total, d * part / total
    a[SLIP, X], a[SLIP, OFFSET], a[SLIP, COMMON] = k1 / m1, -k2 * inverse, d / m1
    a[SLIP, SLIP] = -(p[layout.CHI] if in_slip else p[layout.C]) * inverse - d * part / m1
    a[COMMON, FORCE], a[SLIP, FORCE] = 1.0 / total, -1.0 / m1
    if in_slip:
        for row in range(SIGN):
            a[row, SIGN] = a[row, SLIP] * vr
        a[SLIP, SIGN] = -p[layout.KINETIC_FORCE] * inverse - d * part * vr / m1
    for j in range(harmonics):
        cosine, sine = HARMONICS + 2 * j, HARMONICS + 2 * j + 1
        w = p[layout.HARMONICS + layout.HARMONIC_ROWS * j + layout.FREQUENCY]
        a[cosine, sine], a[sine, cosine] = -w, w
        if (ground >> j) & 1:
            a[COMMON, sine] = -1.0
        else:
            a[COMMON, sine], a[SLIP, sine] = 1.0 / total, -1.0 / m1
    if terms > 0:
        jets = HARMONICS + 2 * harmonics
        a[COMMON, jets], a[SLIP, jets], a[COMMON, jets + terms] = 1.0 / total, -1.0 / m1, -1.0
        for n in range(terms - 1):
            a[jets + n, jets + n + 1] = a[jets + terms + n, jets + terms + n + 1] = (n + 1.0) / h
    return a


@kernel
def fastest_rate(p, k2, harmonics, terms, h):
    """Return a bound [1/s] of the rates of both regimes and of the excitation."""
    k1, c = p[layout.K1] * p[layout.ALPHA], max(p[layout.C], p[layout.CHI])
    rate = bounds.fastest_rate(carriage_mass(p), p[layout.M2], k1, k2, c, p[layout.D])
    return max(rate, bounds.fastest_harmonic(p, harmonics), terms / h)


@kernel
def slip_rows(a, rows):
    """Write the rows that give w' and w'' from z."""
    for k in range(a.shape[0]):
        rows[0, k], rows[1, k] = a[SLIP, k], row_times(a[SLIP], a[:, k])


@kernel
def start(p, state, force, harmonics, time, jets):
    """Return z at a time [s] of the harmonics; the regime follows from the slip velocity.

    The state is x1, x2 [m], v1, v2 [m/s]; `force` [N] is held on the carriage; `jets` (2 terms,)
    are coefficients of force [N] and ground acceleration [m/s^2].
    """
    z = np.zeros(HARMONICS + 2 * harmonics + jets.shape[0])
    m1, m2 = carriage_mass(p), p[layout.M2]
    x1, x2, v1, v2 = state[0], state[1], state[2], state[3]
    w, vr = v2 - v1, p[layout.VR]
    z[X], z[OFFSET], z[COMMON], z[SLIP] = x1, x2 - x1, (m1 * v1 + m2 * v2) / (m1 + m2), w
    z[SIGN] = sign_of(dry_friction.threshold(vr), w)
    z[SLIP] = w - z[SIGN] * vr
    z[FORCE] = force
    for j in range(harmonics):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        angle = p[harmonic + layout.PHASE] + p[harmonic + layout.FREQUENCY] * time
        z[HARMONICS + 2 * j] = p[harmonic + layout.AMPLITUDE] * math.cos(angle)
        z[HARMONICS + 2 * j + 1] = p[harmonic + layout.AMPLITUDE] * math.sin(angle)
    for n in range(jets.shape[0]):
        z[HARMONICS + 2 * harmonics + n] = jets[n]
    return z


@kernel
def force_share(model, p):
    """Return the force on the carriage that makes w change as a control force of 1 does.

    Between the masses it acts on w by both, -(1 / m1 + 1 / m2).
    """
    return 1.0 + carriage_mass(p) / p[layout.M2] if model[layout.BETWEEN] > 0.0 else 1.0


@kernel
def energy_root(p, k2, z):
    """Return sqrt(2 E), E the kinetic and elastic energy."""
    m1, m2 = carriage_mass(p), p[layout.M2]
    w = z[SLIP] + z[SIGN] * p[layout.VR]
    kinetic = (m1 + m2) * z[COMMON] ** 2 + m1 * m2 / (m1 + m2) * w * w
    return math.sqrt(kinetic + p[layout.K1] * p[layout.ALPHA] * z[X] ** 2 + k2 * z[OFFSET] ** 2)


@kernel
def bound_motion(p, k2, z, harmonics, ground, terms, h, duration, in_slip):
    """Return bounds of |g'| and |g''| over a duration, where w' = -rate w + g (+ constant in slip).

    The root of twice the energy grows at most by the force over the root of the mass it moves; it
    bounds every coordinate, and the equations of motion bound their derivatives.
    """
    m1, m2, k1, d = carriage_mass(p), p[layout.M2], p[layout.K1] * p[layout.ALPHA], p[layout.D]
    total = m1 + m2
    part, reduced = m2 / total, m1 * m2 / total
    force, force1, force2, shake, shake1 = abs(z[FORCE]), 0.0, 0.0, 0.0, 0.0
    for j in range(harmonics):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        size, w = abs(p[harmonic + layout.AMPLITUDE]), p[harmonic + layout.FREQUENCY]
        if (ground >> j) & 1:
            shake, shake1 = shake + size, shake1 + size * w
        else:
            force, force1, force2 = force + size, force1 + size * w, force2 + size * w * w
    for n in range(terms):
        push = abs(z[HARMONICS + 2 * harmonics + n])
        size = abs(z[HARMONICS + 2 * harmonics + terms + n])
        shake, shake1 = shake + size, shake1 + size * n / h
        force, force1 = force + push, force1 + push * n / h
        force2 += push * n * (n - 1.0) / (h * h)
    s = energy_root(p, k2, z) + duration * (force / math.sqrt(m1) + shake * math.sqrt(total))
    x, v1, v, w = s / math.sqrt(k1), s / math.sqrt(m1), s / math.sqrt(total), s / math.sqrt(reduced)
    dv = (d * v1 + k1 * x + force) / total + shake
    drive = (k1 * x + d * v + force) / m1 + math.sqrt(k2) * s / reduced
    if in_slip:
        damping = p[layout.CHI] / reduced + d * part / m1
        dw = damping * w + p[layout.KINETIC_FORCE] / reduced + drive
    else:
        damping = p[layout.C] / reduced + d * part / m1
        dw = damping * min(w, dry_friction.threshold(p[layout.VR])) + drive
    first = (k1 * v1 + d * dv + force1) / m1 + k2 * w / reduced
    ddv = (d * (dv + part * dw) + k1 * v1 + force1) / total + shake1
    return first, (k1 * (dv + part * dw) + d * ddv + force2) / m1 + k2 * dw / reduced


@kernel
def stays_slower(p, k2, z, rate, limit):
    """Tell whether the energy left is too little for a free motion in stick to slip faster.

    Either sqrt(2 E / m_r), the fastest w of this energy, or |g| / rate stays below the limit
    [m/s], where w' = -rate w + g, see section 4 of docs/model.md.
    """
    m1, m2, k1, d = carriage_mass(p), p[layout.M2], p[layout.K1] * p[layout.ALPHA], p[layout.D]
    total = m1 + m2
    reduced = m1 * m2 / total
    root = energy_root(p, k2, z)
    if root <= limit * math.sqrt(reduced):
        return True
    # The largest g = (k1 x1 + d V) / m1 - k2 offset / m_r on the ellipsoid of this energy.
    drive = root * math.sqrt(k1 / m1**2 + (d / m1) ** 2 / total + k2 / reduced**2)
    return abs(z[SLIP]) <= limit and drive <= rate * limit


@kernel
def stays(vr, z, change, second, rate, drive, first, next_order, h):
    """Tell whether w provably stays in its regime over a time h [s] in which it changes by change.

    Two certificates. A chord of w is wrong by at most t (h - t) / 2 times the largest |w''|, and a
    chord between two points on one side leaves room for it if their distances from the boundary sum
    to h^2 / 2 times that. In stick also: w' = -rate w + g keeps |w| below the larger of its start
    and |g| / rate, however fast the rate.

    At the start w'' [m/s^3] is `second`, the rate [1/s] and g [m/s^2], the drive, are known, and
    `first` and `next_order` bound |g'| and |g''| while h lasts.
    """
    w = z[SLIP]
    # w'' obeys the same equation with g''.
    later = max(abs(second), next_order / max(rate, 1e-300))
    bend = 0.5 * h * h * min(abs(second) + h * next_order, later)
    after = w + change
    if z[SIGN] != 0.0:
        return z[SIGN] * after >= 0.0 and z[SIGN] * (w + after) >= bend
    if abs(change) + bend <= ROUND_OFF * vr:
        return True
    if abs(after) > vr:
        return False
    return abs(drive) + h * first <= rate * vr or 2.0 * vr - abs(w + after) >= bend


@kernel
def quadratic(form, z):
    """Return z' form z."""
    total = 0.0
    for k in range(z.shape[0]):
        total += z[k] * row_times(form[k], z)
    return total


@kernel
def attempt(vr, levels, rows, bounds, z, y, level, step):
    """Take one interval if the regime provably lasts or it is the last level's; tell if it was.

    `bounds` (2, 2) are as `bound_motion` returns them, `level` that of the interval; the whole step
    is in seconds.
    """
    regime = 0 if z[SIGN] == 0.0 else 1
    d = levels[regime, level]
    change = row_times(d[SLIP], z)
    if level < levels.shape[1] - 1:
        rate = -rows[regime, 0, SLIP]
        drive = row_times(rows[regime, 0], z) + rate * z[SLIP]
        second = row_times(rows[regime, 1], z)
        h = step * 0.5**level
        if not stays(vr, z, change, second, rate, drive, bounds[regime, 0], bounds[regime, 1], h):
            return False
    take(d, z, y)
    switch(vr, z, change)
    return True


@kernel
def next_level(position, level, depth):
    """Return the level of the next interval: as long as its place in the step allows."""
    while level > 0 and position & ((2 << (depth - level)) - 1) == 0:
        level -= 1
    return level


@kernel
def take(d, z, y):
    """Advance z by one level, through the scratch y."""
    n = z.shape[0]
    for i in range(n):
        y[i] = z[i]
        if i not in (SIGN, FORCE):
            for k in range(n):
                y[i] += d[i, k] * z[k]
    for i in range(n):
        z[i] = y[i]


@kernel
def switch(vr, z, change):
    """Change the regime if w crosses its boundary; z is then put onto the boundary."""
    if z[SIGN] == 0.0:
        if abs(z[SLIP]) >= vr * (1.0 - ROUND_OFF) and z[SLIP] * change > 0.0:
            z[SIGN] = 1.0 if z[SLIP] > 0.0 else -1.0
            z[SLIP] = 0.0
            return True
    elif z[SIGN] * z[SLIP] < 0.0:
        z[SLIP] = z[SIGN] * vr
        z[SIGN] = 0.0
        return True
    return False
