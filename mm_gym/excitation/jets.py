"""Jets: force and ground acceleration in a sample interval, as the methods read them.

A jet holds the coefficients of a polynomial in t / h, for a sample interval of length h; behind the
jet of the force [N] stands that of the ground's acceleration [m/s^2]. Harmonics come on top.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.lanes import layout
from mm_gym.lanes.elementary import cosine_and_sine


@borrowing_kernel
def jet_value(lanes, jet, terms, fraction, i):
    """Return the value of a jet at a fraction of the sample interval."""
    total = 0.0
    for n in range(terms - 1, -1, -1):
        total = total * fraction + lanes[jet + n, i]
    return total


@borrowing_kernel
def add_jets(force, ground, model, lanes, i, elapsed, duration, degree):
    """Add the jets to series of force [N] and ground acceleration [m/s^2], of any kind of number.

    The series, `force` and `ground`, cover a part of the sample interval; term k is the k-th
    derivative times duration**k / k!.
    """
    jets, terms = int(model[layout.JETS]), int(model[layout.TERMS])
    start, ratio = elapsed / model[layout.SAMPLE_INTERVAL], duration / model[layout.SAMPLE_INTERVAL]
    for target in range(2):
        jet = jets + target * terms
        series = ground if target > 0 else force
        scale = 1.0
        for k in range(min(terms, degree + 1)):
            # The binomial theorem: ((s + r t)^n)_k = C(n, k) s^(n - k) r^k.
            total, weight = 0.0, 1.0
            for n in range(k, terms):
                total += weight * lanes[jet + n, i]
                weight *= start * (n + 1.0) / (n + 1.0 - k)
            series[k] = series[k] + scale * total
            scale *= ratio


@kernel
def write_series(c, width, model, lanes, i, elapsed, duration, degree):
    """Write the series of the carriage's force (row 6) and of the ground's acceleration (row 7).

    Their terms are as those of `add_jets`; rows of c are a width apart. Without excitation nothing
    is written.
    """
    harmonics, ground = int(model[layout.HARMONIC_COUNT]), int(model[layout.GROUND])
    if harmonics == 0 and model[layout.TERMS] == 0.0:
        return
    for n in range(degree + 1):
        c[6 * width + n] = c[7 * width + n] = 0.0
    of_force, of_ground = c[6 * width :], c[7 * width :]
    add_jets(of_force, of_ground, model, lanes, i, elapsed, duration, degree)
    for j in range(harmonics):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        amplitude = lanes[harmonic + layout.AMPLITUDE, i]
        frequency = lanes[harmonic + layout.FREQUENCY, i]
        phase = lanes[harmonic + layout.COSINE, i], lanes[harmonic + layout.SINE, i]
        wave = amplitude, frequency, phase[0], phase[1]
        series = of_ground if (ground >> j) & 1 else of_force
        add_harmonic(series, wave, elapsed, duration, degree)


@inlined_kernel
def add_harmonic(terms, wave, elapsed, duration, degree):
    """Add a harmonic to a series, of any kind of number, as `add_jets` has it.

    A wave is amplitude, frequency [rad/s], and cosine and sine of the phase at the sample
    interval's start.
    """
    scale, frequency, from_cosine, from_sine = wave
    cosine, sine = cosine_and_sine(frequency * elapsed)
    value = scale * (from_sine * cosine + from_cosine * sine)
    slope = scale * (from_cosine * cosine - from_sine * sine)
    turn = frequency * duration
    slope = slope * turn
    for n in range(degree + 1):
        terms[n] = terms[n] + value
        # From p'' = -frequency**2 p: the next term follows from the last but one.
        value, slope = slope, -value * turn * turn / ((n + 1.0) * (n + 2.0))
