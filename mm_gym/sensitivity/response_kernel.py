"""The response of a linear plant to an impulse within a sample interval, with its deviations."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma
from mm_gym.law.springs import stiffness
from mm_gym.sensitivity.generator_kernel import (
    COUPLING,
    OFFSET,
    V1,
    X1,
    W,
    add,
    derivative,
    slope,
)
from mm_gym.sensitivity.layout import (
    CAUSES,
    DEGREE,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    PIECES,
    STATES,
    TANGENTS,
    WIDTH,
)


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):
    """Add to motion and deviations of a lane what follows from given velocities at rest.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) float64; parameters are read, state and deviations written.
    time
        How long the motion lasts [s]; at most the sample interval.
    v1, v2
        Velocities at its start [m/s].
    i
        The lane.
    """
    pieces, own, width = int(model[PIECES]), int(model[FIRST_ROW]), int(model[WIDTH])
    piece = time / pieces
    z, _ = _respond(model, lanes, piece, (v1, v2), at.FORCE, i)  # the force drives nothing here
    _add(lanes, at.X1, 1, piece, z, i)
    lanes[own + LAST_V1, i] += z[2] / piece
    lanes[own + LAST_V2, i] += (z[2] + z[3]) / piece
    for j in range(STATES, width):
        cause = int(model[CAUSES + j])
        if cause < at.HARMONICS and cause != at.FORCE:
            _, y = _respond(model, lanes, piece, (v1, v2), cause, i)
            _add(lanes, own + TANGENTS + j, width, piece, y, i)


@borrowing_kernel
def _add(lanes, row, width, piece, z, i):
    """Add a state in units of a piece to rows of x1, x2, v1 and v2."""
    lanes[row, i] += z[0]
    lanes[row + width, i] += z[0] + z[1]
    lanes[row + 2 * width, i] += z[2] / piece
    lanes[row + 3 * width, i] += (z[2] + z[3]) / piece


@borrowing_kernel
def _respond(model, lanes, piece, velocities, cause, i):
    """Return motion and deviation, in units of a piece.

    Parameters
    ----------
    model, lanes, i
        As for `respond`; read.
    piece
        Length of a piece [s].
    velocities
        v1 and v2 at the start [m/s].
    cause
        Row of the parameter that deviates.
    """
    m1, m2, k0, stretch = lanes[at.M1, i], lanes[at.M2, i], lanes[at.K0, i], lanes[at.STRETCH, i]
    k1, alpha, rate = lanes[at.K1, i], lanes[at.ALPHA, i], piece / m1
    k2 = stiffness(k0, stretch) if k0 > 0.0 else 0.0
    generator = (
        piece * rate * k1 * alpha,
        rate * lanes[at.D, i],
        rate * lanes[at.C, i],
        piece * rate * k2,
        m1 / m2,
    )
    row, to_v1, to_w = slope(cause, (m1, m2, k1, alpha, k0, stretch), piece)
    v1, v2 = velocities
    total, deviation = (0.0, 0.0, piece * v1, piece * (v2 - v1)), (0.0, 0.0, 0.0, 0.0)
    if cause == at.M1:  # the impulse changed v1 by its size over the mass
        late = rate * (v1 - v2)
        deviation = 0.0, 0.0, -late, late
    for _ in range(int(model[PIECES])):
        term, turn, weight = total, deviation, 1.0
        for n in range(int(model[DEGREE])):
            before = term
            weight /= n + 1.0
            term, coupling = derivative(generator, before, 0.0)
            signal = term[2]
            if row == COUPLING:
                signal = coupling
            elif row == X1:
                signal = before[0]
            elif row == OFFSET:
                signal = before[1]
            elif row == V1:
                signal = before[2]
            elif row == W:
                signal = before[3]
            turn, _ = derivative(generator, turn, 0.0)
            turn = turn[0], turn[1], fma(to_v1, signal, turn[2]), fma(to_w, signal, turn[3])
            total, deviation = add(total, weight, term), add(deviation, weight, turn)
    return total, deviation
