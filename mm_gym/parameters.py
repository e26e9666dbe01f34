"""Which row of a lane holds which field of a scene, and the scene's support.

The support is what values the fields can take.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.excitation import Harmonic
from mm_gym.kernels import layout as at
from mm_gym.kernels.sources import prepare_filter
from mm_gym.scene import GRAVITY, bounds
from mm_gym.sources import sources_of

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
"""Row of each field of a lane; `mm_gym.sources` has those of the excitation."""


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
        What one propagation advances by [s]: a substep.
    substeps
        Of a control step.
    jets, terms, sources
        Row of the first jet, its terms, and the description of all excitation but the harmonics,
        see `mm_gym.kernels.sources`.
    """

    start_low: NDArray[np.float64]
    start_high: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    names: dict[str, int]
    ground: tuple[bool, ...]
    time_step: float
    substeps: int
    jets: int
    terms: int
    sources: NDArray[np.float64]

    @property
    def frequencies(self) -> NDArray[np.float64]:
        """Highest frequency of each harmonic [rad/s]."""
        return self.high[self._frequency_rows]

    @property
    def lowest_frequencies(self) -> NDArray[np.float64]:
        """Lowest frequency of each harmonic [rad/s]."""
        return self.low[self._frequency_rows]

    @property
    def _frequency_rows(self) -> slice:
        first = at.TONES + at.FREQUENCY
        return slice(first, first + at.TONE_ROWS * len(self.ground), at.TONE_ROWS)

    @property
    def sampled(self) -> bool:
        """Whether there is excitation besides harmonics."""
        return bool(self.sources[0] > 0.0)

    def fixed(self, row: int) -> bool:
        """Tell whether a row has one value only."""
        return bool(self.low[row] == self.high[row])

    @property
    def stiffest(self) -> float:
        """The largest k2 [N/m]: it falls with stretch, and never exceeds 6 k0."""
        if self.high[at.K0] <= 0.0:
            return 0.0
        return float(2.0 * self.high[at.K0] * (1.0 + 2.0 / self.low[at.STRETCH] ** 3))

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
    """Collect the values that randomisation, initial ranges and actuation can reach.

    Raises
    ------
    SceneError
        If a record cannot be read.
    CompileError
        If the excitation divides a control step too finely.
    """
    values, sources = _fields(scene), sources_of(scene)
    rows = {name: ROWS[name] for name in values}
    low, high = np.zeros(sources.size), np.zeros(sources.size)
    low[at.STRETCH] = high[at.STRETCH] = (
        1.0  # without springs: any stretch that the spring law allows
    )
    own = [(rows[name], value) for name, value in values.items()]
    for row, value in [*own, *sources.values.items()]:
        low[row], high[row] = bounds(value)
    if scene.springs.kind == "none":
        low[at.STRETCH] = high[at.STRETCH] = (
            1.0  # springs of stiffness 0, unstretched: kernels divide by the stretch
        )
    time_step = scene.control.time_step / sources.substeps
    for row, passes_velocity, drawn in sources.filters:
        for lane in () if drawn else (low, high):
            prepare_filter(lane[:, None], row, passes_velocity, time_step, 0)
    start_low, start_high = low.copy(), high.copy()
    if scene.actuation.force is not None:
        high[at.FORCE] = scene.actuation.force.limit
        low[at.FORCE] = -high[at.FORCE]
    if scene.actuation.stretch is not None:
        low[at.STRETCH], high[at.STRETCH] = (
            scene.actuation.stretch.minimum,
            scene.actuation.stretch.maximum,
        )
    tones = (part for part in scene.excitation if isinstance(part, Harmonic))
    return Support(
        start_low=start_low,
        start_high=start_high,
        low=low,
        high=high,
        names=rows | sources.rows,
        ground=tuple(tone.target == "ground" for tone in tones),
        time_step=time_step,
        substeps=sources.substeps,
        jets=sources.jets,
        terms=sources.terms,
        sources=sources.description,
    )


def _fields(scene: Scene) -> dict[str, NumberOrRange]:
    """Return dotted name -> value or range of every number of a lane but the excitation's."""
    values: dict[str, NumberOrRange] = {}
    for part in ("carriage", "sphere", "interface", "springs", "initial"):
        for field, value in getattr(scene, part):
            if isinstance(value, float | tuple):
                values[f"{part}.{field}"] = value
    if scene.interface.kind == "dry_friction" and scene.interface.normal_force is None:
        values["interface.normal_force"] = scene.sphere.mass * GRAVITY
    if scene.actuation.stretch is not None and "springs.stretch" in values:
        values.setdefault("initial.stretch", values["springs.stretch"])
        del values["springs.stretch"]  # one row, and the initial value rules it
    drawn = scene.randomization.items()
    return values | {name: value for name, value in drawn if name in ROWS}
