"""Slow and obvious reference solutions, in mpmath; they share no code with the package."""

from dataclasses import dataclass, replace

import mpmath as mp
import numpy as np


@dataclass(frozen=True)
class System:
    """The linear system; doubles enter as the numbers that they exactly are."""

    m1: float = 0.1
    m2: float = 0.04
    k1: float = 400.0
    d: float = 1.0
    c: float = 1.0
    k2: float = 0.0

    def with_springs(self, stiffness, stretch):
        """Return the system with springs of eq. 15 of the paper."""
        with mp.workdps(50):
            k2 = 2 * mp.mpf(stiffness) * (1 + 2 / mp.mpf(stretch) ** 3)
        return replace(self, k2=k2)

    def matrix(self):
        """Return A of x' = A x, state x1, x2, v1, v2."""
        m1, m2, k1, d, c, k2 = (mp.mpf(v) for v in self.values())
        return mp.matrix(
            [
                [0, 0, 1, 0],
                [0, 0, 0, 1],
                [-(k1 + k2) / m1, k2 / m1, -(c + d) / m1, c / m1],
                [k2 / m2, -k2 / m2, c / m2, -c / m2],
            ]
        )

    def values(self):
        return self.m1, self.m2, self.k1, self.d, self.c, self.k2

    def sampled(self, time):
        """Return [exp(A t) | response to a held unit force] as a (4, 5) matrix."""
        with mp.workdps(60):
            norm = mp.mnorm(self.matrix(), mp.inf) * time
            digits = max(int(mp.log10(norm)), 0) if norm else 0
        with mp.workdps(60 + 3 * digits):
            generator = mp.zeros(5)
            generator[:4, :4] = self.matrix()
            generator[2, 4] = 1 / mp.mpf(self.m1)
            return mp.expm(generator * mp.mpf(time))[:4, :]

    def steady_state(self, frequency, phase, *, amplitude=1.0, ground=False):
        """Return a function of time: the steady answer to amplitude * sin(frequency t + phase).

        From the complex dynamic stiffness K + i w C - w^2 M; the ground's acceleration pulls both
        masses backwards.
        """
        m1, m2, k1, d, c, k2 = (mp.mpf(v) for v in self.values())
        w = mp.mpf(frequency)
        iw = mp.mpc(0, 1) * w
        coupling = k2 + iw * c
        stiffness = mp.matrix(
            [
                [k1 + iw * d + coupling - w**2 * m1, -coupling],
                [-coupling, coupling - w**2 * m2],
            ]
        )
        load = mp.matrix([-m1, -m2] if ground else [1, 0]) * mp.mpf(amplitude)
        x = mp.lu_solve(stiffness, load)

        def at(time):
            turn = mp.expj(w * mp.mpf(time) + mp.mpf(phase))
            return mp.matrix([mp.im(z * turn) for z in (x[0], x[1], iw * x[0], iw * x[1])])

        return at

    def motion(self, start, times, steady=None):
        """Return states (n, 4) at the times: a steady motion plus what is free, from the start."""
        with mp.workdps(40):
            rest = steady or (lambda _: mp.zeros(4, 1))
            free = mp.matrix([mp.mpf(float(v)) for v in start]) - rest(0)
            return np.array(
                [
                    [float(v) for v in rest(t) + self.sampled(t)[:, :4] * free]
                    for t in map(float, times)
                ]
            )


def error_of_scale(state, expected, start=None):
    """Return the largest error of positions and velocities, each relative to its own scale.

    The scale is the largest expected magnitude, of the start too; at rest nothing may move.
    """
    known = expected if start is None else np.vstack([np.asarray(start, float), expected])
    errors = []
    for columns in (slice(0, 2), slice(2, 4)):
        scale = np.abs(known[:, columns]).max()
        error = np.abs(state[:, columns] - expected[:, columns]).max()
        errors.append(error / scale if scale else (np.inf if error else 0.0))
    return max(errors)
