"""What of a scene is drawn: its parts, their limits, how far they may move, and how fast."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from mm_gym.lanes import layout
from mm_gym.plant.plant import Plant
from mm_gym.rendering.look import text_of
from mm_gym.scene.excitation import Impulse
from mm_gym.scene.scene import Scene, bounds

RATES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25)
"""Frames per second; 25 are fluent, and more would make videos larger."""

SHORTEST_PERIOD = 0.6
"""Least time [s] on the screen of the carriage's natural period, so that an eye can follow."""

FEWEST = 4.0  # control steps below which a period is not seen as one


def natural_period(plant: Plant) -> float:
    """Return the carriage's natural period [s], or infinity if it has no linear stiffness."""
    low, high = plant.support.start_low, plant.support.start_high
    row = 0.5 * low + 0.5 * high
    stiffness, mass = row[layout.K1] * row[layout.ALPHA], row[layout.M1] or row[layout.M2]
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


class Subject:
    """The parts of a scene, as its pictures need them."""

    def __init__(self, scene: Scene, plant: Plant) -> None:
        support, actuation, objective = plant.support, scene.actuation, scene.objective
        low, high, start_low, start_high = (
            values.tolist()
            for values in (support.low, support.high, support.start_low, support.start_high)
        )
        self.support = support
        self.time_step, self.steps = plant.time_step, plant.steps  # [s], and those of an episode
        self.frames = frames_per_second(plant)
        self.period = min(natural_period(plant), plant.steps * plant.time_step)  # carriage's [s]
        self.camera_frequency = CAMERA / self.period  # [Hz], below which it follows the ground
        self.speed = speed_text(plant.time_step, self.frames)
        # which parts are drawn
        self.interface = scene.interface.kind
        self.idle_velocity = support.idle_velocity  # [m/s], of friction that never slips
        self.has_damper = high[layout.D] > 0.0
        self.has_springs = scene.springs.kind != "none"
        is_coupled = self.interface != "none" or actuation.is_between
        self.has_sphere = self.has_springs or is_coupled
        # the actuators
        self.force_limit = None if actuation.force is None else actuation.force.limit  # [N]
        self.is_between = actuation.is_between  # the force, and not on the ground
        self.is_stretched = actuation.stretch is not None
        # [-], from one end of the springs' colours to the other
        self.stretch_range = low[layout.STRETCH], high[layout.STRETCH]
        if low[layout.STRETCH] == high[layout.STRETCH]:
            self.stretch_range = 0.0, 2.0 * max(high[layout.STRETCH], UNSTRETCHED)
        self.device, self.damped_row = support.device, support.damped_row  # 0 if none is actuated
        self.damping_range = low[layout.DAMPING], high[layout.DAMPING]  # [N s/m] or [V]
        # how far carriage and sphere may move, and are expected to [m]; the view begins with it
        self.displacement_limit = objective.displacement_limit
        self.rail_limit = objective.rail_half_length
        x1, x2 = (max(abs(start_low[row]), abs(start_high[row])) for row in (layout.X1, layout.X2))
        self.displacement = _expected(x1, objective.displacement_scale, self.displacement_limit)
        self.offset = _expected(x2, objective.stroke_scale, self.rail_limit)
        # largest force [N] and acceleration of the ground [m/s^2] expected, 0 if there is none
        self.disturbance = sum(_sizes(scene, "force", impulses=False))
        self.acceleration = sum(_sizes(scene, "ground", impulses=False))
        # largest impulse [N s], and jump of the ground's velocity [m/s]
        self.impulse = max(_sizes(scene, "force", impulses=True), default=0.0)
        self.ground_impulse = max(_sizes(scene, "ground", impulses=True), default=0.0)


def _expected(drawn: float, scale: float, limit: float | None) -> float:
    expected = max(drawn, scale)
    if limit is not None and limit <= MOST_LIMIT * expected:
        return max(expected, 1.05 * limit)
    return expected


def _sizes(scene: Scene, target: str, *, impulses: bool) -> list[float]:
    return [
        _size(scene, k)
        for k, part in enumerate(scene.excitation)
        if part.target == target and isinstance(part, Impulse) == impulses
    ]


def _size(scene: Scene, k: int) -> float:
    """Return the largest value expected of a part of the excitation; of a record's values, 1."""
    part = scene.excitation[k]
    mass = abs(getattr(part, "inertial_mass", None) or 1.0)
    for name, factor in NAMES_OF_SIZES:
        value = part.value_of(name)
        if value is not None:
            ends = bounds(scene.range_of(f"excitation.{k}.{name}", value))
            return max(abs(ends[0]), abs(ends[1])) * factor * mass or 1.0
    return mass
