"""The rows of what each lane's own sensors and actuators have, where episodes differ in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.lanes import layout as at
from mm_gym.scene.scene import DELAY, bounds

if TYPE_CHECKING:
    from mm_gym.scene.scene import NumberOrRange, Scene


class Instruments(NamedTuple):
    """Sensors and actuators that a lane has for itself, see `mm_gym.lanes.layout`.

    Attributes
    ----------
    names
        Dotted name of each field -> its row.
    values
        Row -> number or range.
    sensors
        First row of the sensors; 0 if all lanes have the same ones, at most with noise and delay.
    actuators
        Name -> first row of each actuator whose lag or rate limit is drawn.
    size
        Number of the rows in front of these and of these.
    """

    names: dict[str, int]
    values: dict[int, NumberOrRange]
    sensors: int
    actuators: dict[str, int]
    size: int

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
    is_own = sensors.dropout or sensors.bias or is_drawn(scene, "sensors.")
    if is_own:
        add(DELAY, size + at.DELAY, float(sensors.delay))
        add("sensors.dropout", size + at.DROPOUT, sensors.dropout)
        size += at.SENSORS_SIZE
        for channel in sensors.channels:
            add(f"sensors.noise.{channel}", size + at.SPREAD, sensors.noise.get(channel, 0.0))
            add(f"sensors.bias.{channel}", size + at.BIAS, sensors.bias.get(channel, 0.0))
            size += at.ERRORS_SIZE
    actuators: dict[str, int] = {}
    for name, actuator in scene.actuation:
        prefix = f"actuation.{name}."
        if actuator is None or not is_drawn(scene, prefix):
            continue
        actuators[name] = size
        add(f"{prefix}lag", size + at.LAG, actuator.lag)
        limit = np.inf if actuator.rate_limit is None else actuator.rate_limit
        add(f"{prefix}rate_limit", size + at.RATE_LIMIT, limit)
        size += at.ACTUATOR_SIZE
    return Instruments(names, values, first if is_own else 0, actuators, size)


def is_drawn(scene: Scene, prefix: str) -> bool:
    """Tell whether a number of some beginning of its dotted name differs between episodes."""
    ranges = (ends for name, ends in scene.randomization.items() if name.startswith(prefix))
    return any(low < high for low, high in ranges)


def middle(scene: Scene, name: str, stated: float) -> float:
    """Return a number by dotted name, or the middle of the range that it is drawn from."""
    return float(np.mean(bounds(scene.range_of(name, stated))))
