"""Response and effort of motions: peaks, root mean squares, power and energies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Response:
    """Response of motions and effort of their control: an entry (lanes,) for each motion.

    A peak is the largest magnitude, max_t |q|. A root mean square is over time, (1/T integral of
    q^2 dt)^(1/2), like the normed responses of the benchmark. Symbols are those of docs/model.md,
    sections 1 and 5.

    Attributes
    ----------
    duration
        T [s].
    weight
        W = (m1 + m2) g [N].
    peak_displacement, rms_displacement
        Of the carriage, x1 [m], relative to the ground.
    peak_velocity
        Of the carriage, v1 [m/s], relative to the ground.
    peak_acceleration, rms_acceleration
        Of the carriage [m/s^2], absolute: including that of the ground, without impulses.
    peak_base_force, rms_base_force
        On the base, the base shear [N]: k1 (alpha + beta x1^2) x1 + d v1 - u, of the carriage's
        spring and damper, and the reaction to the control force; without -u if that acts between
        the masses.
    peak_stroke, rms_stroke
        Relative displacement of the sphere, x2 - x1 [m].
    peak_force, rms_force
        Control force u [N].
    peak_power
        Of the control force [W]: max_t |u v1|. For a force between the masses v1 - v2 replaces v1,
        here and in both energies.
    control_energy
        Energy that the control force supplies and absorbs [J], summed by magnitude:
        integral of |u v1| dt.
    control_work
        Supplied minus absorbed energy [J]: integral of u v1 dt.
    injected, withdrawn
        Energy that changes of the stretch bring in and take out [J], both positive: the jumps of
        (12) of docs/model.md by their sign. Only the injected energy must come from the actuator.
    """

    duration: Array
    weight: Array
    peak_displacement: Array
    rms_displacement: Array
    peak_velocity: Array
    peak_acceleration: Array
    rms_acceleration: Array
    peak_base_force: Array
    rms_base_force: Array
    peak_stroke: Array
    rms_stroke: Array
    peak_force: Array
    rms_force: Array
    peak_power: Array
    control_energy: Array
    control_work: Array
    injected: Array
    withdrawn: Array
