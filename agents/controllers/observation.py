"""What the channels of an observation are, in SI units: the one place where frames are decoded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.controller import plant_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from agents.controllers.controller import Values
    from mm_gym import Scene

ROWS = {
    "carriage_displacement": (1.0, 0.0, 0.0, 0.0),
    "sphere_displacement": (0.0, 1.0, 0.0, 0.0),
    "sphere_offset": (-1.0, 1.0, 0.0, 0.0),
    "carriage_velocity": (0.0, 0.0, 1.0, 0.0),
    "sphere_velocity": (0.0, 0.0, 0.0, 1.0),
    "slip_velocity": (0.0, 0.0, -1.0, 1.0),
}
"""The channels that show the state: rows of C in y = C x. The others are not used."""


class Frame:
    """The newest frame of an observation.

    Parameters
    ----------
    scene
        The scene that is observed.
    names
        Of the channels, by default all; they stay in the order of the observation.

    Attributes
    ----------
    names
        Of the channels.
    zero, unit, noise
        (channels,) a channel's value is `zero` plus `unit` times the observed number, in SI units,
        and its noise has this standard deviation, in SI units, too.
    """

    def __init__(self, scene: Scene, names: Iterable[str] | None = None) -> None:
        plant = plant_of(scene)
        wanted = plant.channels if names is None else set(names)
        kept = [k for k, name in enumerate(plant.channels) if name in wanted]
        channels = [plant.observed[k] for k in kept]
        self.names = tuple(plant.channels[k] for k in kept)
        self.columns = np.array(kept, np.intp) - len(plant.channels)
        self.zero = np.array([channel.zero for channel in channels])
        self.unit = np.array([1.0 / channel.factor for channel in channels])
        self.noise = np.array([channel.noise for channel in channels])

    def numbers(self, observation: NDArray[np.float32]) -> Values:
        """Return the channels (lanes, channels) as they are observed, over their scales."""
        return observation[:, self.columns].astype(np.float64)

    def values(self, observation: NDArray[np.float32]) -> Values:
        """Return the channels (lanes, channels) in SI units."""
        return self.numbers(observation) * self.unit + self.zero
