"""Energy rates of nonlinear plants, integrated along Taylor series: (11) of docs/model.md.

The series are those along which deviations are followed, without any, and with nothing but
round-off cut off, whatever tolerance the plant itself has.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.excitation.sources import is_excited
from mm_gym.lanes import layout
from mm_gym.lanes.tangents import value_of
from mm_gym.sensitivity.series_kernel import FORCE, GROUND, LANE, SLIP, SLOPE, V1, W, propagating

ENOUGH = 2.0**-56, 8
"""See `propagating`. Of fewer terms, symmetry could make all zero: begun at rest, a cubic spring
leaves one in six."""


@borrowing_kernel
def _add_work(model, lanes, i, c, series):
    """Add the integrals of both energy rates, term by term, to the last two rows [J].

    d v1^2 + f w, and p v1 - a_g (m1 v1 + m2 v2), the terms of (11) of docs/model.md.
    """
    (unit, theta, order), excited, last = series, is_excited(model), lanes.shape[0] - 1
    m1, m2 = value_of(c[LANE + layout.M1]), value_of(c[LANE + layout.M2])
    d = value_of(c[LANE + layout.D])
    slope, constant = m1 * value_of(c[SLOPE]), m1 * value_of(c[SLIP])
    power = unit
    for n in range(order + 1):
        power *= theta
        dissipated, given = constant * value_of(c[W + n]), 0.0
        for k in range(n + 1):
            v1, w = value_of(c[V1 + n - k]), value_of(c[W + n - k])
            dissipated += d * value_of(c[V1 + k]) * v1 + slope * value_of(c[W + k]) * w
            if excited:
                given += value_of(c[FORCE + k]) * v1
                given -= value_of(c[GROUND + k]) * ((m1 + m2) * v1 + m2 * w)
        lanes[last - 1, i] += dissipated * power / (n + 1.0)
        lanes[last, i] += given * power / (n + 1.0)


propagate = propagating(_add_work, ENOUGH)
