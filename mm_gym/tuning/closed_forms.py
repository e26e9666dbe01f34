"""Closed-form optima of tuned-mass dampers, on an undamped carriage or under a cubic spring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

from mm_gym.analysis.linear import linear_values
from mm_gym.analysis.springs import spring_stiffness
from mm_gym.errors import DesignError, check_name, positive_number, refuse
from mm_gym.lanes import layout
from mm_gym.plant.support_of import support_of
from mm_gym.scene.scene import Scene
from mm_gym.tuning.reach import require_fixed, stretch_for

Formula = Callable[[float], tuple[float, float, float]]


PEAK = "largest amplitude"
FIXED = "amplitude at the fixed points, a little below the largest"
VARIANCE = "variance under white noise of intensity 1"
ABSCISSA = "largest real part of the eigenvalues"


@dataclass(frozen=True)
class Absorber:
    """The optimum that a closed form gives for a mass ratio.

    Attributes
    ----------
    frequency_ratio
        f [-]; 0 without springs.
    damping_ratio
        zeta [-].
    value
        Value of the criterion [-], see `ClosedForm.value`. Amplitudes and variances are those of
        k1 x1 / F, sqrt(k1 m1) v1 / F and m1 a1 / F under a force F, and of w1^2 x1 / a_g and
        a1 / a_g under ground motion, with time in units of 1 / w1. Real parts of eigenvalues are
        divided by w1.
    """

    frequency_ratio: float
    damping_ratio: float
    value: float

    def stiffness(self, m2: float, w1: float) -> float:
        """Return k2 [N/m] for a sphere of mass m2 [kg] on a carriage of frequency w1 [rad/s].

        Raise `DesignError` unless both are greater than 0.
        """
        m2, w1 = _positive(m2, w1)
        return m2 * (self.frequency_ratio * w1) ** 2

    def damping(self, m2: float, w1: float) -> float:
        """Return c [N s/m], see `stiffness`."""
        m2, w1 = _positive(m2, w1)
        return 2.0 * self.damping_ratio * m2 * w1 * (self.frequency_ratio or 1.0)


def _positive(m2: float, w1: float) -> tuple[float, float]:
    return positive_number("m2", m2, DesignError), positive_number("w1", w1, DesignError)


class ClosedForm(NamedTuple):
    """A closed form, and the criterion that it minimises."""

    excitation: str  # "force" on the carriage or "ground"
    channel: str  # the minimised one
    criterion: str  # "h_infinity", "h2" or "stability"
    value: str  # meaning of `Absorber.value`
    largest: float  # mass ratios must be below this value
    source: str
    formula: Formula  # mu -> f, zeta, value


def closed_form(name: str, mass_ratio: float) -> Absorber:
    """Return the optimum of a closed form.

    Parameters
    ----------
    name
        One of `CLOSED_FORMS`.
    mass_ratio
        mu = m2 / m1 [-], greater than 0.

    Raises
    ------
    DesignError
        If no closed form has this name, or it has no optimum for this mass ratio.
    """
    check_name("closed form", name, CLOSED_FORMS, DesignError)
    form = CLOSED_FORMS[name]
    mu = positive_number("mass ratio", mass_ratio, DesignError)
    if not mu < form.largest:
        allowed = f"greater than 0, below {form.largest:g}"
        refuse(f"mass ratio of {name!r}", f"{mass_ratio!r}", allowed, DesignError)
    return Absorber(*form.formula(mu))


def _den_hartog(mu: float) -> tuple[float, float, float]:
    return 1.0 / (1.0 + mu), sqrt(3.0 * mu / (8.0 * (1.0 + mu))), sqrt(1.0 + 2.0 / mu)


def _nishihara_asami(mu: float) -> tuple[float, float, float]:
    q = sqrt(4.0 + 3.0 * mu)
    inner = 2.0 * (16.0 + 23.0 * mu + 9.0 * mu**2 + 2.0 * (2.0 + mu) * q)
    f = 2.0 / (1.0 + mu) * sqrt(inner / (3.0 * (64.0 + 80.0 * mu + 27.0 * mu**2)))
    # 8 + 9 mu - 4 q, without the difference of nearly equal numbers of light spheres
    damping = mu * (81.0 * mu + 96.0) / (8.0 + 9.0 * mu + 4.0 * q)
    zeta = 0.25 * sqrt(damping / (1.0 + mu))
    # The same for (8 + 9 mu)^2 (16 + 9 mu) - 128 q^3: their squares differ by
    # 27 mu (32 + 27 mu) (64 + 80 mu + 27 mu^2)^2.
    both = (8.0 + 9.0 * mu) ** 2 * (16.0 + 9.0 * mu) + 128.0 * q**3
    value = (64.0 + 80.0 * mu + 27.0 * mu**2) / sqrt(mu * both)
    return f, zeta, value


def _force_acceleration(mu: float) -> tuple[float, float, float]:
    zeta = sqrt(3.0 * mu / (8.0 * (1.0 + 0.5 * mu)))
    return 1.0 / sqrt(1.0 + mu), zeta, sqrt(2.0 / (mu * (1.0 + mu)))


def _ground_displacement(mu: float) -> tuple[float, float, float]:
    zeta = sqrt(3.0 * mu / (8.0 * (1.0 + mu) * (1.0 - 0.5 * mu)))
    return sqrt(1.0 - 0.5 * mu) / (1.0 + mu), zeta, (1.0 + mu) * sqrt(2.0 / mu)


def _krenk(mu: float) -> tuple[float, float, float]:
    return 1.0 / (1.0 + mu), sqrt(mu / (2.0 * (1.0 + mu))), sqrt(1.0 + 2.0 / mu)


def _h2_force_displacement(mu: float) -> tuple[float, float, float]:
    zeta = sqrt(mu * (1.0 + 0.75 * mu) / (4.0 * (1.0 + mu) * (1.0 + 0.5 * mu)))
    value = sqrt((1.0 + 0.75 * mu) / (mu * (1.0 + mu)))
    return sqrt(1.0 + 0.5 * mu) / (1.0 + mu), zeta, value


def _h2_force_velocity(mu: float) -> tuple[float, float, float]:
    return 1.0 / sqrt(1.0 + mu), 0.5 * sqrt(mu), 1.0 / sqrt(mu * (1.0 + mu))


def _h2_ground_displacement(mu: float) -> tuple[float, float, float]:
    zeta = sqrt(mu * (1.0 - 0.25 * mu) / (4.0 * (1.0 + mu) * (1.0 - 0.5 * mu)))
    return sqrt(1.0 - 0.5 * mu) / (1.0 + mu), zeta, (1.0 + mu) ** 1.5 * sqrt(1.0 / mu - 0.25)


def _maximum_stability(mu: float) -> tuple[float, float, float]:
    # (s^2 + zeta s + f)^2: its double pair is complex for mu < 4, and one real root slower beyond.
    zeta = sqrt(mu / (1.0 + mu))
    return 1.0 / (1.0 + mu), zeta, -0.5 * zeta


def _lanchester_h_infinity(mu: float) -> tuple[float, float, float]:
    return 0.0, 1.0 / sqrt(2.0 * (1.0 + mu) * (2.0 + mu)), (2.0 + mu) / mu


def _lanchester_h2(mu: float) -> tuple[float, float, float]:
    return 0.0, 0.5 / sqrt(1.0 + mu), sqrt(1.0 + mu) / mu


def _lanchester_stability(mu: float) -> tuple[float, float, float]:
    # The pair of s^3 + 2 zeta (1 + mu) s^2 + s + 2 zeta decays fastest with the real root at
    # -1 / sqrt(1 + mu), which decays faster than the pair for mu < 4.
    return 0.0, (2.0 + mu) / (4.0 * (1.0 + mu) ** 1.5), -mu / (4.0 * sqrt(1.0 + mu))


DISPLACEMENT, VELOCITY = "carriage_displacement", "carriage_velocity"
ACCELERATION = "carriage_acceleration"
H_INFINITY, H2, STABILITY = "h_infinity", "h2", "stability"
ANY = float("inf")

WARBURTON = (
    "Warburton, Optimum absorber parameters for various combinations of response and excitation "
    "parameters, Earthquake Eng. Struct. Dyn. 10 (1982)"
)
DEN_HARTOG = "Den Hartog, Mechanical Vibrations, 4th ed. (1956), section 3.3; damping: Brock (1946)"

CLOSED_FORMS: dict[str, ClosedForm] = {
    "den_hartog": ClosedForm(
        "force", DISPLACEMENT, H_INFINITY, FIXED, ANY, DEN_HARTOG, _den_hartog
    ),
    "nishihara_asami": ClosedForm(
        *("force", DISPLACEMENT, H_INFINITY, PEAK, ANY),
        "Nishihara and Asami, Closed-form solutions to the exact optimizations of dynamic "
        "vibration absorbers, J. Vib. Acoust. 124 (2002)",
        _nishihara_asami,
    ),
    "warburton_force_acceleration": ClosedForm(
        "force", ACCELERATION, H_INFINITY, FIXED, ANY, WARBURTON, _force_acceleration
    ),
    "warburton_ground_displacement": ClosedForm(
        "ground", DISPLACEMENT, H_INFINITY, FIXED, 2.0, WARBURTON, _ground_displacement
    ),
    "warburton_ground_acceleration": ClosedForm(
        "ground", ACCELERATION, H_INFINITY, FIXED, ANY, WARBURTON, _den_hartog
    ),
    "krenk": ClosedForm(
        *("force", DISPLACEMENT, H_INFINITY, FIXED, ANY),
        "Krenk, Frequency analysis of the tuned mass damper, J. Appl. Mech. 72 (2005): equal modal "
        "damping, a smaller stroke at a slightly higher peak",
        _krenk,
    ),
    "h2_force_displacement": ClosedForm(
        *("force", DISPLACEMENT, H2, VARIANCE, ANY), WARBURTON, _h2_force_displacement
    ),
    "h2_force_velocity": ClosedForm(
        *("force", VELOCITY, H2, VARIANCE, ANY),
        f"{WARBURTON}; Zilletti, Elliott and Rustighi, J. Sound Vib. 331 (2012)",
        _h2_force_velocity,
    ),
    "h2_ground_displacement": ClosedForm(
        "ground", DISPLACEMENT, H2, VARIANCE, 2.0, WARBURTON, _h2_ground_displacement
    ),
    "maximum_stability": ClosedForm(
        *("force", DISPLACEMENT, STABILITY, ABSCISSA, 4.0),
        "Yamaguchi, Damping of transient vibration by a dynamic absorber, Trans. JSME C 54 (1988)",
        _maximum_stability,
    ),
    "lanchester_h_infinity": ClosedForm(
        *("force", DISPLACEMENT, H_INFINITY, PEAK, ANY),
        "Den Hartog, Mechanical Vibrations, 4th ed. (1956), section 3.3: the untuned damper",
        _lanchester_h_infinity,
    ),
    "lanchester_h2": ClosedForm(
        "force", DISPLACEMENT, H2, VARIANCE, ANY, WARBURTON, _lanchester_h2
    ),
    "lanchester_stability": ClosedForm(
        *("force", DISPLACEMENT, STABILITY, ABSCISSA, 4.0),
        "the stationary decay of the pair of eigenvalues of (14) of docs/model.md without d",
        _lanchester_stability,
    ),
}
"""Name -> closed form."""


def duffing_absorber(scene: Scene) -> Scene:
    """Return a scene whose springs stay tuned while the carriage's cubic spring stiffens.

    A cubic term of 2 mu^2 / (1 + 4 mu) times that of the carriage keeps both peaks equal for
    moderate motions. Linear springs get it as their cubic coefficient. Other springs become springs
    of finite stretch: with free length l0 and stretch s their force is
    k2 xi + 8 k0 xi^3 / (s^5 l0^2) + ..., and l0 is chosen to give the cubic term.

    The interface becomes viscous; ``carriage.cubic_coefficient`` must be greater than 0. The
    design is for the middle of each range; the ranges stay.

    Raises
    ------
    OutOfReachError
        If no stretch of the springs gives the required stiffness.
    DesignError
        If the carriage's spring is not cubic, there are no springs, or a number of the interface or
        the springs is drawn.

    Notes
    -----
    k2 and c are Nishihara and Asami's. Habib, Detroux, Viguie and Kerschen, *Nonlinear
    generalization of Den Hartog's equal-peak method*, Mech. Syst. Signal Process. 52-53 (2015).
    """
    values, middle = linear_values(scene), support_of(scene).middle
    require_fixed(scene, ("interface.", "springs."))
    cubic = float(middle[layout.K1] * middle[layout.BETA])  # [N/m^3]
    if not (cubic > 0.0 and values.m1 > 0.0 and values.k1 > 0.0):
        msg = (
            "carriage.cubic_coefficient: allowed: greater than 0, on a carriage with mass and a "
            "linear spring; for any other, see tune"
        )
        raise DesignError(msg)
    mu, w1 = values.m2 / values.m1, sqrt(values.k1 / values.m1)
    optimum = closed_form("nishihara_asami", mu)
    k2 = optimum.stiffness(values.m2, w1)
    own = 2.0 * mu**2 / (1.0 + 4.0 * mu) * cubic
    damper = {"kind": "viscous", "damping": optimum.damping(values.m2, w1)}
    changes: dict[str, object] = {"interface": damper}
    if scene.springs.kind == "linear":
        springs = {"stiffness": k2, "cubic_coefficient": own / k2}
        return scene.replace(springs={"kind": "linear"} | springs, **changes)
    stretch = stretch_for(scene, k2)
    k0 = k2 / float(spring_stiffness(stretch, 1.0))
    changes["springs"] = {
        "kind": "finite_stretch",
        "stiffness": k0,
        "stretch": stretch,
        "rest_length": sqrt(8.0 * k0 / (stretch**5 * own)),
    }
    if scene.actuation.stretch is not None:
        changes["initial.stretch"] = stretch
    return scene.replace(**changes)
