"""What of a scene is drawn: its parts, their limits, how far they may move, and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.lanes import layout as at
from mm_gym.rendering.look import text_of
from mm_gym.scene.excitation import Impulse
from mm_gym.scene.scene import bounds

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant
    from mm_gym.scene.scene import Scene


RATES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25)
"""Frames per second; 25 are fluent, and more would make videos larger."""

SHORTEST_PERIOD = 0.6
"""Least time [s] on the screen of the carriage's natural period, so that an eye can follow."""

FEWEST = 4.0  # control steps below which a period is not seen as one


def natural_period(plant: Plant) -> float:
    """Return the carriage's natural period [s], or infinity if it has no linear stiffness."""
    low, high = plant.support.start_low, plant.support.start_high
    row = 0.5 * low + 0.5 * high
    stiffness, mass = row[at.K1] * row[at.ALPHA], row[at.M1] or row[at.M2]
    with np.errstate(all="ignore"):
        return float(2.0 * pi * sqrt(mass / stiffness)) if stiffness > 0.0 else np.inf


def frames_per_second(plant: Plant) -> int:
    """Return how many control steps are shown in a second: one of `RATES`."""
    step, period = plant.time_step, natural_period(plant)
    slowdown = max(1.0, SHORTEST_PERIOD / max(period, FEWEST * step))
    most = 1.0 / (slowdown * step) * (1.0 + 1e-9)
    return max((rate for rate in RATES if rate <= most), default=RATES[0])


def speed_text(time_step: float, frames: int) -> str:
    """Return how the time on the screen relates to that of the motion."""
    ratio = 1.0 / (time_step * frames)
    if abs(ratio - 1.0) < 0.005:  # noqa: PLR2004 - what three digits do not tell from 1
        return "real time"
    if ratio > 1.0:
        return f"slow motion 1 : {text_of(float(f'{ratio:.3g}'))}"
    return f"fast motion {text_of(float(f'{1.0 / ratio:.3g}'))} : 1"


MOST_LIMIT = 3.0
"""A limit widens the view at first if it is at most this many times the expected motion."""

NOISE_PEAKS = 3.0  # largest force that is expected of a noise, in its root mean square

NAMES_OF_SIZES = (
    *(("size", 1.0), ("amplitude", 1.0), ("scale_to.peak", 1.0)),
    ("rms", NOISE_PEAKS),
)
"""Fields that tell how large an excitation is, and the largest value expected over theirs."""

CAMERA = 0.3
"""Frequency below which the camera follows the ground, in the carriage's natural frequency."""

UNSTRETCHED = 1.0  # stretch with which springs are drawn that have none: no other is smaller


@dataclass(frozen=True)
class Subject:
    """The parts of a scene, as its pictures need them."""

    time_step: float  # [s]
    steps: int  # of an episode
    frames: int  # per second
    period: float  # the carriage's natural period [s]
    speed: str  # how the time on the screen relates to that of the motion
    has_damper: bool  # as the next two: whether it is drawn
    has_sphere: bool
    has_springs: bool
    interface: str  # its kind
    knows_forces: bool  # whether all forces on the carriage are known here
    stretch_range: tuple[float, float]  # [-], from one end of the springs' colours to the other
    force_limit: float | None  # of the control force [N], or None
    is_between: bool  # whether it acts between the masses
    is_stretched: bool  # whether the stretch is actuated
    damped_row: int  # of the damping or voltage that is actuated, 0 if none is
    damping_range: tuple[float, float]  # its limits [N s/m] or [V]
    device: str  # "damping" or "voltage"
    displacement_limit: float | None  # [m]
    rail_limit: float | None  # [m]
    displacement: float  # expected of the carriage [m]; the view begins with it
    offset: float  # expected of the sphere [m]
    disturbance: float  # largest force [N] expected of the excitation, 0 if there is none
    acceleration: float  # largest acceleration of the ground [m/s^2] expected, 0 if it is at rest
    impulse: float  # largest on the carriage [N s], 0 for none
    ground_impulse: float  # largest jump of the ground's velocity [m/s], 0 for none

    @property
    def camera_frequency(self) -> float:
        """Frequency [Hz] below which the camera follows the ground."""
        return CAMERA / min(self.period, self.steps * self.time_step)


def subject_of(scene: Scene, plant: Plant) -> Subject:
    """Return what of a scene is drawn."""
    low, high = plant.support.low, plant.support.high
    start_low, start_high = plant.support.start_low, plant.support.start_high
    has_springs = scene.springs.kind != "none"
    actuation, objective = scene.actuation, scene.objective
    frames = frames_per_second(plant)
    stretches = float(low[at.STRETCH]), float(high[at.STRETCH])
    if stretches[0] == stretches[1]:
        stretches = 0.0, 2.0 * max(stretches[1], UNSTRETCHED)
    drawn = [max(abs(start_low[row]), abs(start_high[row])) for row in (at.X1, at.X2)]
    return Subject(
        time_step=plant.time_step,
        steps=plant.steps,
        frames=frames,
        period=min(natural_period(plant), plant.steps * plant.time_step),
        speed=speed_text(plant.time_step, frames),
        has_damper=bool(high[at.D] > 0.0),
        has_sphere=has_springs or scene.interface.kind != "none" or actuation.is_between,
        has_springs=has_springs,
        interface=scene.interface.kind,
        knows_forces=not plant.support.is_general,
        stretch_range=stretches,
        force_limit=None if actuation.force is None else actuation.force.limit,
        is_between=actuation.is_between,
        is_stretched=actuation.stretch is not None,
        damped_row=plant.support.damped_row,
        damping_range=(float(low[at.DAMPING]), float(high[at.DAMPING])),
        device=plant.support.device,
        displacement_limit=objective.displacement_limit,
        rail_limit=objective.rail_half_length,
        displacement=_expected(
            float(drawn[0]), objective.displacement_scale, objective.displacement_limit
        ),
        offset=_expected(float(drawn[1]), objective.stroke_scale, objective.rail_half_length),
        disturbance=sum(_size(scene, k) for k in _parts(scene, "force", impulses=False)),
        acceleration=sum(_size(scene, k) for k in _parts(scene, "ground", impulses=False)),
        impulse=max((_size(scene, k) for k in _parts(scene, "force", impulses=True)), default=0.0),
        ground_impulse=max(
            (_size(scene, k) for k in _parts(scene, "ground", impulses=True)), default=0.0
        ),
    )


def _expected(drawn: float, scale: float, limit: float | None) -> float:
    expected = max(drawn, scale)
    if limit is not None and limit <= MOST_LIMIT * expected:
        return max(expected, 1.05 * limit)
    return expected


def _parts(scene: Scene, target: str, *, impulses: bool) -> list[int]:
    return [
        k
        for k, part in enumerate(scene.excitation)
        if part.target == target and isinstance(part, Impulse) == impulses
    ]


def _size(scene: Scene, k: int) -> float:
    """Return the largest value expected of a part of the excitation; of a record, 1."""
    part = scene.excitation[k]
    for name, factor in NAMES_OF_SIZES:
        value = part.value_of(name)
        if value is not None:
            ends = bounds(scene.range_of(f"excitation.{k}.{name}", value))
            return max(abs(ends[0]), abs(ends[1])) * factor or 1.0
    return 1.0
