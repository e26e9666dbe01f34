"""Which row of a lane holds which field of a scene, and the scene's support.

The support is what values the fields can take.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.kernels import layout as at
from mm_gym.scene import GRAVITY, bounds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene import NumberOrRange, Scene

ROWS: dict[str, int] = {
    "initial.carriage_displacement": at.X1,
    "initial.sphere_offset": at.X2,
    "initial.carriage_velocity": at.V1,
    "initial.sphere_velocity": at.V2,
    "initial.stretch": at.STRETCH,
    "carriage.mass": at.M1,
    "carriage.stiffness": at.K1,
    "carriage.damping": at.D,
    "carriage.linear_coefficient": at.ALPHA,
    "carriage.cubic_coefficient": at.BETA,
    "sphere.mass": at.M2,
    "interface.damping": at.C,
    "interface.static_coefficient": at.MU1,
    "interface.kinetic_coefficient": at.MU2,
    "interface.reference_velocity": at.VR,
    "interface.slip_damping": at.CHI,
    "interface.normal_force": at.FN,
    "springs.stiffness": at.K0,
    "springs.stretch": at.STRETCH,
    "springs.rest_length": at.L0,
}
"""Row of each field of a lane; those of the excitation follow from their index."""

TONE_FIELDS = {"amplitude": at.AMPLITUDE, "frequency": at.FREQUENCY, "phase": at.PHASE}


@dataclass(frozen=True)
class Support:
    """All values that the rows of a lane can take.

    Attributes
    ----------
    start_low, start_high
        (rows,) float64: bounds of each row when an episode begins.
    low, high
        (rows,) float64: bounds of each parameter at any time; an actuated stretch moves.
    names
        Dotted name of each drawn field -> its row.
    ground
        For each harmonic, whether it shakes the ground.
    time_step
        Control step [s].
    """

    start_low: NDArray[np.float64]
    start_high: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    names: dict[str, int]
    ground: tuple[bool, ...]
    time_step: float

    def fixed(self, row: int) -> bool:
        """Tell whether a row has one value only."""
        return bool(self.low[row] == self.high[row])

    def row_of(self, name: str) -> int:
        """Return the row of a dotted name, or raise `SceneError` with the nearest name."""
        try:
            return self.names[name]
        except KeyError:
            msg = (
                f"{name}: not a field of this scene that can be set{suggest(str(name), self.names)}"
            )
            raise SceneError(msg) from None


def support_of(scene: Scene) -> Support:
    """Collect the values that randomisation, initial ranges and actuation can reach."""
    values = _fields(scene)
    rows = {name: _row(name) for name in values}
    size = at.TONES + at.TONE_ROWS * len(scene.excitation)
    low, high = np.zeros(size), np.zeros(size)
    low[at.STRETCH] = high[at.STRETCH] = (
        1.0  # without springs: any stretch that the spring law allows
    )
    for name, value in values.items():
        low[rows[name]], high[rows[name]] = bounds(value)
    if scene.springs.kind == "none":
        low[at.STRETCH] = high[at.STRETCH] = (
            1.0  # springs of stiffness 0, unstretched: kernels divide by the stretch
        )
    start_low, start_high = low.copy(), high.copy()
    if scene.actuation.stretch is not None:
        low[at.STRETCH], high[at.STRETCH] = (
            scene.actuation.stretch.minimum,
            scene.actuation.stretch.maximum,
        )
    return Support(
        start_low=start_low,
        start_high=start_high,
        low=low,
        high=high,
        names=rows,
        ground=tuple(tone.target == "ground" for tone in scene.excitation),
        time_step=scene.control.time_step,
    )


def _row(name: str) -> int:
    part, *middle, field = name.split(".")
    return (
        at.TONES + at.TONE_ROWS * int(middle[0]) + TONE_FIELDS[field]
        if part == "excitation"
        else ROWS[name]
    )


def _fields(scene: Scene) -> dict[str, NumberOrRange]:
    """Return dotted name -> value or range of every numeric field that a lane holds."""
    values: dict[str, NumberOrRange] = {}
    for part in ("carriage", "sphere", "interface", "springs", "initial"):
        for field, value in getattr(scene, part):
            if isinstance(value, float | tuple):
                values[f"{part}.{field}"] = value
    for index, tone in enumerate(scene.excitation):
        values |= {f"excitation.{index}.{field}": getattr(tone, field) for field in TONE_FIELDS}
    if scene.interface.kind == "dry_friction" and scene.interface.normal_force is None:
        values["interface.normal_force"] = scene.sphere.mass * GRAVITY
    if scene.actuation.stretch is not None and "springs.stretch" in values:
        values.setdefault("initial.stretch", values["springs.stretch"])
        del values["springs.stretch"]  # one row, and the initial value rules it
    return values | scene.randomization
