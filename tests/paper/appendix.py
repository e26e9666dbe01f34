"""The paper's appendix, eqs 20 to 28, in mpmath: as printed, or with what is wrong mended.

Nothing here is shared with the package. `mend` names the errata of docs/model.md that are applied.
"""

from __future__ import annotations

from typing import NamedTuple

from mpmath import cbrt, mpc, mpf, root, sqrt

J = mpc(0, 1)


class System(NamedTuple):
    """Masses [kg], stiffnesses [N/m] and dampings [N s/m]."""

    m1: mpf
    m2: mpf
    k1: mpf
    k2: mpf
    c: mpf
    d: mpf


def coefficients(s):
    """Return g0 .. g4, eq. 26."""
    m1, m2, k1, k2, c, d = s
    return (
        k1 * k2,
        c * k1 + d * k2,
        c * d + k1 * m2 + k2 * (m1 + m2),
        c * m1 + m2 * (c + d),
        m1 * m2,
    )


def letters_of_21(s, *, mend):
    """Return G, H, I and L; the mend is E1."""
    m1, m2, k1, _, c, d = s
    first, second = 2 * k1 * m2, k1 * m2 - c * (5 * c + 2 * d)
    joined = first * second if mend else first + second
    g = (
        4 * c**4 * k1 * m1**3
        + m2**2 * (c + d) ** 2 * (k1 * m2 * (2 * c * (2 * c + d) - k1 * m2) - c**2 * d**2)
        + c**2 * m1**2 * (4 * k1 * m2 * (c * (3 * c - 2 * d) + 2 * k1 * m2) - c**2 * d**2)
        + 2
        * m1
        * m2
        * (k1 * m2 * (c**2 * (6 * c**2 + c * d + d**2) + joined) - c**3 * d**2 * (c - d))
    )
    h = (
        -2 * (c + d) ** 3 / m1**3
        - 3 * (c + d) * (c * (2 * c - d) - 3 * k1 * m2) / (m1**2 * m2)
        - 3 * c * (c * (2 * c - d) + 6 * k1 * m2) / (m1 * m2**2)
        - 2 * c**3 / m2**3
    )
    total = c * (m1 + m2) + d * m2
    i = total / (3 * m1 * m2)
    small_l = (3 * m1 * m2 * (c * d + k1 * m2) - total**2) / (3 * m1**2 * m2**2)
    return 27 * g / (m1**4 * m2**4), h, i, small_l


def eigenvalues_of_20(s, *, mend=True):
    """Return eta 1 to 4."""
    g, h, i, small_l = letters_of_21(s, mend=mend)
    third = root(sqrt(mpc(g)) + h, 3)
    two = cbrt(mpf(2))
    found = [mpc(0), third / (3 * two) - two * small_l / third - i]
    for sign in (1, -1):
        turn = 1 + sign * J * sqrt(mpf(3))
        back = 1 - sign * J * sqrt(mpf(3))
        found.append(turn * small_l / (two**2 * third) - back * third / (6 * two) - i)
    return found


def letters_of_25(s, *, mend):
    """Return N, P and Q; the mend is E4."""
    g0, g1, g2, g3, g4 = coefficients(s)
    d1 = 2 * g2**3 - 9 * g1 * g2 * g3 + 27 * g0 * g3**2 + 27 * g1**2 * g4 - 72 * g0 * g2 * g4
    d0 = g2**2 - 3 * g1 * g3 + 12 * g0 * g4
    n = d1 + sqrt(mpc(d1**2 - 4 * d0**3))
    two, third = cbrt(mpf(2)), root(n, 3)
    p = two * d0 / (3 * third)
    factor, scale = (two**7, two**4 * sqrt(mpf(3))) if mend else (mpf(6), mpf(1))
    inside = 3 * two**2 * g3**2 + factor * g4 * third - two**11 * g2 * g4 + 3 * two**8 * g4 * p
    q = scale * (4 * g2 * g3 * g4 - 8 * g1 * g4**2 - g3**3) / (4 * g4**2 * sqrt(inside))
    return n, p, q


def eigenvalues_of_24(s, mend=("E2", "E3", "E4")):
    """Return gamma 1 to 4; the mends are E2, E3 and, of Q, E4."""
    _, _, g2, g3, g4 = coefficients(s)
    n, p, q = letters_of_25(s, mend="E4" in mend)
    divisor = 3 * cbrt(mpf(2)) if "E2" in mend else cbrt(mpf(32))
    part = root(n, 3) / (divisor * g4)
    first = sqrt(g3**2 / (4 * g4**2) + part - 2 * g2 / (3 * g4) + p / g4)
    rest = g3**2 / (2 * g4**2) - part - 4 * g2 / (3 * g4) - p / g4
    low, high = sqrt(rest - q), sqrt(rest + q)
    centre = g3 / (4 * g4)
    found = [-centre - first / 2 + sign * low / 2 for sign in (-1, 1)]
    for sign in (-1, 1):
        middle = -centre if "E3" in mend else sign * centre
        found.append(middle + first / 2 + sign * high / 2)
    return found


def norm_of_23(s, eta):
    """Return M."""
    m1, _, k1, _, c, d = s
    inner = 2 * c**2 + 2 * c * (d + m1 * eta) + (d + m1 * eta) ** 2
    return sqrt((1 + eta**2) * (k1**2 + 2 * k1 * eta * (c + d + m1 * eta) + eta**2 * inner))


def eigenvectors_of_22(s, eta):
    """Return the eigenvector of eq. 22 divided by the M of eq. 23, and M."""
    m1, _, k1, _, c, d = s
    norm = norm_of_23(s, eta)
    x1, x2 = c * eta, k1 + eta * (c + d + m1 * eta)
    return [part / norm for part in (x1, x2, eta * x1, eta * x2)], norm


def eigenvectors_of_27(s, gamma):
    """Return the eigenvector of eq. 27 divided by the R of eq. 28, and R."""
    _, m2, _, k2, c, _ = s
    norm = sqrt(
        (1 + gamma**2)
        * (
            2 * c * m2 * gamma**3
            + m2**2 * gamma**4
            + 4 * c * gamma * k2
            + 2 * k2**2
            + 2 * gamma**2 * (c**2 + m2 * k2)
        )
    )
    x1, x2 = c * gamma + m2 * gamma**2 + k2, c * gamma + k2
    return [part / norm for part in (x1, x2, gamma * x1, gamma * x2)], norm
