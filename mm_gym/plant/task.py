"""Actuators, objective and sensors: as the task array, and as rows of each lane's own."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mm_gym.arrays import Array
from mm_gym.excitation.kinds import FILTER, KIND, OWN
from mm_gym.excitation.noise import PLACE
from mm_gym.lanes import layout
from mm_gym.methods.support import Support
from mm_gym.scene.actuators import DampingActuator, ForceActuator, StretchActuator, VoltageActuator
from mm_gym.scene.scene import DELAY, NumberOrRange, Scene, bounds
from mm_gym.step.channels import CHANNELS

SMALLEST = float(np.finfo(np.float64).tiny)  # smallest scale of a channel, whose inverse is finite


class Observed(NamedTuple):
    """A channel as the agent observes it: (value - zero) * factor, plus noise."""

    name: str
    unit: str  # SI
    factor: float  # inverse of the channel's scale [1 / unit]
    zero: float  # value shown as 0 [unit]
    noise: float  # standard deviation [unit]; the middle of what is drawn

    @property
    def one(self) -> float:
        """Value shown as 1 [unit]."""
        return self.zero + 1.0 / self.factor


def observed(scene: Scene) -> tuple[Observed, ...]:
    """Return the channels that a scene observes, in order."""
    found: list[Observed] = []
    for name in scene.sensors.channels:
        scale, zero = scales(scene)[CHANNELS[name].scale]
        noise = middle(scene, f"sensors.noise.{name}", scene.sensors.noise.get(name, 0.0))
        found.append(Observed(name, CHANNELS[name].unit, 1.0 / scale, zero, noise))
    return tuple(found)


def task_array(scene: Scene, support: Support) -> Array:
    """Return actuators, objective and channels in the slots of `mm_gym.lanes.layout`."""
    channels = observed(scene)
    task = np.zeros(layout.CHANNELS + layout.CHANNEL_SIZE * len(channels))
    _actuators(scene, task)
    _objective(scene, task)
    task[layout.CHANNEL_COUNT] = len(channels)
    for k, channel in enumerate(channels):
        slots = task[layout.CHANNELS + layout.CHANNEL_SIZE * k :]
        row = CHANNELS[channel.name]
        slots[layout.SHOWN], slots[layout.SUBTRACTED] = row.row, row.subtracted
        slots[layout.SCALE], slots[layout.ZERO] = channel.factor, channel.zero
        slots[layout.NOISE] = channel.noise * channel.factor
    read = *(channel.name for channel in channels), *rewarded_channels(scene)
    rows = {CHANNELS[name].row for name in read}
    task[layout.IS_DERIVED] = not rows.isdisjoint(layout.DERIVED)
    # The kernels derive a disturbance for itself only where a channel shows it.
    task[layout.HAS_REACTIONS] = (
        not rows.isdisjoint(layout.REACTIONS) or scene.own_reward is not None
    )
    noisy = sum(channel.noise > 0.0 for channel in channels)
    drawn = noisy + noisy % 2  # normal numbers come in pairs
    sensors = support.sensors_row
    if sensors:
        task[layout.SENSORS_ROW], task[layout.HISTORY] = sensors, scene.sensors.history
        task[layout.MOST_DELAY] = support.high[sensors + layout.DELAY]
        task[layout.HAS_DROPOUT] = support.high[sensors + layout.DROPOUT] > 0.0
        drawn += 2 * (task[layout.HAS_DROPOUT] > 0.0 and not drawn)  # frames must not have the same
    task[layout.TIME_STEP] = scene.control.time_step
    slots = {"force": layout.FORCE_ROW, "stretch": layout.STRETCH_ROW}
    for name, row in support.actuator_rows.items():
        task[slots.get(name, layout.DAMPING_ROW)] = row
    reserved = _reserved(support.sources, drawn)
    task[layout.IS_NOISY] = noisy > 0
    task[layout.RESERVED], task[layout.HAS_RESERVED_NOISE] = reserved, drawn <= reserved
    return task


def rewarded_channels(scene: Scene) -> tuple[str, ...]:
    """Return the channels that the reward of a scene reads, but for those of the motion."""
    if scene.own_reward is not None:
        return scene.own_reward.arguments
    objective = scene.objective
    on_carriage = objective.carriage_acceleration_weight
    on_sphere = objective.sphere_acceleration_weight + objective.coupling_force_weight
    found = {"carriage_acceleration": on_carriage, "sphere_acceleration": on_sphere}
    return tuple(name for name, weight in found.items() if weight > 0.0)


def _reserved(sources: Array, drawn: int) -> int:
    """Return how many numbers of a lane's stream are reserved for the noise of a frame.

    The stream is that of the initial state, the parameters and the excitation. Without filtered
    noise nothing draws from it after the start, so the sensors take what they need. With filtered
    noise the number must not depend on the sensors. It is 2 where a filter's parameters are drawn,
    and 0 otherwise: so Hybrid-v0, with two noisy channels, and PreStretchNoise-v0 have the episodes
    that their published results are of.
    """
    filters = sources[sources[:, KIND] == FILTER]
    if not len(filters):
        return drawn
    return 2 if np.any(filters[:, OWN + PLACE] == 0.0) else 0


def _actuators(scene: Scene, task: Array) -> None:
    task[[layout.FORCE_RATE, layout.STRETCH_RATE, layout.DAMPING_RATE]] = np.inf
    task[[layout.FORCE_LAG_FACTOR, layout.STRETCH_LAG_FACTOR, layout.DAMPING_LAG_FACTOR]] = 1.0
    slots = {"force": layout.HAS_FORCE, "stretch": layout.HAS_STRETCH}
    for name, actuator in scene.actuation:
        if actuator is not None:
            is_force = isinstance(actuator, ForceActuator)
            low = -actuator.limit if is_force else actuator.minimum
            high = actuator.limit if is_force else actuator.maximum
            rate, lag_factor = rate_and_lag_factor(scene, name)
            values = 1.0, low, high, rate, actuator.command == "rate", lag_factor
            first = slots.get(name, layout.HAS_DAMPING)
            task[first : first + len(values)] = values


def rate_and_lag_factor(scene: Scene, name: str) -> tuple[float, float]:
    """Return an actuator's largest change in a control step, and what its lag lets it go of a way.

    They are those in the middle of what is drawn.
    """
    actuator, step = getattr(scene.actuation, name), scene.control.time_step
    limit = actuator.rate_limit
    rate = np.inf if limit is None else middle(scene, f"actuation.{name}.rate_limit", limit) * step
    lag = middle(scene, f"actuation.{name}.lag", actuator.lag)
    return rate, 1.0 if lag == 0.0 else -math.expm1(-step / lag)


def _objective(scene: Scene, task: Array) -> None:
    objective = scene.objective
    task[layout.WEIGHT_EFFORT] = objective.effort_weight
    scaled = {
        layout.WEIGHT_DISPLACEMENT: "displacement",
        layout.WEIGHT_VELOCITY: "velocity",
        layout.WEIGHT_STROKE: "stroke",
        layout.WEIGHT_CARRIAGE_ACCELERATION: "carriage_acceleration",
        layout.WEIGHT_SPHERE_ACCELERATION: "sphere_acceleration",
        layout.WEIGHT_COUPLING_FORCE: "coupling_force",
    }
    for slot, name in scaled.items():
        weight, scale = (getattr(objective, f"{name}_{what}") for what in ("weight", "scale"))
        task[slot] = weight / scale**2
    task[layout.HAS_DERIVED_COST] = scene.own_reward is None and bool(rewarded_channels(scene))
    task[layout.DISPLACEMENT_LIMIT] = objective.displacement_limit or np.inf
    task[layout.RAIL_LIMIT] = objective.rail_half_length or np.inf
    task[layout.STEPS] = scene.control.steps


def scales(scene: Scene) -> dict[str, tuple[float, float]]:
    """Return each scale of the table of channels, and the value shown as zero."""
    objective, force = scene.objective, scene.actuation.force
    displacement, velocity = objective.displacement_scale, objective.velocity_scale
    return {
        "displacement": (displacement, 0.0),
        "stroke": (objective.stroke_scale, 0.0),
        "velocity": (velocity, 0.0),
        "acceleration": (velocity**2 / displacement, 0.0),
        # The product of two small numbers may be 0.
        "force": (max(scene.carriage.stiffness * displacement, SMALLEST), 0.0),
        "stretch": _half_and_middle(scene.actuation.stretch),
        "damping": _half_and_middle(scene.actuation.damping),
        "voltage": _half_and_middle(scene.actuation.voltage),
        "limit": (1.0 if force is None else max(force.limit, SMALLEST), 0.0),
    }


def _half_and_middle(
    actuator: StretchActuator | DampingActuator | VoltageActuator | None,
) -> tuple[float, float]:
    """Return what shows an actuator's limits as -1 and 1."""
    if actuator is None:
        return 1.0, 0.0
    low, high = actuator.minimum, actuator.maximum
    return max(0.5 * (high - low), SMALLEST), 0.5 * (high + low)


class Instruments(NamedTuple):
    """Sensors and actuators that a lane has for itself, see `mm_gym.lanes.layout`."""

    names: dict[str, int]  # dotted name of each field -> its row
    values: dict[int, NumberOrRange]  # of rows
    sensors: int  # their first row; 0 if all lanes have the same ones, at most with noise and delay
    actuators: dict[str, int]  # first row of each whose lag or rate limit is drawn
    size: int  # number of the rows in front of these and of these

    @property
    def whole(self) -> list[int]:
        """Rows of whole numbers."""
        return [self.names[DELAY]] if self.sensors else []


def instruments_of(scene: Scene, first: int) -> Instruments:
    """Return what a scene's lanes have for themselves, with rows from the first one on."""
    names: dict[str, int] = {}
    values: dict[int, NumberOrRange] = {}

    def add(name: str, row: int, stated: NumberOrRange) -> None:
        names[name], values[row] = row, scene.range_of(name, stated)

    sensors, size = scene.sensors, first
    faults = {"dropout": sensors.dropout}
    faults |= {f"bias.{name}": sensors.bias.get(name, 0.0) for name in sensors.channels}
    are_stated = any(middle(scene, f"sensors.{name}", value) for name, value in faults.items())
    is_own = are_stated or is_drawn(scene, "sensors.")
    if is_own:
        add(DELAY, size + layout.DELAY, float(sensors.delay))
        add("sensors.dropout", size + layout.DROPOUT, sensors.dropout)
        size += layout.SENSORS_SIZE
        for channel in sensors.channels:
            add(f"sensors.noise.{channel}", size + layout.SPREAD, sensors.noise.get(channel, 0.0))
            add(f"sensors.bias.{channel}", size + layout.BIAS, sensors.bias.get(channel, 0.0))
            size += layout.ERRORS_SIZE
    actuators: dict[str, int] = {}
    for name, actuator in scene.actuation:
        prefix = f"actuation.{name}."
        if actuator is None or not is_drawn(scene, prefix):
            continue
        actuators[name] = size
        add(f"{prefix}lag", size + layout.LAG, actuator.lag)
        limit = np.inf if actuator.rate_limit is None else actuator.rate_limit
        add(f"{prefix}rate_limit", size + layout.RATE_LIMIT, limit)
        size += layout.ACTUATOR_SIZE
    return Instruments(names, values, first if is_own else 0, actuators, size)


def is_drawn(scene: Scene, prefix: str) -> bool:
    """Tell whether a number of some beginning of its dotted name differs between episodes."""
    ranges = (ends for name, ends in scene.randomization.items() if name.startswith(prefix))
    return any(low < high for low, high in ranges)


def middle(scene: Scene, name: str, stated: float) -> float:
    """Return a number by dotted name, or the middle of the range that it is drawn from."""
    return float(np.mean(bounds(scene.range_of(name, stated))))
