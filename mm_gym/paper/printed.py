"""Dry friction as the paper prints it, equation 9, to be drawn and compared with this project's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mm_gym.scene.mechanics import DryFriction
    from mm_gym.scene.scene import Scene


def friction_of(system: Scene) -> DryFriction:
    """Return a scene's dry friction; raise `SceneError` if it has none."""
    if system.interface.kind != "dry_friction":
        msg = f"interface.kind: got {system.interface.kind!r}; allowed: 'dry_friction'"
        raise SceneError(msg)
    return system.interface


def normal_force(law: DryFriction) -> float:
    """Return F_N [N], which the paper always states; raise `SceneError` if the law does not."""
    if law.normal_force is None:
        msg = "interface.normal_force: the paper states it; set it"
        raise SceneError(msg)
    return law.normal_force


def stick_slope(law: DryFriction) -> float:
    """Return mu1 F_N / v_r [N s/m], the damping of friction in stick."""
    return law.static_coefficient * normal_force(law) / law.reference_velocity


def friction_force(law: DryFriction, slip_velocity: ArrayLike) -> NDArray[np.float64]:
    """Return the force [N] at slip velocities [m/s], with the paper's Heaviside steps, H(0) = 1.

    It therefore slips at exactly |w| = v_r, where this project sticks: section 2 of docs/model.md.
    """
    w = np.asarray(slip_velocity, np.float64)
    normal, vr = normal_force(law), law.reference_velocity
    mu1, mu2, chi = law.static_coefficient, law.kinetic_coefficient, law.slip_damping
    change = (
        2.0 * (mu2 * normal - chi * vr) * (w >= 0.0)
        - normal / vr * (mu1 * w + mu2 * vr)
        + chi * (w + vr)
    )
    return mu1 * normal / vr * w + change * (np.abs(w) >= vr)
