"""The newest frame of an observation, and what the actuators have."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from agents.control.actuators import Actuators
from agents.control.controller import Info, Memory, Observation, Read, StateSource, chosen
from agents.control.scene import beginning, plant_of
from mm_gym import Scene
from mm_gym.arrays import Array, Single

ACTUATED = {"applied_force": "force"}
"""Channels that show an actuator, and have another name."""

ROWS = {
    "carriage_displacement": (1.0, 0.0, 0.0, 0.0),
    "sphere_displacement": (0.0, 1.0, 0.0, 0.0),
    "sphere_offset": (-1.0, 1.0, 0.0, 0.0),
    "carriage_velocity": (0.0, 0.0, 1.0, 0.0),
    "sphere_velocity": (0.0, 0.0, 0.0, 1.0),
    "slip_velocity": (0.0, 0.0, -1.0, 1.0),
}
"""The channels that show the state: rows of C in y = C x. The others are not used."""


POINTS = 9  # of the grid of an estimator


class Frame:
    """The newest frame of an observation.

    Parameters
    ----------
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

    def numbers(self, observation: Single) -> Array:
        """Return the channels (lanes, channels) as they are observed, over their scales."""
        return observation[:, self.columns].astype(np.float64)

    def values(self, observation: Single) -> Array:
        """Return the channels (lanes, channels) in SI units."""
        return self.numbers(observation) * self.unit + self.zero


class ObservedActuators(StateSource):
    """What the actuators have, from the first frame and the actions since; the state reads zero.

    It is all that a law needs which does not read the state, whatever the sensors show.

    Attributes
    ----------
    shown, c, unit
        Channels that show displacements and velocities, their rows of C (channels, 4), and the SI
        values of their scaled 1.
    grid
        Stretches or dampings at which an estimator is designed, or None where none is tuned.
    """

    tunes: tuple[str, ...] = ()  # actuators, of which the first there is changes an estimator

    def __init__(self, scene: Scene) -> None:
        self.frame, self.actuators = Frame(scene), Actuators(scene)
        tuned = (k for k, name in enumerate(scene.actuation.names) if name in self.tunes)
        self.tuned, self.grid = next(tuned, None), list[float | None]([None])
        if self.tuned is not None:
            ends = self.actuators.low[self.tuned], self.actuators.high[self.tuned]
            self.grid = np.linspace(*ends, POINTS).tolist()
        begun = [beginning(scene, name) for name in scene.actuation.names]
        self.begun = np.clip(begun, self.actuators.low, self.actuators.high)
        self.shown = [k for k, name in enumerate(self.frame.names) if name in ROWS]
        self.c = np.array([ROWS[self.frame.names[k]] for k in self.shown]).reshape(-1, 4)
        self.unit = self.frame.unit[self.shown]
        # (channels, k): 1 where a channel shows what an actuator tunes
        self.shows = np.array(
            [[own == name for name in scene.actuation.names] for own in self.frame.names],
            np.float64,
        )

    def begin(self, lanes: int) -> Memory:
        begun = np.tile(self.begun, (lanes, 1))
        return {"step": np.zeros(lanes, np.int64), "applied": begun, "asked": begun}

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        memory = self._seen(memory, self.frame.values(observation))
        return np.zeros((len(observation), 4)), memory["applied"], memory

    def note(self, memory: Memory, action: Array) -> Memory:
        applied, asked = self.actuators.reached(action, memory["applied"], memory["asked"])
        return {**memory, "applied": applied, "asked": asked}

    def observed(self, state: Array) -> tuple[list[int], Array]:
        """Return the channels that show the motion, and what they show of states (lanes, 4)."""
        return self.shown, state @ self.c.T / self.unit

    def nearest(self, applied: Array) -> NDArray[np.intp]:
        """Return the places (lanes,) in the grid that are nearest to what the actuators have."""
        if self.tuned is None:
            return np.zeros(len(applied), np.intp)
        low, high = self.actuators.low[self.tuned], self.actuators.high[self.tuned]
        share = (applied[:, self.tuned] - low) / (high - low)
        return np.rint(share * (POINTS - 1)).astype(np.intp)

    def _seen(self, memory: Memory, frame: Array) -> Memory:
        """Count a frame; the first shows the stretch or the damping with which episodes begin."""
        first, applied, asked = memory["step"] == 0, memory["applied"], memory["asked"]
        if first.any():
            shown = np.clip(frame @ self.shows, self.actuators.low, self.actuators.high)
            begun = np.where(self.shows.any(axis=0), shown, self.begun)
            applied, asked = chosen(first, begun, applied), chosen(first, begun, asked)
        return {**memory, "step": memory["step"] + 1, "applied": applied, "asked": asked}
