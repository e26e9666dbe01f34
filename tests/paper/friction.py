"""The paper's friction force, eq. 9, as it is printed."""

import numpy as np


def friction_force(law, slip_velocity):
    """Return the force [N] at slip velocities [m/s], with Heaviside steps, H(0) = 1.

    It therefore slips at exactly |w| = v_r, where the project sticks: section 2 of docs/model.md.
    """
    w = np.asarray(slip_velocity, np.float64)
    normal, vr = law.normal_force, law.reference_velocity
    mu1, mu2, chi = law.static_coefficient, law.kinetic_coefficient, law.slip_damping
    change = (
        2.0 * (mu2 * normal - chi * vr) * (w >= 0.0)
        - normal / vr * (mu1 * w + mu2 * vr)
        + chi * (w + vr)
    )
    return mu1 * normal / vr * w + change * (np.abs(w) >= vr)
