"""Terms of motion and deviations within a regime of a linear plant.

Force and stretch alone make columns deviate. How many terms it takes is known beforehand, from the
fastest rate.
"""

from __future__ import annotations

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma, prefer_widest_vectors
from mm_gym.kernels.jit import borrowing_kernel
from mm_gym.sensitivity import series_layout as of
from mm_gym.sensitivity.layout import CAUSES, COLUMNS

ROUND_OFF = 2.0**-54
"""Terms that are smaller, over the first one, do not change a sum."""


@borrowing_kernel
def expand_linear(model, c, p, t, work, unit, phase):
    """Write the series; return their order.

    Parameters
    ----------
    model, c, p, t, work
        As for `series_kernel`: first terms, coefficients and the excitation's series are read, all
        other terms written.
    unit
        Unit of time [s].
    phase
        The fastest rate times it, at most `series_kernel.LONGEST`.
    """
    prefer_widest_vectors()
    by_m1, by_both = 1.0 / p[of.M1], 1.0 / p[of.M1] + 1.0 / p[of.M2]
    k1, k2, d, damping = p[of.K1] * p[of.ALPHA], p[of.K2], p[of.D], p[of.DAMPING]
    excited = model[at.HARMONIC_COUNT] > 0.0 or model[at.TERMS] > 0.0
    held, slip, bound = p[of.HELD], p[of.SLIP], 1.0
    pull, push = work[0], work[1]
    for j in range(COLUMNS):
        pull[j] = push[j] = 0.0
        if model[CAUSES + j] == at.FORCE:
            push[j] = 1.0
        elif model[CAUSES + j] == at.STRETCH:
            pull[j] = -12.0 * p[of.K0] / p[of.STRETCH] ** 4
    for n in range(of.ORDER):
        step = unit / (n + 1.0)
        offset = c[of.OFFSET + n]
        inner = fma(damping, c[of.W + n], k2 * offset) + slip
        outer, ground = fma(k1, c[of.X1 + n], fma(d, c[of.V1 + n], -held)), 0.0
        if excited:
            outer -= c[of.FORCE + n]
            ground = c[of.GROUND + n]
        c[of.X1 + n + 1], c[of.OFFSET + n + 1] = step * c[of.V1 + n], step * c[of.W + n]
        c[of.V1 + n + 1] = step * ((inner - outer) * by_m1 - ground)  # (1)
        c[of.W + n + 1] = step * (outer * by_m1 - inner * by_both)  # (2) less (1)
        held = slip = 0.0
        for j in range(COLUMNS):
            v, w = t[2 * of.PART + n, j], t[3 * of.PART + n, j]
            between = fma(damping, w, fma(k2, t[of.PART + n, j], pull[j] * offset))
            resisted = fma(k1, t[n, j], fma(d, v, -push[j]))
            push[j] = 0.0
            t[n + 1, j], t[of.PART + n + 1, j] = step * v, step * w
            t[2 * of.PART + n + 1, j] = step * ((between - resisted) * by_m1)
            t[3 * of.PART + n + 1, j] = step * fma(resisted, by_m1, -between * by_both)
        bound *= phase / (n + 1.0)
        if bound <= ROUND_OFF and n > 1:
            return n + 1
    return of.ORDER
