"""Evaluation indices: a controlled motion relative to a reference without control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError, refuse, whole_number
from mm_gym.metrics.response import Response


@dataclass(frozen=True, eq=False)
class Indices:
    """Evaluation indices (lanes,) [-]; smaller is better. The subscript 0 is the reference.

    The numbers are those of Ohtori, Christenson, Spencer and Dyke (2004) for a building of one
    storey, whose device is the moving mass. J7 to J10 measure damage, which the model does not
    have. J15, the number of devices, is 1.

    Attributes
    ----------
    j1
        Peak displacement: max |x1| / max |x1|_0.
    j2
        Peak acceleration, absolute: max |a1| / max |a1|_0.
    j3
        Peak base force: max |F_b| / max |F_b|_0.
    j4, j5, j6
        The same for the root mean squares.
    j11
        Peak control force over the weight: max |u| / W.
    j12
        Peak stroke over the reference's peak displacement: max |x2 - x1| / max |x1|_0.
    j13
        Peak control power: max |u v1| / (max |v1|_0 W).
    j14
        Control energy: integral of |u v1| dt / (max |x1|_0 W).
    j16, j17
        Number of sensors, and of the controller's states, as given.
    stroke, rms_stroke
        Peak and root mean square of the stroke over those of the reference; infinite if the
        reference has no stroke.
    rms_force
        Root mean square of the control force over the weight: ||u|| / W.
    injected
        Energy that changes of the stretch bring in, over max |x1|_0 W as in j14.
    """

    j1: Array
    j2: Array
    j3: Array
    j4: Array
    j5: Array
    j6: Array
    j11: Array
    j12: Array
    j13: Array
    j14: Array
    j16: int
    j17: int
    stroke: Array
    rms_stroke: Array
    rms_force: Array
    injected: Array


def indices(
    response: Response, reference: Response, *, sensors: int = 0, controller_states: int = 0
) -> Indices:
    """Return the evaluation indices of motions relative to a reference.

    Parameters
    ----------
    response
        Response of the controlled motions.
    reference
        Response of the same episodes without control (`uncontrolled_response`) or with the best
        passive damper (`passive_response`), or one motion for all lanes.
    sensors
        Number of channels that the controller reads.
    controller_states
        Number of states of the controller in discrete time.

    Raises
    ------
    SimulationError
        If the numbers of motions differ, a motion of the reference does not move, or something else
        is given than responses and integers of at least 0.
    """
    for name, one in (("response", response), ("reference", reference)):
        if not isinstance(one, Response):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
            refuse(name, f"{one!r:.60}", "a Response, of mm_gym.metrics", SimulationError)
    lanes, others = len(response.duration), len(reference.duration)
    if others not in {1, lanes}:
        allowed = f"{lanes}, as in the response, or 1"
        refuse("reference", f"{others} motions", allowed, SimulationError)
    if not reference.peak_displacement.all():
        allowed = "motions with x1 not 0"
        refuse("reference", "a carriage that does not move", allowed, SimulationError)
    r, ref = response, reference
    scale = ref.peak_displacement * r.weight
    moves = ref.peak_stroke > 0.0
    return Indices(
        j1=r.peak_displacement / ref.peak_displacement,
        j2=r.peak_acceleration / ref.peak_acceleration,
        j3=r.peak_base_force / ref.peak_base_force,
        j4=r.rms_displacement / ref.rms_displacement,
        j5=r.rms_acceleration / ref.rms_acceleration,
        j6=r.rms_base_force / ref.rms_base_force,
        j11=r.peak_force / r.weight,
        j12=r.peak_stroke / ref.peak_displacement,
        j13=r.peak_power / (ref.peak_velocity * r.weight),
        j14=r.control_energy / scale,
        j16=whole_number("sensors", sensors, 0, error=SimulationError),
        j17=whole_number("controller_states", controller_states, 0, error=SimulationError),
        stroke=_over(r.peak_stroke, ref.peak_stroke, moves),
        rms_stroke=_over(r.rms_stroke, ref.rms_stroke, moves),
        rms_force=r.rms_force / r.weight,
        injected=r.injected / scale,
    )


def _over(values: Array, reference: Array, moves: NDArray[np.bool_]) -> Array:
    """Return the ratio, infinite where the reference does not move."""
    return np.divide(values, reference, out=np.full(values.shape, np.inf), where=moves)
