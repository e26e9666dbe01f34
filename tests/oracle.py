"""Reference solutions in mpmath, which use no code of the package, and errors against them."""

from dataclasses import dataclass, replace

import mpmath as mp
import numpy as np


@dataclass(frozen=True)
class System:
    """The linear system; doubles are converted exactly."""

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
        """Return m1, m2, k1, d, c, k2."""
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
        """Return a function of time: the steady response to amplitude * sin(frequency t + phase).

        It follows from the complex dynamic stiffness K + i w C - w^2 M. A ground acceleration a
        acts on the masses as -m1 a and -m2 a.
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
        """Return the states (n, 4) at the times: the steady motion plus the free one."""
        with mp.workdps(40):
            rest = steady or (lambda _: mp.zeros(4, 1))
            free = mp.matrix([mp.mpf(float(v)) for v in start]) - rest(0)
            return np.array(
                [
                    [float(v) for v in rest(t) + self.sampled(t)[:, :4] * free]
                    for t in map(float, times)
                ]
            )


def scale_of(*states):
    """Return the scale (4,): the largest position, twice, and the largest velocity, twice."""
    largest = np.abs(np.vstack(states)).max(axis=0)
    return np.repeat([largest[:2].max(), largest[2:].max()], 2)


def error(got, want, scale=None):
    """Return the largest error of states (n, 4), relative to a scale (4,).

    By default the scale is that of the wanted states. Where it is 0, any difference is infinite.
    """
    got, want = np.atleast_2d(got), np.atleast_2d(want)
    scale = scale_of(want) if scale is None else np.asarray(scale)
    difference = np.abs(got - want).max(axis=0)
    without_scale = np.where(difference == 0.0, 0.0, np.inf)
    return float(np.divide(difference, scale, out=without_scale, where=scale > 0.0).max())
