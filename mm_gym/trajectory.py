"""A trajectory: what a simulation returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mm_gym.files import write_csv
from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from os import PathLike

    import numpy as np
    from numpy.typing import NDArray

UNITS = {"force": "N", "stretch": "-"}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States at instants.

    Attributes
    ----------
    time
        (n,) [s].
    state
        (n, 4): x1, x2 [m], v1, v2 [m/s], ground frame.
    action
        (n, k): what the actuators applied from each instant on, in the order of `actuators`.
    applied
        (n, 2): force [N] and stretch [-], whether actuated or not.
    actuators
        Names of the action's columns.
    parameters
        (rows,): the lane's parameters as they were drawn.
    """

    time: NDArray[np.float64]
    state: NDArray[np.float64]
    action: NDArray[np.float64]
    applied: NDArray[np.float64]
    actuators: tuple[str, ...]
    parameters: NDArray[np.float64]

    @property
    def energy(self) -> NDArray[np.float64]:
        """Kinetic and elastic energy (n,) [J], with the stretch of each instant."""
        p, (x1, x2, v1, v2) = self.parameters, self.state.T
        k2 = 2.0 * p[at.K0] * (1.0 + 2.0 / self.applied[:, 1] ** 3) if p[at.K0] else 0.0
        carriage = p[at.K1] * (0.5 * p[at.ALPHA] * x1**2 + 0.25 * p[at.BETA] * x1**4)
        return 0.5 * (p[at.M1] * v1**2 + p[at.M2] * v2**2 + k2 * (x2 - x1) ** 2) + carriage

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write time, state and action as columns with units; all digits are kept."""
        header = ["time [s]", "x1 [m]", "x2 [m]", "v1 [m/s]", "v2 [m/s]"]
        header += [f"{name} [{UNITS[name]}]" for name in self.actuators]
        write_csv(path, header, [self.time, *self.state.T, *self.action.T])
