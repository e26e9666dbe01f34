"""Carriage and sphere, and the interface and springs between them."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from mm_gym.scene.excitation import NonNegative, Positive
from mm_gym.scene.part import Part, Ratio, Rule, below, never

GRAVITY = 9.81
"""Acceleration of gravity in the paper [m/s^2]; by default F_N is sphere.mass * GRAVITY."""


class Carriage(Part):
    """The mass whose vibration is to be reduced, on a spring and a damper."""

    mass: NonNegative = 0.1
    """m1 [kg]; 0 for a massless carriage, which needs a damper or a viscous interface"""
    stiffness: Positive = 400.0
    """k1 [N/m]"""
    damping: NonNegative = 1.0
    """d [N s/m]"""
    linear_coefficient: float = 1.0
    """alpha [-]: the spring force is k1 (alpha + beta x1^2) x1; negative with beta > 0, it has two
    wells at x1 = +-sqrt(-alpha / beta)"""
    cubic_coefficient: float = 0.0
    """beta [1/m^2]; negative with alpha > 0, the carriage escapes beyond a barrier at
    |x1| = sqrt(-alpha / beta)"""


class Sphere(Part):
    """The moving mass that rolls on the carriage."""

    mass: Positive = 0.04
    """m2 [kg]"""


class NoInterface(Part):
    """No interface: only springs, if any, act between sphere and carriage."""

    kind: Literal["none"] = "none"


class Viscous(Part):
    """Viscous interface: a force proportional to the slip velocity."""

    kind: Literal["viscous"] = "viscous"
    damping: NonNegative = 1.0
    """c [N s/m]"""


def _is_at_most_one(ratio: float) -> bool:
    return 0.0 < ratio <= 1.0


class DryFriction(Part):
    """Dry friction: creep below the reference velocity, slip above it (eq. 9 of the paper)."""

    kind: Literal["dry_friction"] = "dry_friction"
    static_coefficient: Positive
    """mu1 [-]"""
    kinetic_coefficient: Positive
    """mu2 [-], at most mu1"""
    reference_velocity: Positive
    """v_r [m/s]"""
    slip_damping: NonNegative = 0.0
    """chi [N s/m]"""
    normal_force: Positive | None = None
    """F_N [N]; by default sphere.mass * 9.81"""

    rules: ClassVar[tuple[Rule, ...]] = (
        below("kinetic_coefficient", "static_coefficient", or_equal=True),
    )
    ratios: ClassVar[dict[str, Ratio]] = {
        "kinetic_ratio": Ratio(
            "kinetic_coefficient",
            "static_coefficient",
            _is_at_most_one,
            "greater than 0 and at most 1",
        )
    }


class Stribeck(Part):
    """Smooth friction that falls with the slip velocity: slow creep, a damper far above v_s."""

    kind: Literal["stribeck"] = "stribeck"
    static_coefficient: Positive
    """mu1 [-]: friction coefficient of slow slip, which is still faster than v_r"""
    kinetic_coefficient: Positive
    """mu2 [-]: friction coefficient of fast slip; at most mu1"""
    reference_velocity: Positive
    """v_r [m/s]: slower slip is creep, with a damping of mu1 F_N / v_r"""
    stribeck_velocity: Positive
    """v_s [m/s], over which friction falls from mu1 to mu2"""
    slip_damping: NonNegative = 0.0
    """chi [N s/m]"""
    normal_force: Positive | None = None
    """F_N [N]; by default sphere.mass * 9.81"""

    rules: ClassVar[tuple[Rule, ...]] = DryFriction.rules
    ratios: ClassVar[dict[str, Ratio]] = DryFriction.ratios


class BoucWen(Part):
    """Hysteretic interface: a yielding spring with its own state and the stiffness k at rest."""

    kind: Literal["bouc_wen"] = "bouc_wen"
    stiffness: Positive
    """k [N/m]: before yielding"""
    yield_displacement: Annotated[float, Field(ge=1e-7)]
    """u_y [m]; with a smaller one or a larger exponent the integrator can lose z"""
    stiffness_ratio: Annotated[float, Field(ge=0, le=1)] = 0.0
    """a [-]: stiffness long after yielding over that before"""
    exponent: Annotated[float, Field(ge=1, le=50)] = 2.0
    """n [-]: sharpness of the yielding; larger is sharper"""
    shape: Annotated[float, Field(ge=0.5)] = 0.5
    """b [-]: 1/2 unloads as stiff as before yielding; less would be a source of energy"""
    damping: NonNegative = 0.0
    """c [N s/m]"""


class Magnetorheological(Part):
    """Magnetorheological damper, driven by a voltage: the modified Bouc-Wen model.

    The defaults are those of Spencer, Dyke, Sain and Carlson (1997) for a damper of 3 kN, with all
    forces divided by 1,000; lengths, times and volts are as published.
    """

    kind: Literal["magnetorheological"] = "magnetorheological"
    voltage: NonNegative = 0.0
    """u [V]; if it is actuated, the voltage at the start of an episode"""
    damping: NonNegative = 2.1
    """c0 [N s/m] without voltage: damping of fast flow"""
    damping_per_volt: NonNegative = 0.35
    """increase of c0 with u [N s/(m V)]"""
    series_damping: Positive = 28.3
    """c1 [N s/m] without voltage: of slow flow, in series with all but the accumulator"""
    series_damping_per_volt: NonNegative = 0.295
    """increase of c1 with u [N s/(m V)]"""
    hysteresis: NonNegative = 14.0
    """alpha [N/m] without voltage: force over z"""
    hysteresis_per_volt: NonNegative = 69.5
    """increase of alpha with u [N/(m V)]"""
    stiffness: NonNegative = 4.69
    """k0 [N/m]: in parallel with the hysteresis"""
    accumulator_stiffness: NonNegative = 0.5
    """k1 [N/m]"""
    accumulator_offset: float = 0.0
    """x0 [m]: where the accumulator is relaxed; the published 0.143 gives a constant force"""
    gain: Positive = 301.0
    """A [-]: z over the offset before yielding"""
    gamma: Positive = 3.63e6
    """gamma [1/m^2]: z is at most the root of A / (gamma + beta)"""
    beta: float = 3.63e6
    """beta [1/m^2], at most gamma in magnitude: more would be a source of energy"""

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("beta", "gamma"),
            lambda beta, gamma: abs(beta) > gamma,
            "beta: got {0}; allowed: at most gamma = {1} in magnitude",
        ),
    )


class NoSprings(Part):
    """No springs: only the interface acts between sphere and carriage."""

    kind: Literal["none"] = "none"


class LinearSprings(Part):
    """Plain springs, whose total force is k2 (1 + gamma xi^2) xi, with xi = x2 - x1."""

    kind: Literal["linear"] = "linear"
    stiffness: Positive
    """k2 [N/m]"""
    cubic_coefficient: NonNegative = 0.0
    """gamma [1/m^2]: the springs stiffen with xi; needs an interface without dry friction"""


class SmallOnLarge(Part):
    """Springs linearised about their pre-stretch: k2 = 2 k0 (1 + 2 / stretch^3) (eq. 15)."""

    kind: Literal["small_on_large"] = "small_on_large"
    stiffness: Positive = 35.0
    """k0 [N/m]"""
    stretch: Annotated[float, Field(ge=1)] = 1.5
    """lambda [-]; if it is actuated, the default of initial.stretch"""


class FiniteStretch(Part):
    """Two neo-Hookean springs: each pulls with k0 l0 (l - l^-2), l = stretch +- offset / l0."""

    kind: Literal["finite_stretch"] = "finite_stretch"
    stiffness: Positive = 35.0
    """k0 [N/m]"""
    stretch: Annotated[float, Field(ge=1)] = 1.5
    """lambda [-]; if it is actuated, the default of initial.stretch"""
    rest_length: Positive
    """l0 [m]"""


Interface = Annotated[
    NoInterface | Viscous | DryFriction | Stribeck | BoucWen | Magnetorheological,
    Field(discriminator="kind"),
]

Springs = Annotated[
    NoSprings | LinearSprings | SmallOnLarge | FiniteStretch, Field(discriminator="kind")
]
WITHOUT_STRETCH = ("none", "linear")  # kinds of springs that have no stretch
