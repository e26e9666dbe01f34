"""Jets: force and ground acceleration in a sample interval, as the methods read them.

A jet holds the coefficients of a polynomial in t / h, for a sample interval of length h; behind the
jet of the force [N] stands that of the ground's acceleration [m/s^2]. Harmonics come on top.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.elementary import cosine_and_sine


@borrowing_kernel
def jet_value(lanes, jet, terms, fraction, i):
    """Return the value of a jet at a fraction of the sample interval."""
    total = 0.0
    for n in range(terms - 1, -1, -1):
        total = total * fraction + lanes[jet + n, i]
    return total


@borrowing_kernel
def add_jets(c, force_row, ground_row, model, lanes, i, elapsed, duration, degree):
    """Add the jets to series of force and ground acceleration over a part of the sample interval.

    Term k of a series is the k-th derivative times duration**k / k!.

    Parameters
    ----------
    c
        Scratch, float64: the two series are written.
    force_row, ground_row
        Where the series of the force [N] and of the ground's acceleration [m/s^2] begin in c.
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64, read.
    i
        The lane.
    elapsed, duration
        Start of the part since that of the sample interval, and its length [s].
    degree
        Of the series.
    """
    jets, terms = int(model[at.JETS]), int(model[at.TERMS])
    start, ratio = elapsed / model[at.SAMPLE_INTERVAL], duration / model[at.SAMPLE_INTERVAL]
    for target in range(2):
        jet = jets + target * terms
        row = ground_row if target > 0 else force_row
        scale = 1.0
        for k in range(min(terms, degree + 1)):
            # The binomial theorem: ((s + r t)^n)_k = C(n, k) s^(n - k) r^k.
            total, weight = 0.0, 1.0
            for n in range(k, terms):
                total += weight * lanes[jet + n, i]
                weight *= start * (n + 1.0) / (n + 1.0 - k)
            c[row + k] += scale * total
            scale *= ratio


@kernel
def write_series(c, width, model, lanes, i, elapsed, duration, degree):
    """Write the series of the carriage's force (row 6) and of the ground's acceleration (row 7).

    Term k of a series is the k-th derivative times duration**k / k!. Without excitation nothing is
    written.

    Parameters
    ----------
    c
        Scratch, float64: rows 6 and 7 are written.
    width
        Distance of two rows of c.
    model, lanes, i
        As for `add_jets`.
    elapsed, duration
        Start of what the series cover since that of the sample interval, and its length [s].
    degree
        Of the series.
    """
    harmonics, ground = int(model[at.HARMONIC_COUNT]), int(model[at.GROUND])
    if harmonics == 0 and model[at.TERMS] == 0.0:
        return
    for n in range(degree + 1):
        c[6 * width + n] = c[7 * width + n] = 0.0
    add_jets(c, 6 * width, 7 * width, model, lanes, i, elapsed, duration, degree)
    for j in range(harmonics):
        harmonic = at.HARMONICS + at.HARMONIC_ROWS * j
        frequency, scale = lanes[harmonic + at.FREQUENCY, i], lanes[harmonic + at.AMPLITUDE, i]
        cosine, sine = cosine_and_sine(frequency * elapsed)
        value = scale * (
            lanes[harmonic + at.SINE, i] * cosine + lanes[harmonic + at.COSINE, i] * sine
        )
        slope = scale * (
            lanes[harmonic + at.COSINE, i] * cosine - lanes[harmonic + at.SINE, i] * sine
        )
        turn = frequency * duration
        slope *= turn
        row = 7 * width if (ground >> j) & 1 else 6 * width
        for n in range(degree + 1):
            c[row + n] += value
            # From p'' = -frequency**2 p: the next term follows from the last but one.
            value, slope = slope, -value * turn * turn / ((n + 1.0) * (n + 2.0))
