"""The response of a linear plant to an impulse within a sample interval, with its deviations."""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.simd import LANES, alike
from mm_gym.lanes.simd_masks import where
from mm_gym.lanes.simd_memory import rows_on_stack
from mm_gym.lanes.tangents import slopes_of, tangent, tangents_of, value_of
from mm_gym.law.springs import stiffness
from mm_gym.sensitivity.columns_kernel import read_rows
from mm_gym.sensitivity.generator_kernel import add, derivative
from mm_gym.sensitivity.layout import (
    DEGREE,
    FIRST_ROW,
    LAST_V1,
    LAST_V2,
    PIECES,
    STATES,
    TANGENTS,
    WIDTH,
)

_lane = rows_on_stack(2 * (at.HARMONICS + STATES))


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
    own, width, c = int(model[FIRST_ROW]), int(model[WIDTH]), tangents_of(_lane())
    for first in range(0, width, LANES):
        read_rows(model, lanes, i, 0, at.HARMONICS, c, first)
        end = _response(model, c, time, v1, v2)
        for part in range(STATES):
            c[at.HARMONICS + part] = end[part]
            for j in range(min(width - first, LANES)):
                row = own + TANGENTS + part * width + first + j
                lanes[row, i] += c[at.HARMONICS + part, j]
    for part in range(STATES):
        lanes[part, i] += value_of(c[at.HARMONICS + part])
    lanes[own + LAST_V1, i] += value_of(c[at.HARMONICS + at.V1])
    lanes[own + LAST_V2, i] += value_of(c[at.HARMONICS + at.V2])


@borrowing_kernel
def _response(model, lane, time, v1, v2):
    """Return x1, x2, v1 and v2 as numbers with tangents.

    Parameters
    ----------
    model
        (m,) read.
    lane
        A lane's rows as numbers with tangents; read.
    time, v1, v2
        As for `respond`.
    """
    piece = time / model[PIECES]
    m1, k0, rate = lane[at.M1], lane[at.K0], piece / lane[at.M1]
    k2 = where(k0 > 0.0, stiffness(k0, lane[at.STRETCH]), k0)
    generator = (
        piece * rate * lane[at.K1] * lane[at.ALPHA],
        rate * lane[at.D],
        rate * lane[at.C],
        piece * rate * k2,
        m1 / lane[at.M2],
    )
    # The impulse on the carriage changed v1 by its size over the mass.
    late, rest = slopes_of((v1 - v2) * value_of(m1) * rate), alike(m1, 0.0)
    total = rest, rest, tangent(piece * v1, late), tangent(piece * (v2 - v1), -late)
    for _ in range(int(model[PIECES])):
        term, weight = total, 1.0
        for n in range(int(model[DEGREE])):
            weight /= n + 1.0
            term, _coupling = derivative(generator, term, 0.0)
            total = add(total, weight, term)
    x1, offset, way, slip = total
    return x1, x1 + offset, way * (1.0 / piece), (way + slip) * (1.0 / piece)
