"""The search of the best friction: on the first harmonic, then on the simulated motion."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# SciPy ships no types

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from mm_gym.analysis.springs import stretch_for_stiffness
from mm_gym.analysis.values import linear_values
from mm_gym.scene.mechanics import DryFriction
from mm_gym.tuning.first_harmonic import friction_of, steady_state
from mm_gym.tuning.friction_result import FrictionDesign
from mm_gym.tuning.search import FREQUENCY_RATIOS
from mm_gym.tuning.steady_motion import driven, of_channel, steady_amplitude

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

    Array = NDArray[np.float64]
    Pair = tuple[float, float]

BAND = np.sort(np.concatenate([np.geomspace(0.2, 5.0, 300), np.geomspace(0.8, 1.25, 500)]))
"""Frequencies over w1 at which the first harmonic is looked at."""

COARSE = BAND[::4]
"""Those at which it is looked at where the search begins."""

FORCES = np.geomspace(0.02, 5.0, 24)
"""Friction forces over that on the carriage from which the search begins, for each stiffness."""

STIFFNESSES = 16
"""Stiffnesses of the springs from which it begins."""

HIGH = 0.8
"""Peaks of the first harmonic that are simulated, over the highest."""

NEAR = (0.05, 0.017, 0.006)
"""Parts of the frequency of a peak, either way, in which it is looked for: each in the last."""

POINTS = 5
"""Frequencies that are simulated in each."""

STEEP = 0.03
"""Relative change of the amplitude between points beyond which no parabola is put through them."""

SWEPT, SHOWN = 60, 0.25
"""Frequencies of a simulated curve, and the part of the highest peak down to which it goes."""

SIMPLEX, CLOSE = 0.05, 1e-3
"""Sizes of the first and last simplex of the search on the simulated motion, of logarithms."""


NONE = 1e-300
"""Stiffness [N/m] that stands for no springs where its logarithm is taken."""


class FrictionProblem:
    """What is tuned: the normal force [N] and, with springs, k2 [N/m].

    Attributes
    ----------
    scene
        The rig under a harmonic, without anything else.
    values
        Its coefficients.
    excitation, amplitude, channel
        See `mm_gym.tuning.friction_absorber`.
    """

    def __init__(self, scene: Scene, excitation: str, amplitude: float, channel: str) -> None:
        self.values = linear_values(scene)
        self.scene = driven(scene, excitation, amplitude)
        self.excitation, self.amplitude, self.channel = excitation, amplitude, channel
        interface = self.scene.interface
        assert isinstance(interface, DryFriction)  # noqa: S101 - checked by the caller
        self.interface = interface
        self.w1 = float(np.sqrt(self.values.k1 / self.values.m1))
        force = amplitude * (1.0 if excitation == "force" else self.values.m1)
        self.unit = force / interface.kinetic_coefficient  # [N] of normal force

    @property
    def any_springs(self) -> Pair:
        """Least and largest k2 that is searched where the springs do not bound it."""
        low, high = self.values.m2 * (np.array(FREQUENCY_RATIOS) * self.w1) ** 2
        return float(low), float(high)

    def first(self, limits: Pair | None) -> Pair:
        """Return the best normal force and k2 to the first harmonic.

        k2 is between limits, or stays where there are none.
        """
        stiffnesses = [self.values.k2] if limits is None else np.geomspace(*limits, STIFFNESSES)
        pairs = [np.log([self.unit * f, k2]) for f in FORCES for k2 in _positive(stiffnesses)]
        start = min(pairs, key=lambda pair: self._rough(pair, COARSE))
        return self._minimum(self._rough, start, limits, 0.2)

    def improved(self, start: Pair, limits: Pair | None) -> Pair:
        """Return the best normal force and k2 by the simulated motion, near a start."""
        return self._minimum(self._simulated, np.log(_positive(start)), limits, SIMPLEX)

    def band(self, normal: float, k2: float) -> Array:
        """Return the frequencies [rad/s] of a curve with all high peaks of a design."""
        sizes = self._first_harmonic(normal, k2, BAND * self.w1)
        high = self.w1 * BAND[sizes >= SHOWN * sizes.max()]
        return np.linspace(high[0], high[-1], SWEPT)

    def design(self, normal: float, k2: float, frequencies: Array) -> FrictionDesign:
        """Return what a design attains, simulated at some frequencies."""
        curve = self._steady(normal, k2, frequencies)
        frequency, peak = self._highest(normal, k2, [float(frequencies[np.argmax(curve)])])
        force = normal * self.interface.kinetic_coefficient
        return FrictionDesign(k2, normal, force, peak, frequency, curve)

    def _first_harmonic(self, normal: float, k2: float, frequencies: Array) -> Array:
        return np.abs(of_channel(self._states(normal, k2, frequencies), self.channel))

    def _states(self, normal: float, k2: float, w: Array) -> NDArray[np.complex128]:
        friction = friction_of(self.interface, normal)
        values = self.values._replace(k2=k2)
        return steady_state(values, friction, self.excitation, self.amplitude, w)

    def _steady(self, normal: float, k2: float, frequencies: Array) -> Array:
        scene = self.scene.replace(**{"interface.normal_force": normal})
        if scene.springs.kind == "linear":
            scene = scene.replace(**{"springs.stiffness": k2})
        elif scene.springs.kind != "none":
            stretch = max(1.0, float(stretch_for_stiffness(k2, scene.springs.stiffness)))
            scene = scene.replace(**{"springs.stretch": stretch})  # 6 k0, rounded, needs 1
        starts = self._states(normal, k2, frequencies).imag.T  # of a sine
        pairs = zip(frequencies, starts, strict=True)
        return np.array([steady_amplitude(scene, self.channel, w, start) for w, start in pairs])

    def _rough(self, unknowns: Array, band: Array = BAND) -> float:
        """Return the logarithm of the highest peak of the first harmonic."""
        normal, k2 = _pair(unknowns)
        return float(np.log(self._first_harmonic(normal, k2, band * self.w1).max()))

    def _simulated(self, unknowns: Array) -> float:
        """Return the logarithm of the highest peak, near those of the first harmonic."""
        normal, k2 = _pair(unknowns)
        return float(np.log(self._highest(normal, k2, ())[1]))

    def _highest(self, normal: float, k2: float, others: Sequence[float]) -> Pair:
        """Return frequency and height of the highest peak, near those of the first harmonic.

        Others are further frequencies to look near.
        """
        sizes = self._first_harmonic(normal, k2, BAND * self.w1)
        inner = sizes[1:-1]
        is_peak = (inner >= sizes[:-2]) & (inner >= sizes[2:]) & (inner >= HIGH * sizes.max())
        near = [*others, *(self.w1 * BAND[1:-1][is_peak])]
        return max((self._peak(normal, k2, w) for w in near), key=lambda peak: peak[1])

    def _peak(self, normal: float, k2: float, frequency: float) -> Pair:
        """Return frequency and height of the peak near a frequency."""
        peak = 0.0
        for part in NEAR:
            near = frequency * np.linspace(1.0 - part, 1.0 + part, POINTS)
            frequency, peak = _refined(near, self._steady(normal, k2, near))
        return frequency, peak

    def _minimum(
        self, size: Callable[[Array], float], start: Array, limits: Pair | None, simplex: float
    ) -> Pair:
        """Return the minimum near a start, by simplex."""
        free = len(start) if limits is not None else 1
        bounds = [tuple(np.log(self.unit * FORCES[[0, -1]])), np.log(limits or (1.0, 1.0))][:free]
        corners = start[:free] + simplex * np.vstack([np.zeros(free), np.eye(free)])
        low, high = np.array(bounds).T
        corners = np.where(corners > high, start[:free] - simplex, np.maximum(corners, low))

        def whole(unknowns: Array) -> Array:
            return np.append(unknowns, start[free:])

        def of_free(unknowns: Array) -> float:
            return size(whole(unknowns))

        found = minimize(
            of_free,
            corners[0],
            bounds=bounds,
            method="Nelder-Mead",
            options={"initial_simplex": corners, "xatol": CLOSE, "fatol": CLOSE},
        )
        return _pair(whole(found.x))


def _positive(values: object) -> Array:
    """Return values with `NONE` in place of 0, which has no logarithm."""
    return np.maximum(np.asarray(values, np.float64), NONE)


def _pair(unknowns: Array) -> Pair:
    """Return normal force and k2; that of no springs is 0."""
    normal, k2 = np.exp(unknowns)
    return float(normal), float(k2) if k2 > 2.0 * NONE else 0.0


def _refined(frequencies: Array, sizes: Array) -> Pair:
    """Return frequency and size of the highest peak, by the parabola through three points.

    Where the curve is steep, as where the sphere begins to slip, it is the highest point.
    """
    k = int(np.argmax(sizes))
    x, y = np.log(frequencies[max(k - 1, 0) : k + 2]), np.log(sizes[max(k - 1, 0) : k + 2])
    if len(x) < 3 or np.ptp(y) > STEEP:  # noqa: PLR2004 - points of a parabola
        return float(frequencies[k]), float(sizes[k])
    a, b, _ = np.polyfit(x - x[1], y, 2)
    shift = -0.5 * b / a
    return float(np.exp(x[1] + shift)), float(np.exp(y[1] + 0.5 * b * shift))
