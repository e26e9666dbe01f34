"""The absorber for a cubic carriage spring."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from mm_gym.analysis.springs import spring_stiffness
from mm_gym.analysis.values import linear_values
from mm_gym.errors import DesignError
from mm_gym.tuning.closed_forms import closed_form
from mm_gym.tuning.reach import stretch_for

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene


def duffing_absorber(scene: Scene) -> Scene:
    """Return a scene whose springs stay tuned while the carriage's cubic spring stiffens.

    A cubic term of 2 mu^2 / (1 + 4 mu) times that of the carriage keeps both peaks equal for
    moderate motions. Linear springs get it as their cubic coefficient. Other springs become springs
    of finite stretch: with free length l0 and stretch s their force is
    k2 xi + 8 k0 xi^3 / (s^5 l0^2) + ..., and l0 is chosen to give the cubic term.

    Parameters
    ----------
    scene
        A scene with springs of any kind and ``carriage.cubic_coefficient`` greater than 0.

    Returns
    -------
    Scene
        The scene with these springs and a viscous interface.

    Raises
    ------
    OutOfReachError
        If no stretch of the springs gives the required stiffness.
    DesignError
        If the carriage's spring is not cubic, or there are no springs.

    Notes
    -----
    k2 and c are Nishihara and Asami's. Habib, Detroux, Viguie and Kerschen, *Nonlinear
    generalization of Den Hartog's equal-peak method*, Mech. Syst. Signal Process. 52-53 (2015).
    """
    values = linear_values(scene)
    cubic = scene.carriage.stiffness * scene.carriage.cubic_coefficient  # [N/m^3]
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
