"""Fixed-step methods for smooth plants, kept for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.methods.base import Method, Option, Settings, header
from mm_gym.methods.fixed_step import kernel
from mm_gym.methods.support import LINEAR, PARAMETRIC_LINEAR, SMOOTH_NONLINEAR
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from mm_gym.methods.support import Support


class FixedStep(Method):
    """A method with equal substeps in each sample interval."""

    kinds = (LINEAR, PARAMETRIC_LINEAR, SMOOTH_NONLINEAR)
    evaluations: ClassVar[int]  # of the forces in a substep
    power: ClassVar[int]  # order of the error
    falls_with: ClassVar[str]  # the error, in words
    stable: ClassVar[str]  # the product of rate and substep below which it falls

    def model(self, support: Support, settings: Settings) -> Array:
        """Return the number of substeps and the kind of springs."""
        model = header(support, 2)
        model[kernel.SUBSTEPS] = settings.substeps
        model[kernel.IS_FINITE] = support.high[layout.L0] > 0.0
        return model

    def cost(self, model: Array) -> str:
        """Return the number of evaluations of the forces."""
        return f"{self.evaluations * int(model[kernel.SUBSTEPS])} evaluations of the forces"

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - it is fixed
        """Return the order."""
        return f"{self.power}"

    def bound(self, settings: Settings) -> str:  # noqa: ARG002 - it has none
        """Return where it is stable."""
        return (
            f"none: the error falls with {self.falls_with} while rate * substep < {self.stable}, "
            "and grows without limit beyond"
        )


class RK4(FixedStep):
    """The classical Runge-Kutta method (Kutta, 1901)."""

    name = "rk4"
    title = "the classical Runge-Kutta method"
    how = "classical Runge-Kutta method with fixed substeps; kept for comparison"
    evaluations, power, falls_with, stable = 4, 4, "the fourth power of the substep", "2.8"
    entries = build(kernel.propagate_rk4)
    option = Option("substeps", tuple(2.0**k for k in range(12)))


class SemiImplicitEuler(FixedStep):
    """The semi-implicit Euler method: velocities first, then positions with the new ones."""

    name = "semi_implicit_euler"
    title = "the semi-implicit Euler method"
    how = "velocities first, then positions, with fixed substeps; kept for comparison"
    evaluations, power, falls_with, stable = 1, 1, "the substep", "2"
    entries = build(kernel.propagate_semi_implicit_euler)
    option = Option("substeps", tuple(4.0**k for k in range(8)))
