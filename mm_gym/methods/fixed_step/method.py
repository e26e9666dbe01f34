"""Two fixed-step methods on the smooth plants, kept to show what the others save."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mm_gym.kernels import layout as at
from mm_gym.kernels.control_step import build
from mm_gym.methods.base import Method, header
from mm_gym.methods.fixed_step import kernel as fixed_step

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support


def _model(support: Support, *, substeps: int) -> NDArray[np.float64]:
    model = header(support, 2)
    model[fixed_step.SUBSTEPS] = substeps
    model[fixed_step.IS_FINITE] = support.high[at.L0] > 0.0
    return model


def rk4_method(substeps: int, plant: str) -> Method:
    """Return the classical Runge-Kutta method with a number of steps in each control step."""
    return Method(
        name="rk4",
        plant=plant,
        how="classical Runge-Kutta method with a fixed step; kept for comparison",
        order="4",
        bound=(
            "none: the error falls with the fourth power of the step while rate * step < 2.8, "
            "and grows without limit beyond"
        ),
        cost=lambda _: f"{4 * substeps} evaluations of the forces",
        model=partial(_model, substeps=substeps),
        entries=RK4,
        options=("substeps",),
    )


def semi_implicit_euler_method(substeps: int, plant: str) -> Method:
    """Return the semi-implicit Euler method with a number of steps in each control step."""
    return Method(
        name="semi_implicit_euler",
        plant=plant,
        how="velocities first, then positions, with a fixed step; kept for comparison",
        order="1",
        bound=(
            "none: the error falls with the step while rate * step < 2, "
            "and grows without limit beyond"
        ),
        cost=lambda _: f"{substeps} evaluations of the forces",
        model=partial(_model, substeps=substeps),
        entries=SEMI_IMPLICIT_EULER,
        options=("substeps",),
    )


RK4 = build(fixed_step.propagate_rk4)
SEMI_IMPLICIT_EULER = build(fixed_step.propagate_semi_implicit_euler)
