"""The paper's systems as scenes."""

from __future__ import annotations

from mm_gym.errors import check_name
from mm_gym.scene.mechanics import (
    Carriage,
    DryFriction,
    NoInterface,
    NoSprings,
    SmallOnLarge,
    Sphere,
    Viscous,
)
from mm_gym.scene.scene import Control, Initial, Scene

CHI = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Slip dampings of figure 10 [N s/m]; a choice, because the text does not list them."""

RATIOS = (0.2, 0.5, 0.8, 0.9, 1.0)
"""Ratios mu2 / mu1 of figure 10; a choice, because the text does not list them."""

STATIC = 0.51  # mu1 of figure 10 [-]
REFERENCE_VELOCITY = 0.2  # v_r of figures 8 and 9 [m/s]
NORMAL_FORCE = 0.3924  # F_N of figures 8 to 10 [N]

FIGURE_2 = {
    "fig2a": (False, 1.0, 1.0),
    "fig2b": (False, 1.0, 10.0),
    "fig2c": (False, 1.0, 0.0),
    "fig2d": (True, 1.0, 1.0),
    "fig2e": (False, 0.0, 1.0),
    "fig2f": (True, 0.0, 10.0),
}
"""Whether the carriage's mass vanishes, c and d [N s/m], of each panel."""

VANISHING = 1e-80  # m1 [kg] that stands for none in figures 2 D and F

CAPTION = tuple(f"{name}_caption" for name in FIGURE_2)
"""Figure 2's systems with the masses of its caption."""

ASSUMED = ("fig2f", "fig2f_caption")  # systems whose d the paper leaves open

RELEASED = Initial(carriage_displacement=0.01, sphere_offset=0.02)
"""x1 = 0.01 m, x2 = 0.03 m, at rest."""

CENTRED = Initial(carriage_displacement=0.01, sphere_offset=0.0)
"""x1 = x2 = 0.01 m, at rest: equation 19."""

SHORT = Control(time_step=0.001, steps=1000)
LONG = Control(time_step=0.005, steps=2000)


def _interface(damping: float) -> Viscous | NoInterface:
    return Viscous(damping=damping) if damping else NoInterface()


def _linear(mass: float, sphere: float, damping: float, carriage_damping: float) -> Scene:
    return Scene(
        carriage=Carriage(mass=mass, stiffness=400.0, damping=carriage_damping),
        sphere=Sphere(mass=sphere),
        interface=_interface(damping),
        initial=RELEASED,
        control=SHORT,
    )


def _experiment(damping: float, x1: float, offset: float) -> Scene:
    return Scene(
        carriage=Carriage(mass=0.478, stiffness=10.0, damping=0.2),
        sphere=Sphere(mass=0.152),
        interface=_interface(damping),
        initial=Initial(carriage_displacement=x1, sphere_offset=offset),
        control=LONG,
    )


def _common(
    interface: Viscous | NoInterface | DryFriction,
    initial: Initial = RELEASED,
    springs: NoSprings | SmallOnLarge | None = None,
    cubic: float = 0.0,
) -> Scene:
    """Return a system with the masses, stiffness and damping of figures 6 to 12."""
    return Scene(
        carriage=Carriage(mass=0.10, stiffness=400.0, damping=1.0, cubic_coefficient=cubic),
        sphere=Sphere(mass=0.04),
        interface=interface,
        springs=springs or NoSprings(),
        initial=initial,
        control=SHORT,
    )


def _friction(static: float, slip_damping: float) -> DryFriction:
    return DryFriction(
        static_coefficient=static,
        kinetic_coefficient=0.5 * static,
        reference_velocity=REFERENCE_VELOCITY,
        slip_damping=slip_damping,
        normal_force=NORMAL_FORCE,
    )


def _figure_2(suffix: str, carriage: float, sphere: float) -> dict[str, Scene]:
    """Return the systems of figure 2 with one reading of the masses [kg]."""
    return {
        name + suffix: _linear(VANISHING if vanishes else carriage, sphere, c, d)
        for name, (vanishes, c, d) in FIGURE_2.items()
    }


SCENES = {
    **_figure_2("", 0.04, 0.10),
    **_figure_2("_caption", 0.10, 0.04),
    "fig5a": _experiment(0.0, -0.025, 0.021),
    "fig5b": _experiment(0.06, 0.03, 0.0),
    "fig6a": _common(NoInterface(), cubic=2e6),
    "fig6d": _common(Viscous(damping=1.0), cubic=2e6),
    "fig8": _common(_friction(0.509, 0.1)),
    "fig9": _common(
        _friction(0.5097, 0.1), Initial(carriage_displacement=0.005, sphere_offset=0.02)
    ),
    "fig10": _common(_friction(STATIC, 0.1)),
    "fig12a": _common(NoInterface(), CENTRED, SmallOnLarge(stiffness=50.0, stretch=1.5)),
    "fig12d": _common(Viscous(damping=1.0), CENTRED, SmallOnLarge(stiffness=50.0, stretch=1.5)),
}

NAMES = tuple(SCENES)  # every system of the paper


def scene(name: str) -> Scene:
    """Return a system of the paper, such as "fig2a"; raise `SceneError` for an unknown name."""
    check_name("system of the paper", name, NAMES)
    return SCENES[name]


def friction_of(system: Scene) -> DryFriction:
    """Return the dry friction of a system that has it."""
    law = system.interface
    assert isinstance(law, DryFriction)  # noqa: S101 - for the type checker
    return law


def stick_slope(law: DryFriction) -> float:
    """Return mu1 F_N / v_r [N s/m], the damping of the paper's friction in stick."""
    return law.static_coefficient * NORMAL_FORCE / law.reference_velocity
