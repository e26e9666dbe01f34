"""What excites a group of lanes within a sample interval, kept in rows of vectors.

The polynomials of force and ground, then amplitude, frequency, cosine and sine of each harmonic.
"""

from __future__ import annotations

import math

from mm_gym.arrays import Array
from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma
from mm_gym.lanes.elementary import on_circle
from mm_gym.lanes.groups import read
from mm_gym.lanes.simd import alike

ROWS_OF_HARMONIC = 4

MOST_ROWS = 48
"""Rows that there is room for."""

LONGEST_TURN = 0.25 * math.pi
"""Of a harmonic in a sample interval [rad]: as far as `on_circle` goes."""

_TO_QUARTERS = 2.0 / math.pi


def obstacle(frequencies: Array, terms: int, interval: float) -> str | None:
    """Return why the rows cannot hold an excitation, or None.

    It has harmonics, whose highest frequencies [rad/s] are given, and polynomials of so many terms.
    """
    turn = frequencies.max(initial=0.0) * interval
    if not turn <= LONGEST_TURN:
        return (
            f"a harmonic turns by {turn:.3g} rad in a sample interval; at most {LONGEST_TURN:.3g}"
        )
    rows = 2 * terms + ROWS_OF_HARMONIC * len(frequencies)
    if rows > MOST_ROWS:
        return f"the excitation has {rows} numbers in a lane; at most {MOST_ROWS}"
    return None


@inlined_kernel
def is_excited(model):
    """Tell whether there is an excitation."""
    return model[layout.TERMS] + model[layout.HARMONIC_COUNT] > 0.0


@inlined_kernel
def rows_of_sources(model):
    """Return how many rows there are."""
    return 2 * int(model[layout.TERMS]) + ROWS_OF_HARMONIC * int(model[layout.HARMONIC_COUNT])


@borrowing_kernel
def load_sources(model, lanes, i, count, b, first):
    """Write the rows of b from `first` on, of the lanes i .. i + count - 1."""
    terms = 2 * int(model[layout.TERMS])
    for n in range(terms):
        b[first + n] = read(lanes, int(model[layout.JETS]) + n, i, count)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        row = first + terms + ROWS_OF_HARMONIC * j
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        b[row] = read(lanes, harmonic + layout.AMPLITUDE, i, count)
        b[row + 1] = read(lanes, harmonic + layout.FREQUENCY, i, count)
        b[row + 2] = read(lanes, harmonic + layout.COSINE, i, count)
        b[row + 3] = read(lanes, harmonic + layout.SINE, i, count)


@borrowing_kernel
def excitation(model, b, first, time):
    """Return force [N] and ground acceleration [m/s^2] at a time [s] since the interval's start."""
    terms, fraction = int(model[layout.TERMS]), time * (1.0 / model[layout.SAMPLE_INTERVAL])
    push, shake = alike(time, 0.0), alike(time, 0.0)
    for n in range(terms - 1, -1, -1):
        push = fma(push, fraction, b[first + n])
        shake = fma(shake, fraction, b[first + terms + n])
    for j in range(int(model[layout.HARMONIC_COUNT])):
        row = first + 2 * terms + ROWS_OF_HARMONIC * j
        cosine, sine = on_circle(b[row + 1] * time * _TO_QUARTERS)
        value = b[row] * fma(b[row + 3], cosine, b[row + 2] * sine)
        if (int(model[layout.GROUND]) >> j) & 1:
            shake = shake + value
        else:
            push = push + value
    return push, shake


@borrowing_kernel
def series_of_sources(model, b, first, piece, targets, degree):
    """Write the series of force [N] and ground acceleration [m/s^2] over a piece of the interval.

    Parameters
    ----------
    piece
        Its start since that of the sample interval, and its length [s].
    targets, degree
        Where the rows of both series begin, and how many terms they have: term k is the k-th
        derivative times length**k / k!.
    """
    (start, length), terms = piece, int(model[layout.TERMS])
    by_interval = 1.0 / model[layout.SAMPLE_INTERVAL]
    shift, ratio = start * by_interval, length * by_interval
    for target in range(2):
        scale, jet = alike(start, 1.0), first + target * terms
        for k in range(degree):
            # The binomial theorem: ((s + r t)^n)_k = C(n, k) s^(n - k) r^k.
            total, weight = alike(start, 0.0), scale
            for n in range(k, terms):
                total = fma(weight, b[jet + n], total)
                weight = weight * shift * ((n + 1.0) / (n + 1.0 - k))
            b[targets[target] + k] = total
            scale = scale * ratio
    for j in range(int(model[layout.HARMONIC_COUNT])):
        row = first + 2 * terms + ROWS_OF_HARMONIC * j
        target = targets[(int(model[layout.GROUND]) >> j) & 1]
        cosine, sine = on_circle(b[row + 1] * start * _TO_QUARTERS)
        turn = b[row + 1] * length
        value = b[row] * fma(b[row + 3], cosine, b[row + 2] * sine)
        slope = b[row] * turn * fma(b[row + 2], cosine, -b[row + 3] * sine)
        for n in range(degree):
            b[target + n] = b[target + n] + value
            # From p'' = -frequency**2 p: the next term follows from the last but one.
            value, slope = slope, value * (turn * turn * (-1.0 / ((n + 1.0) * (n + 2.0))))


@borrowing_kernel
def strongest(model, b, first):
    """Return bounds of force [N] and ground acceleration [m/s^2] in the interval.

    Each is followed by bounds of its third and fourth derivative over time in sample intervals.
    """
    zero, terms = alike(b[first], 0.0), int(model[layout.TERMS])
    force, ground = (zero, zero, zero), (zero, zero, zero)
    for n in range(terms):
        third = n * (n - 1.0) * (n - 2.0)
        weights = 1.0, third, third * (n - 3.0)
        force = _raised(force, abs(b[first + n]), weights)
        ground = _raised(ground, abs(b[first + terms + n]), weights)
    for j in range(int(model[layout.HARMONIC_COUNT])):
        row = first + 2 * terms + ROWS_OF_HARMONIC * j
        turn = b[row + 1] * model[layout.SAMPLE_INTERVAL]
        weights = alike(turn, 1.0), turn * turn * turn, turn * turn * (turn * turn)
        if (int(model[layout.GROUND]) >> j) & 1:
            ground = _raised(ground, abs(b[row]), weights)
        else:
            force = _raised(force, abs(b[row]), weights)
    return force, ground


@inlined_kernel
def _raised(bounds, size, weights):
    """Return bounds with those of one more summand."""
    return (
        fma(weights[0], size, bounds[0]),
        fma(weights[1], size, bounds[1]),
        fma(weights[2], size, bounds[2]),
    )
