"""Piecewise linear plants in double precision, event-exact: a ladder of doubled steps.

Where many systems are each followed once (a bifurcation diagram) or power is integrated along a
known motion, a transition matrix in decimal arithmetic per system would cost more than the motion.
Here the step is halved until its Taylor series is short, and doubled back. Three choices keep that
accurate to round-off where `scipy.linalg.expm` is not, for a stick rate of 1e7/s and a carriage of
1e-80 kg alike:

- each level holds D = exp(A h) - I, and (I + D)^2 - I = 2 D + D D loses nothing while D is small;
- the state is x1, x2 - x1, V = (m1 v1 + m2 v2) / (m1 + m2), w = v2 - v1. The interface acts on w
  alone, so the stiff direction is a coordinate, and the slow motion is never the difference of
  large numbers;
- in slip the coordinate is w - s v_r, which vanishes where the regime ends.

With a quadratic form W in z, the energy integral of z' W z over a step follows on the same levels:
Q(2 h) = Q(h) + (I + D)' Q(h) (I + D).

Events: a step is taken whole if w provably stays in its regime, else it is halved, down to the last
level; see `stays`.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import kernel

# Entries of z. HARMONICS: amplitude times cosine, and times sine, of each harmonic; then the jets of force
# and ground acceleration, coefficients of (t / h)^n.
X, OFFSET, COMMON, SLIP, SIGN, FORCE, HARMONICS = 0, 1, 2, 3, 4, 5, 6

SMALLEST_PHASE = 2.0**-6
"""Largest rate times step on the last level."""

DEEPEST = 61
"""Most halvings that a position on the ladder, a 64-bit integer, can count."""

FINEST = 50
"""Halvings that locate an event: 1e-15 of the first level's step."""

ROUND_OFF = 2.0**-51
"""Relative change of w that its digits do not show."""

TERMS = 11
"""Terms of the last level's series: 2 * SMALLEST_PHASE to their number is below round-off."""

LIGHTEST = 1e-80
"""A massless carriage is given this fraction of the sphere's mass, which changes nothing else."""


@kernel
def stiffness_of(k0, stretch):
    """Return k2 = 2 k0 (1 + 2 / stretch**3), eq. 15 of the paper."""
    return 2.0 * k0 * (1.0 + 2.0 / (stretch * stretch * stretch)) if k0 > 0.0 else 0.0


@kernel
def carriage_mass(p):
    """Return m1, or a mass too small to matter if there is none."""
    return max(p[at.M1], LIGHTEST * p[at.M2])


@kernel
def damping_of(p):
    """Return the slope of the interface's force at small slip: c, or that of friction in stick."""
    return p[at.MU1] * p[at.FN] / p[at.VR] if p[at.VR] > 0.0 else p[at.C]


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
    m1, m2, k1, d, vr = carriage_mass(p), p[at.M2], p[at.K1] * p[at.ALPHA], p[at.D], p[at.VR]
    total, inverse = m1 + m2, 1.0 / m1 + 1.0 / m2
    share = m2 / total  # v1 = V - share w
    a = np.zeros((size_of(harmonics, terms), size_of(harmonics, terms)))
    a[X, COMMON], a[X, SLIP], a[OFFSET, SLIP] = 1.0, -share, 1.0
    a[COMMON, X], a[COMMON, COMMON], a[COMMON, SLIP] = -k1 / total, -d / total, d * share / total
    a[SLIP, X], a[SLIP, OFFSET], a[SLIP, COMMON] = k1 / m1, -k2 * inverse, d / m1
    a[SLIP, SLIP] = -(p[at.CHI] if in_slip else damping_of(p)) * inverse - d * share / m1
    a[COMMON, FORCE], a[SLIP, FORCE] = 1.0 / total, -1.0 / m1
    if in_slip:
        for row in range(SIGN):
            a[row, SIGN] = a[row, SLIP] * vr
        a[SLIP, SIGN] = -p[at.MU2] * p[at.FN] * inverse - d * share * vr / m1
    for j in range(harmonics):
        cosine, sine = HARMONICS + 2 * j, HARMONICS + 2 * j + 1
        w = p[at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY]
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
    """Return a bound of the rates of both regimes; see `mm_gym.methods.base.fastest_rate`."""
    m1 = carriage_mass(p)
    inverse = 1.0 / m1 + 1.0 / p[at.M2]
    damping = max(damping_of(p), p[at.CHI]) * inverse + p[at.D] / m1
    rate = math.sqrt(p[at.K1] * p[at.ALPHA] / m1) + math.sqrt(k2 * inverse) + damping
    for j in range(harmonics):
        rate = max(rate, p[at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY])
    return max(rate, terms / h)


@kernel
def halvings(phase):
    """Return how often a step is halved until rate times step is at most SMALLEST_PHASE."""
    return max(0, math.ceil(math.log2(max(phase, 1e-300) / SMALLEST_PHASE)))


@kernel
def add_product(out, factor, a, b):
    """Add factor a b to the matrix out; a has rows of zeros."""
    n = a.shape[0]
    for i in range(n):
        for k in range(n):
            scale = factor * a[i, k]
            if scale != 0.0:
                for j in range(n):
                    out[i, j] += scale * b[k, j]


@kernel
def clear(a):
    """Write zeros; the broadcasting of a slice would take seconds to compile."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            a[i, j] = 0.0


@kernel
def add_scaled(out, factor, a):
    """Add factor a to the matrix out."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] += factor * a[i, j]


@kernel
def shortest_step(a, step, out):
    """Write exp(a step) - I for a short step, by its Taylor series."""
    term, following = np.zeros(a.shape), np.zeros(a.shape)
    add_scaled(term, step, a)
    add_scaled(out, step, a)
    for order in range(2, TERMS + 1):
        clear(following)
        add_product(following, step / order, a, term)
        term, following = following, term
        add_scaled(out, 1.0, term)


@kernel
def double(d, out):
    """Write 2 d + d d."""
    add_scaled(out, 2.0, d)
    add_product(out, 1.0, d, d)


@kernel
def first_form(a, weight, step, out):
    """Write the integral of exp(a t)' W exp(a t) over a short step.

    It is the sum of step^(k + 1) / (k + 1)! L^k(W), L(W) = W a + a' W.
    """
    n = a.shape[0]
    term, half = np.zeros((n, n)), np.zeros((n, n))
    add_scaled(term, step, weight)
    add_scaled(out, step, weight)
    for order in range(2, TERMS + 1):
        clear(half)
        add_product(half, step / order, term, a)
        for i in range(n):
            for j in range(n):
                term[i, j] = half[i, j] + half[j, i]
        add_scaled(out, 1.0, term)


@kernel
def double_form(q, d, out):
    """Write q + (I + d)' q (I + d)."""
    half = np.zeros(q.shape)
    add_scaled(half, 1.0, q)
    add_product(half, 1.0, q, d)
    add_scaled(out, 1.0, q)
    add_scaled(out, 1.0, half)
    add_product(out, 1.0, d.T, half)


@kernel
def double_up(a, step, levels):
    """Write the levels (depth + 1, n, n) of one regime, the whole step first."""
    depth = levels.shape[0] - 1
    shortest_step(a, step * 0.5**depth, levels[depth])
    for j in range(depth - 1, -1, -1):
        double(levels[j + 1], levels[j])


@kernel
def double_forms_up(a, weight, step, levels, forms):
    """Write the integral of z' W z over each level as a form (n, n) of z at its start."""
    depth = levels.shape[0] - 1
    first_form(a, weight, step * 0.5**depth, forms[depth])
    for j in range(depth - 1, -1, -1):
        double_form(forms[j + 1], levels[j + 1], forms[j])


@kernel
def slip_rows(a, rows):
    """Write the rows that give w' and w'' from z."""
    for k in range(a.shape[0]):
        rows[0, k], rows[1, k] = a[SLIP, k], row_times(a[SLIP], a[:, k])


@kernel
def start(p, state, force, harmonics, time, jets):
    """Return z at a time [s] of the harmonics; the regime follows from the slip velocity."""
    z = np.zeros(HARMONICS + 2 * harmonics + jets.shape[0])
    m1, m2 = carriage_mass(p), p[at.M2]
    x1, x2, v1, v2 = state[0], state[1], state[2], state[3]
    w, vr = v2 - v1, p[at.VR]
    z[X], z[OFFSET], z[COMMON], z[SLIP] = x1, x2 - x1, (m1 * v1 + m2 * v2) / (m1 + m2), w
    if vr > 0.0 and abs(w) > vr:
        z[SIGN] = 1.0 if w > 0.0 else -1.0
        z[SLIP] = w - z[SIGN] * vr
    z[FORCE] = force
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        angle = p[harmonic + at.PHASE] + p[harmonic + at.FREQUENCY] * time
        z[HARMONICS + 2 * j] = p[harmonic + at.AMPLITUDE] * math.cos(angle)
        z[HARMONICS + 2 * j + 1] = p[harmonic + at.AMPLITUDE] * math.sin(angle)
    for n in range(jets.shape[0]):
        z[HARMONICS + 2 * harmonics + n] = jets[n]
    return z


@kernel
def energy_root(p, k2, z):
    """Return sqrt(2 E), E the kinetic and elastic energy."""
    m1, m2 = carriage_mass(p), p[at.M2]
    w = z[SLIP] + z[SIGN] * p[at.VR]
    kinetic = (m1 + m2) * z[COMMON] ** 2 + m1 * m2 / (m1 + m2) * w * w
    return math.sqrt(kinetic + p[at.K1] * p[at.ALPHA] * z[X] ** 2 + k2 * z[OFFSET] ** 2)


@kernel
def bound_motion(p, k2, z, harmonics, ground, terms, h, duration, in_slip):
    """Return bounds of |g'| and |g''| over a duration, where w' = -rate w + g (+ constant in slip).

    The root of twice the energy grows at most by the force over the root of the mass it moves; it
    bounds every coordinate, and the equations of motion bound their derivatives.
    """
    m1, m2, k1, d = carriage_mass(p), p[at.M2], p[at.K1] * p[at.ALPHA], p[at.D]
    total = m1 + m2
    share, reduced = m2 / total, m1 * m2 / total
    force, force1, force2, shake, shake1 = abs(z[FORCE]), 0.0, 0.0, 0.0, 0.0
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        size, w = abs(p[harmonic + at.AMPLITUDE]), p[harmonic + at.FREQUENCY]
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
        dw = (p[at.CHI] / reduced + d * share / m1) * w + p[at.MU2] * p[at.FN] / reduced + drive
    else:
        slip = min(w, p[at.VR]) if p[at.VR] > 0.0 else w
        dw = (damping_of(p) / reduced + d * share / m1) * slip + drive
    first = (k1 * v1 + d * dv + force1) / m1 + k2 * w / reduced
    ddv = (d * (dv + share * dw) + k1 * v1 + force1) / total + shake1
    return first, (k1 * (dv + share * dw) + d * ddv + force2) / m1 + k2 * dw / reduced


@kernel
def stays(vr, z, change, second, rate, drive, first, next_order, h):
    """Tell whether w provably stays in its regime over a time h in which it changes by `change`.

    Two certificates. A chord of w is wrong by at most t (h - t) / 2 times the largest |w''|, and a
    chord between two points on one side leaves room for it if their distances from the boundary sum
    to h^2 / 2 times that. In stick also: w' = -rate w + g keeps |w| below the larger of its start
    and |g| / rate, however fast the rate.
    """
    w = z[SLIP]
    # w'' obeys the same equation with g''.
    bend = (
        0.5
        * h
        * h
        * min(abs(second) + h * next_order, max(abs(second), next_order / max(rate, 1e-300)))
    )
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

    levels (2, depth + 1, n, n), rows (2, 2, n) as `slip_rows` has them, bounds (2, 2) as
    `bound_motion` has them, each for stick and slip; y is scratch.
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
    """Return the level of the next interval: as long as its place allows."""
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
