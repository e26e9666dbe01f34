"""The linear plant about equilibrium: its coefficients, modes and frequency response."""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SceneError, finite_numbers
from mm_gym.lanes import layout
from mm_gym.plant.linearise import values_about
from mm_gym.plant.support_of import support_of
from mm_gym.scene.scene import Scene

Roots = NDArray[np.complex128]


class Linear(NamedTuple):
    """Coefficients about rest: masses [kg], stiffnesses [N/m], dampings [N s/m]."""

    m1: float
    m2: float
    k1: float
    k2: float
    c: float
    d: float


def linear_values(scene: Scene) -> Linear:
    """Return the coefficients: the middle of each range, friction with its slope in stick."""
    support = support_of(scene)
    p = support.middle
    p[layout.X1 : layout.V2 + 1] = 0.0
    values = values_about(support, p)
    return Linear(*(float(values[name]) for name in Linear._fields))


def characteristic(values: Linear) -> Array:
    """Return g4 .. g0 of det(M s^2 + C s + K), eq. 13 of docs/model.md."""
    m1, m2, k1, k2, c, d = values
    return np.array(
        [m1 * m2, m1 * c + m2 * (c + d), m1 * k2 + c * d + m2 * (k1 + k2), d * k2 + c * k1, k1 * k2]
    )


NEGLIGIBLE = 2.0**-60
"""Ratio of the carriage's inertia to its damping, at the rate of the slower motions, below which
its own motion is separate from them to round-off."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Free motions x(t) = shape exp(eigenvalue t) about equilibrium.

    They are sorted by the magnitude of the eigenvalue, then by its imaginary part.

    Attributes
    ----------
    eigenvalues
        (n,) complex128 [1/s], computed numerically. n is 4, or 3 for a carriage without mass.
    shapes
        (2, n) complex128 [-]: x1 and x2 of each mode, scaled so that the larger is 1. A defective
        eigenvalue has two equal columns.
    closed_form
        (n,) complex128 [1/s]: the same eigenvalues by Cardano (no springs) or Ferrari.
    defective
        Whether the zero eigenvalue is double but has only one mode shape. A free sphere (c = 0, no
        springs) drifts, and its motion is not a sum of modes.
    """

    eigenvalues: Roots
    shapes: NDArray[np.complex128]
    closed_form: Roots
    defective: bool

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies (n,) [rad/s]."""
        return np.abs(self.eigenvalues)

    @property
    def hertz(self) -> Array:
        """Undamped natural frequencies (n,) [Hz]."""
        return self.frequencies / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios (n,) [-].

        1 for negative eigenvalues, -1 for positive ones, and not a number for zero ones.
        """
        size = np.abs(self.eigenvalues)
        return np.divide(
            -self.eigenvalues.real, size, out=np.full(len(size), np.nan), where=size > 0.0
        )


def modes(scene: Scene) -> Modes:
    """Return the modes of a scene's linear plant about equilibrium.

    A range is replaced by its middle, a cubic spring by its tangent, and dry friction by its slope
    in stick. The equilibrium is x1 = 0, even if it is unstable: with
    ``carriage.linear_coefficient`` < 0 one eigenvalue is positive. For the modes about a well of
    such a spring, set the linear coefficient to -2 alpha and the cubic one to 0.

    Notes
    -----
    The closed form is that of eqs 15 to 19 of docs/model.md, in double precision: Cardano and
    Ferrari, equal to the paper's appendix except for its errata. It loses as many digits as the
    eigenvalues differ in magnitude; the numerical ones do not. For a carriage of vanishing mass it
    uses the polynomial without its leading term.
    """
    values = linear_values(scene)
    numerical = _ordered(_numerical(values))
    return Modes(
        eigenvalues=numerical,
        shapes=_shapes(values, numerical),
        closed_form=_matched(_closed_form(values), numerical),
        defective=values.k2 == values.c == 0.0,
    )


def _numerical(values: Linear) -> Roots:
    """Return the eigenvalues of E x' = A x; that of a negligible carriage mass is split off."""
    m1, m2, k1, k2, c, d = values
    if k2 == 0.0:
        # Of x1, x2 - x1, v1, v2 the second column is exactly zero, and so is one eigenvalue. It is
        # divided out, so that round-off can neither split nor move it.
        a = np.array([[0.0, 1.0, 0.0], [-k1, -(c + d), c], [0.0, c, -c]])
        e = np.diag([1.0, m1, m2])
    else:
        a = np.array(
            [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 1.0], [-k1, k2, -(c + d), c], [0.0, -k2, c, -c]]
        )
        e = np.diag([1.0, 1.0, m1, m2])
    if _separate(values):
        slow = np.roots(characteristic(values)[1:]).astype(np.complex128)
        return np.append(slow, -(c + d) / m1) if m1 else slow
    if c == 0.0 and k2 == 0.0:
        pair = np.linalg.eigvals(np.array([[0.0, 1.0], [-k1 / m1, -d / m1]]))
        return np.append(pair, [0.0, 0.0])
    scale = np.diag(1.0 / np.sqrt(np.diag(e)))
    found = np.linalg.eigvals(scale @ a @ scale).astype(np.complex128)
    return np.append(found, 0.0) if k2 == 0.0 else found


def _separate(values: Linear) -> bool:
    """Tell whether the carriage's inertia is negligible at the rates of all other motions."""
    m1, m2, k1, k2, c, d = values
    resistance = c + d
    if resistance == 0.0:
        return False
    slow = (abs(k1) + k2) / resistance + c / m2 + np.sqrt(k2 / m2)
    return bool(m1 * slow <= NEGLIGIBLE * resistance)


def _closed_form(values: Linear) -> list[complex]:
    """Return the eigenvalues in closed form, the carriage's own apart if separate."""
    g4, g3, g2, g1, g0 = (float(g) for g in characteristic(values))
    if _separate(values):
        fast = [-complex(values.c + values.d) / values.m1] if values.m1 else []
        return fast + ([0j, *_quadratic(g3, g2, g1)] if g0 == 0.0 else _cubic(g3, g2, g1, g0))
    if g0 != 0.0:
        return _quartic(g4, g3, g2, g1, g0)
    # Without c the zero root is double: eqs 5 and 22 of the paper fail there.
    return [0j, 0j, *_quadratic(g4, g3, g2)] if g1 == 0.0 else [0j, *_cubic(g4, g3, g2, g1)]


def _quadratic(a: float, b: float, c: float) -> list[complex]:
    root = cmath.sqrt(b * b - 4.0 * a * c)
    return [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]


def _cubic(a: float, b: float, c: float, d: float) -> list[complex]:
    """Return the roots of a s^3 + b s^2 + c s + d by Cardano: eq. 15 of docs/model.md."""
    b, c, d = b / a, c / a, d / a
    centre = b / 3.0  # I of the paper
    linear = c - b * b / 3.0  # L
    h = 9.0 * b * c - 27.0 * d - 2.0 * b**3
    root = cmath.sqrt(h * h + 108.0 * linear**3)  # of G
    # Of the two square roots the one that does not cancel H.
    cube = (h + root if abs(h + root) >= abs(h - root) else h - root) / 2.0
    if cube == 0.0:
        return [complex(-centre)] * 3
    return [turn / 3.0 - linear / turn - centre for turn in _cube_roots(cube)]


def _quartic(g4: float, g3: float, g2: float, g1: float, g0: float) -> list[complex]:
    """Return the roots of g4 s^4 + ... + g0 by Ferrari: eqs 16 to 19 of docs/model.md."""
    d0 = g2 * g2 - 3.0 * g1 * g3 + 12.0 * g0 * g4
    d1 = 2.0 * g2**3 - 9.0 * g1 * g2 * g3 + 27.0 * (g4 * g1 * g1 + g0 * g3 * g3)
    d1 -= 72.0 * g0 * g2 * g4
    root = cmath.sqrt(d1 * d1 - 4.0 * d0**3)
    n = d1 + root if abs(d1 + root) >= abs(d1 - root) else d1 - root  # N of the paper
    # N^(1/3) / (3 2^(1/3)) + P, for each cube root; without N all of the resolvent's roots coincide
    sums = [(turn + d0 / turn) / 3.0 for turn in _cube_roots(n / 2.0)] if n else [0j]
    square = g3 * g3 / (4.0 * g4 * g4) - 2.0 * g2 / (3.0 * g4)
    s = max((square + total / g4 for total in sums), key=abs)
    rest = 3.0 * g3 * g3 / (4.0 * g4 * g4) - 2.0 * g2 / g4 - s  # Z of docs/model.md
    half = cmath.sqrt(s)
    q = (4.0 * g2 * g3 * g4 - 8.0 * g1 * g4 * g4 - g3**3) / (4.0 * g4**3 * half) if half else 0j
    centre = -g3 / (4.0 * g4)
    low, high = cmath.sqrt(rest - q) / 2.0, cmath.sqrt(rest + q) / 2.0
    left, right = centre - half / 2.0, centre + half / 2.0
    return [left - low, left + low, right - high, right + high]


def _cube_roots(value: complex) -> list[complex]:
    return [value ** (1.0 / 3.0) * cmath.exp(2j * cmath.pi * k / 3.0) for k in range(3)]


def _ordered(roots: Roots) -> Roots:
    """Return the roots sorted by magnitude, to 11 digits as of conjugates, then imaginary part."""
    size = np.abs(roots)
    key = np.where(size > 0.0, np.round(np.log(np.where(size > 0.0, size, 1.0)), 11), -np.inf)
    return roots[np.lexsort((roots.imag, key))].astype(np.complex128)


def _matched(roots: list[complex], reference: Roots) -> Roots:
    """Return the roots in the order of the reference, each nearest to its own."""
    left = list(roots)
    nearest = [left.pop(int(np.argmin(np.abs(np.array(left) - wanted)))) for wanted in reference]
    return np.array(nearest, np.complex128)


def _shapes(values: Linear, eigenvalues: Roots) -> NDArray[np.complex128]:
    """Return x1 and x2 of each mode: the vector orthogonal to a row of the dynamic stiffness."""
    m1, m2, k1, k2, c, d = values
    shapes = np.empty((2, len(eigenvalues)), np.complex128)
    for n, s in enumerate(eigenvalues):
        if s == 0.0 and k2 == 0.0:
            shapes[:, n] = 0.0, 1.0  # the sphere rests anywhere
            continue
        coupling = k2 + c * s
        first = m1 * s * s + (c + d) * s + k1 + k2
        second = m2 * s * s + coupling
        shape = np.array([second, coupling])
        size = abs(s)  # orthogonal to the row whose diagonal keeps more digits
        own = m1 * size**2 + (c + d) * size + abs(k1) + k2
        if abs(first) * (m2 * size**2 + c * size + k2) > abs(second) * own:
            shape = np.array([coupling, first])
        if coupling == 0.0:  # the row can vanish if nothing couples the sphere
            shape = np.array([1.0, 0.0] if abs(first) < abs(second) else [0.0, 1.0])
        largest = int(np.argmax(np.abs(shape)))
        shapes[:, n] = shape / shape[largest]
        shapes[largest, n] = 1.0
    return shapes


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Complex amplitudes of x1 and x2 (the columns) under excitation exp(i w t).

    Attributes
    ----------
    frequencies
        (n,) [rad/s].
    force
        (n, 2) complex128 [m/N]: receptance, per unit force on the carriage.
    ground
        (n, 2) complex128 [s^2]: per unit acceleration of the ground; displacements are relative to
        the ground.
    """

    frequencies: Array
    force: NDArray[np.complex128]
    ground: NDArray[np.complex128]


def frequency_response(scene: Scene, frequencies: ArrayLike) -> FrequencyResponse:
    """Return the steady response to harmonic excitation (eq. 20 of docs/model.md).

    A range is replaced by its middle, a cubic spring by its tangent, and dry friction by its slope
    in stick. With ``carriage.linear_coefficient`` < 0 the equilibrium x1 = 0 is unstable. No motion
    then approaches the returned steady solution by itself, but a control design needs it. At an
    undamped resonance the amplitudes are infinite.

    Parameters
    ----------
    scene
        Any scene; its own excitation is ignored.
    frequencies
        (n,) [rad/s], greater than 0, because a free sphere has no definite equilibrium.

    Raises
    ------
    SceneError
        If a frequency is not a finite number greater than 0.
    """
    w = np.atleast_1d(finite_numbers("frequencies", frequencies))
    if w.ndim != 1 or not np.all(w > 0.0):
        msg = "frequencies: allowed: a one-dimensional array of finite numbers greater than 0 rad/s"
        raise SceneError(msg)
    values = linear_values(scene)
    force, ground = (
        np.column_stack(receptance(values, excitation, w)) for excitation in ("force", "ground")
    )
    return FrequencyResponse(frequencies=w, force=force, ground=ground)


def receptance(values: Linear, excitation: str, w: Array) -> tuple[Roots, Roots]:
    """Return the complex amplitudes (n,) of x1 and x2 at frequencies (n,) [rad/s].

    They are those per unit of a "force" on the carriage [m/N], or of the acceleration of the
    "ground" [s^2]. The interface's damping may be (n,) too.
    """
    m1, m2, k1, k2, c, d = values
    s = 1j * w
    coupling = k2 + c * s
    # The sphere's row is divided by s, or digits cancel at low frequencies without springs.
    carriage, sphere, link = k1 + m1 * s * s + d * s, m2 * s, coupling / s
    # det / s = carriage (sphere + link) + sphere coupling
    determinant = carriage * (sphere + link) + sphere * coupling
    with np.errstate(divide="ignore", invalid="ignore"):
        if excitation == "force":
            return (sphere + link) / determinant, link / determinant
        # The ground pushes the masses with -m1 and -m2.
        x1 = -(m1 * (sphere + link) + m2 * link) / determinant
        return x1, -(m2 * (carriage + coupling) / s + m1 * link) / determinant
