"""The absorber with dry friction in place of a damper."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# SciPy ships no types

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isfinite, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from mm_gym.analysis.linear import Linear, linear_values, receptance
from mm_gym.analysis.springs import spring_stiffness
from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import DesignError, SimulationError, check_name, positive_number, refuse
from mm_gym.lanes.layout import NO_ROW
from mm_gym.law.dry_friction import kinetic_force, slip_intercept, stick_slope
from mm_gym.plant.task import middle
from mm_gym.scene.mechanics import GRAVITY, DryFriction
from mm_gym.scene.scene import Scene
from mm_gym.simulation.simulate import simulate
from mm_gym.step.channels import CHANNELS
from mm_gym.tuning.optimum import excitation_of, require_resonance
from mm_gym.tuning.reach import obstacle, reach_of, require_fixed, springs_with, tuned_field
from mm_gym.tuning.result import FrictionDesign, FrictionTuning
from mm_gym.tuning.transfer import EXCITATIONS, FREQUENCY_RATIOS

Complex = NDArray[np.complex128]
Pair = tuple[float, float]


SMALLEST, LARGEST = 1e-9, 1e9
"""Amplitudes of the slip velocity between which it is sought, over v_r and over that of a rigid
support."""

HALVINGS = 44  # of the logarithm of that range: to 1e-11

HEAVIEST = 0.5 * (sqrt(5.0) - 1.0)
"""Mass ratio up to which the fixed point is the highest: beyond, the peak at which a sphere without
springs begins to slip, 1 + 2 (1 + mu) / (mu sqrt(2 + mu)), is above (2 + mu) / mu."""


class Friction(NamedTuple):
    """Dry friction (4) of docs/model.md: slope in stick [N s/m], kinetic force [N], v_r, chi."""

    stick: float
    kinetic: float
    reference: float
    slip: float


def friction_of(law: DryFriction, normal: float) -> Friction:
    """Return the friction under a normal force [N]."""
    vr = law.reference_velocity
    stick = plain(stick_slope)(law.static_coefficient, normal, vr)
    kinetic = plain(kinetic_force)(law.kinetic_coefficient, normal)
    return Friction(float(stick), float(kinetic), vr, law.slip_damping)


def lanchester_friction(mass_ratio: float) -> float:
    """Return the best friction force of a sphere without springs over the force on the carriage.

    The result holds for the first harmonic, on a carriage without damping, with negligible creep
    and static friction. The curves of all dampings pass through the fixed point of the viscous
    damper. The least peak is therefore the same, (2 + mu) / mu. Friction whose equivalent damping
    there is optimal attains it, up to a mass ratio of (sqrt(5) - 1) / 2: with a heavier sphere the
    amplitude at which it begins to slip is larger.

    Raises
    ------
    DesignError
        If the mass ratio is not greater than 0, or greater than (sqrt(5) - 1) / 2 = 0.618.
    """
    mu = positive_number("mass_ratio", mass_ratio, DesignError)
    if mu > HEAVIEST:
        allowed = f"at most {HEAVIEST:.6f}; use friction_absorber for a heavier sphere"
        refuse("mass_ratio", f"{mass_ratio!r}", allowed, DesignError)
    return 0.5 * pi / sqrt(2.0 + mu)


def equivalent_damping(friction: Friction, speed: Array) -> Array:
    """Return the damping [N s/m] that takes the energy that friction does, of slip amplitudes."""
    angle = np.arcsin(np.minimum(friction.reference / speed, 1.0))  # at which stick ends
    stuck = 0.5 * angle - 0.25 * np.sin(2.0 * angle)
    intercept = plain(slip_intercept)(friction.kinetic, friction.slip, friction.reference)
    slipping = intercept * np.cos(angle) / speed + friction.slip * (0.25 * pi - stuck)
    return 4.0 / pi * (friction.stick * stuck + slipping)


def steady_state(
    values: Linear, friction: Friction, excitation: str, amplitude: float, frequencies: Array
) -> Complex:
    """Return the complex amplitudes (4, n) of x1, x2, v1 and v2 under amplitude * exp(i w t).

    The harmonic is a force [N], or the acceleration of the ground [m/s^2], at frequencies (n,)
    [rad/s]. The interface's own damping is replaced.
    """
    w = frequencies
    force = amplitude * (1.0 if excitation == "force" else values.m1)
    low = np.full(len(w), np.log(SMALLEST * friction.reference))
    high = np.log(LARGEST * (force * w / values.k1 + friction.reference))
    for _ in range(HALVINGS):
        half_way = 0.5 * (low + high)
        c = equivalent_damping(friction, np.exp(half_way))
        x1, x2 = receptance(values._replace(c=c), excitation, w)
        grows = np.log(amplitude * w * np.abs(x2 - x1)) > half_way
        low, high = np.where(grows, half_way, low), np.where(grows, high, half_way)
    c = equivalent_damping(friction, np.exp(low))
    both = amplitude * np.array(receptance(values._replace(c=c), excitation, w))
    return np.concatenate([both, 1j * w * both])


SAMPLES, FINER = (24, 96, 384), 8
"""Control steps in a period, more if they must be, and points between two at which the largest
value is looked for."""

PERIODS = 200  # periods after which a motion is taken to be steady

STATES = ("carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity")


def motion_channels() -> tuple[str, ...]:
    """Return the channels that are states or differences of two."""
    motion = (NO_ROW, *range(len(STATES)))
    return tuple(
        name
        for name, channel in CHANNELS.items()
        if channel.row < len(STATES) and channel.subtracted in motion
    )


def of_channel(states: NDArray[np.generic], channel: str) -> NDArray[np.generic]:
    """Return a channel (...) of states (4, ...)."""
    row, subtracted = CHANNELS[channel].row, CHANNELS[channel].subtracted
    return states[row] if subtracted == NO_ROW else states[row] - states[subtracted]


def driven(scene: Scene, excitation: str, amplitude: float) -> Scene:
    """Return the scene with the middle of each range and without control, under a harmonic."""
    harmonic = {
        "kind": "harmonic", "target": excitation, "amplitude": amplitude, "frequency": 1.0,
    }  # fmt: skip
    others = ("randomization", "initial", "sensors", "actuation", "objective")
    changes: dict[str, object] = {name: {} for name in others}
    for name in scene.randomization:
        field, _ = scene.drawn_ratios.get(name, (name, ""))
        if not field.startswith(("excitation.", *others)):
            changes[field] = middle(scene, field, np.nan)
    return scene.replace(excitation=[harmonic], **changes)


def steady_amplitude(scene: Scene, channel: str, frequency: float, start: Array) -> float:
    """Return the largest value of a channel's steady motion about its mean, simulated.

    The scene is from `driven`, the frequency [rad/s] that of its harmonic. The motion begins at a
    start (4,): x1, x2, v1, v2, close to the steady one.
    """
    x1, x2, v1, v2 = (float(value) for value in start)
    initial = dict(zip(STATES, (x1, x2 - x1, v1, v2), strict=True))
    scene = scene.replace(initial=initial, **{"excitation.0.frequency": frequency})
    values = of_channel(_last_period(scene, 2.0 * np.pi / frequency).T, channel)
    waves = np.fft.rfft(values)
    waves[0] = 0.0
    return float(FINER * np.abs(np.fft.irfft(waves, FINER * len(values))).max())


def _last_period(scene: Scene, period: float) -> Array:
    """Return the states (n, 4) in the last of `PERIODS` periods [s]."""
    for count in SAMPLES[:-1]:
        with suppress(SimulationError):  # stick and slip alternate too often in a control step
            return _states(scene, period, count)
    return _states(scene, period, SAMPLES[-1])


def _states(scene: Scene, period: float, count: int) -> Array:
    control = {"time_step": period / count, "steps": count * PERIODS}
    return simulate(scene.replace(control=control)).state[-count:]


BAND = np.sort(np.concatenate([np.geomspace(0.2, 5.0, 300), np.geomspace(0.8, 1.25, 500)]))
"""Frequencies over w1 at which the first harmonic is looked at."""

BELOW, HEAVY = 200, 0.7
"""Number of frequencies below the band where a sphere is heavy, and the least of them over the one
at which a sphere without springs begins to slip, w1 / sqrt(1 + 2 mu) with the least friction."""

COARSER = 4  # step through the band where the search begins

FORCES = np.geomspace(0.02, 5.0, 24)
"""Friction forces over that on the carriage from which the search begins, for each stiffness."""

STIFFNESSES = 16  # stiffnesses of the springs from which it begins
HIGH = 0.8  # peaks of the first harmonic that are simulated, over the highest

NEAR = (0.05, 0.017, 0.006)
"""Parts of the frequency of a peak, either way, in which it is looked for: each in the last."""

POINTS = 5  # frequencies that are simulated in each

STEEP = 0.03
"""Relative change of the amplitude between points beyond which no parabola is put through them."""

SWEPT, SHOWN = 60, 0.25
"""Frequencies of a simulated curve, and the part of the highest peak down to which it goes."""

SIMPLEX, CLOSE = 0.05, 1e-3
"""Sizes of the first and last simplex of the search on the simulated motion, of logarithms."""


def band_of(mass_ratio: float) -> Array:
    """Return the frequencies over w1 at which the first harmonic of a rig is looked at."""
    least = HEAVY / sqrt(1.0 + 2.0 * mass_ratio)
    below = np.geomspace(least, BAND[0], BELOW, endpoint=False)
    return np.concatenate([below, BAND]) if least < BAND[0] else BAND


NONE = 1e-300  # stiffness [N/m] that stands for no springs where its logarithm is taken


class FrictionProblem:
    """What is tuned: the normal force [N] and, with springs, k2 [N/m]; see `friction_absorber`."""

    def __init__(self, scene: Scene, excitation: str, amplitude: float, channel: str) -> None:
        self.values = linear_values(scene)
        self.scene = driven(scene, excitation, amplitude)
        self.excitation, self.amplitude, self.channel = excitation, amplitude, channel
        interface = self.scene.interface
        assert isinstance(interface, DryFriction)  # noqa: S101 - checked by the caller
        self.interface = interface
        self.w1 = float(np.sqrt(self.values.k1 / self.values.m1))
        ratio = self.values.m2 / self.values.m1
        self.looked_at = self.w1 * band_of(ratio)  # [rad/s]
        # Where friction hardly bounds it, the first harmonic does not tell how high it is at w1.
        self.always = [self.w1] if ratio > HEAVIEST else []
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
        start = min(pairs, key=lambda pair: self._rough(pair, COARSER))
        return self._minimum(self._rough, start, limits, 0.2)

    def improved(self, start: Pair, limits: Pair | None) -> Pair:
        """Return the best normal force and k2 by the simulated motion, near a start."""
        return self._minimum(self._simulated, np.log(_positive(start)), limits, SIMPLEX)

    def band(self, normal: float, k2: float) -> Array:
        """Return the frequencies [rad/s] of a curve with all high peaks of a design."""
        sizes = self._first_harmonic(normal, k2, self.looked_at)
        high = self.looked_at[sizes >= SHOWN * sizes.max()]
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
        changes, _ = springs_with(self.scene, k2)
        scene = self.scene.replace(**{"interface.normal_force": normal}, **changes)
        starts = self._states(normal, k2, frequencies).imag.T  # of a sine
        pairs = zip(frequencies, starts, strict=True)
        return np.array([steady_amplitude(scene, self.channel, w, start) for w, start in pairs])

    def _rough(self, unknowns: Array, step: int = 1) -> float:
        """Return the logarithm of the highest peak of the first harmonic."""
        normal, k2 = _pair(unknowns)
        return float(np.log(self._first_harmonic(normal, k2, self.looked_at[::step]).max()))

    def _simulated(self, unknowns: Array) -> float:
        """Return the logarithm of the highest peak, near those of the first harmonic."""
        normal, k2 = _pair(unknowns)
        return float(np.log(self._highest(normal, k2, ())[1]))

    def _highest(self, normal: float, k2: float, others: Sequence[float]) -> Pair:
        """Return frequency and height of the highest peak, near the first harmonic's and others."""
        sizes = self._first_harmonic(normal, k2, self.looked_at)
        inner = sizes[1:-1]
        is_peak = (inner >= sizes[:-2]) & (inner >= sizes[2:]) & (inner >= HIGH * sizes.max())
        near = [*others, *self.always, *self.looked_at[1:-1][is_peak]]
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
    """Return the highest peak by the parabola through three points, or where it is steep by one."""
    k = int(np.argmax(sizes))
    x, y = np.log(frequencies[max(k - 1, 0) : k + 2]), np.log(sizes[max(k - 1, 0) : k + 2])
    if len(x) < 3 or np.ptp(y) > STEEP:  # noqa: PLR2004 - points of a parabola
        return float(frequencies[k]), float(sizes[k])
    a, b, _ = np.polyfit(x - x[1], y, 2)
    shift = -0.5 * b / a
    return float(np.exp(x[1] + shift)), float(np.exp(y[1] + 0.5 * b * shift))


def friction_absorber(
    scene: Scene,
    *,
    amplitude: float | None = None,
    excitation: str | None = None,
    channel: str = "carriage_displacement",
) -> FrictionTuning:
    """Find the best normal force of dry friction, and the best stretch or stiffness of the springs.

    The function minimises the largest amplitude of the steady motion over all frequencies of a
    harmonic. The motion is not proportional to the harmonic, so the optimum belongs to one
    amplitude. Without creep, damping in slip and cubic springs the best friction force is
    proportional to this amplitude. The search begins with the first harmonic and ends with the
    simulated motion.

    Parameters
    ----------
    scene
        A scene whose interface is dry friction: its coefficients, reference velocity and damping in
        slip are kept. Its actuators and noise are left out of the search, and the
        design is for the middle of each range.
    amplitude
        Amplitude of the harmonic [N, or m/s^2]; by default that of the scene's own harmonic.
    excitation
        "force" on the carriage or "ground"; by default as for `mm_gym.tuning.tune`.
    channel
        The minimised quantity: a displacement, a relative displacement or a velocity.

    Returns
    -------
    FrictionTuning
        The scene's own design and the best one that its springs reach, with their simulated curves.

    Raises
    ------
    DesignError
        If the interface is not dry friction, a name is unknown, the amplitude is missing or not
        greater than 0, the carriage has no mass or no stiffness, or a tuned parameter is drawn.

    Notes
    -----
    Ricciardelli and Vickery, *Tuned vibration absorbers with dry friction damping*, Earthquake Eng.
    Struct. Dyn. 28 (1999).
    """
    problem = _problem(scene, amplitude, excitation_of(scene, excitation), channel)
    own = problem.interface.normal_force
    own = own or middle(scene, "sphere.mass", scene.sphere.mass) * GRAVITY
    reach, reason = reach_of(scene), None
    start = problem.first(None if reach is None else problem.any_springs)
    if reach is not None:
        reason = obstacle(reach, start[1])
        # Springs without a limit approach the least stiffness, and never have it.
        least = max(reach.low, float(spring_stiffness(reach.longest, reach.k0)))
        limits = (least, reach.high) if isfinite(reach.high) else problem.any_springs
        best = problem.improved(start if reason is None else problem.first(limits), limits)
    else:
        best = problem.improved(start, None)
    frequencies = problem.band(*best)
    changes, stretch = springs_with(scene, best[1])
    return FrictionTuning(
        scene=scene,
        tuned=scene.replace(**{"interface.normal_force": best[0]}, **changes),
        excitation=problem.excitation,
        channel=channel,
        amplitude=problem.amplitude,
        frequencies=frequencies,
        before=problem.design(own, problem.values.k2, frequencies),
        after=problem.design(*best, frequencies),
        stretch=stretch,
        out_of_reach=reason,
    )


def _problem(
    scene: Scene, amplitude: float | None, excitation: str, channel: str
) -> FrictionProblem:
    """Return the problem; raise `DesignError` for what is none."""
    check_name("interface.kind", scene.interface.kind, ["dry_friction"], DesignError)
    check_name("excitation", excitation, EXCITATIONS, DesignError)
    check_name("channel", channel, motion_channels(), DesignError)
    require_fixed(scene, ("interface.normal_force", tuned_field(scene)))
    require_resonance(linear_values(scene))
    if amplitude is None:
        sizes = [
            abs(middle(scene, f"excitation.{k}.amplitude", part.amplitude))
            for k, part in enumerate(scene.excitation)
            if part.kind == "harmonic" and part.target == excitation
        ]
        if not sizes:
            msg = (
                f"amplitude: missing; no harmonic moves the {excitation} of the scene, and the "
                "best friction depends on its amplitude [N, or m/s^2 of the ground]"
            )
            raise DesignError(msg)
        amplitude = max(sizes)
    amplitude = positive_number("amplitude", amplitude, DesignError)
    return FrictionProblem(scene, excitation, amplitude, channel)
