"""What a policy is connected to: channels and actuators by name, unit and scale."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from mm_gym import Scene, compile_scene
from mm_gym.arrays import Array
from mm_gym.scene import Document

UNITS = {"force": "N", "stretch": "-", "damping": "N s/m", "voltage": "V"}
"""Of what actuators apply."""


def counted(number: int, noun: str) -> str:
    """Return a number of things in words: "1 action", "2 actions"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


class Channel(Document):
    """A number of a frame: (measured - zero) * factor."""

    name: str
    """as in `sensors.channels`"""
    unit: str
    """SI"""
    zero: float
    """[unit]"""
    factor: Annotated[float, Field(gt=0)]
    """[1/unit]"""


class Command(Document):
    """What an action in [-1, 1] stands for."""

    name: str
    """the actuator"""
    unit: str
    """SI; of a rate, that of the value over s"""
    kind: Literal["position", "rate"]
    """whether a value or its rate is commanded"""
    low: float
    """command of the action -1 [unit]"""
    high: float
    """command of the action 1 [unit]"""
    limits: Annotated[tuple[float, float], Field(strict=False)]
    """of what is applied"""

    @property
    def unit_of_command(self) -> str:
        """Of `low` and `high`."""
        return self.unit if self.kind == "position" else f"{self.unit}/s".replace("-/s", "1/s")


class Interface(Document):
    """The scene as a policy knows it: what it is given in each control step, and what it returns.

    An observation is `history` frames, the oldest first, each of all channels in their order.
    """

    channels: Annotated[tuple[Channel, ...], Field(strict=False)]
    """of a frame"""
    history: Annotated[int, Field(ge=1)]
    """frames"""
    time_step: Annotated[float, Field(gt=0)]
    """[s]"""
    commands: Annotated[tuple[Command, ...], Field(strict=False)]
    """in the order of the action"""

    @property
    def observed(self) -> int:
        """Numbers of an observation."""
        return self.history * len(self.channels)

    @classmethod
    def of_scene(cls, scene: Scene) -> Interface:
        """Return the interface of a scene."""
        plant = compile_scene(scene)
        return cls(
            channels=tuple(
                Channel(name=c.name, unit=c.unit, zero=c.zero, factor=c.factor)
                for c in plant.observed
            ),
            history=plant.history,
            time_step=scene.control.time_step,
            commands=tuple(_command(scene, name) for name in scene.actuation.names),
        )

    def commanded(self, actions: Array) -> Array:
        """Return the commands (..., k) of actions in [-1, 1], in the units of `commands`."""
        low, high = np.array([(one.low, one.high) for one in self.commands]).T
        return 0.5 * (high + low) + 0.5 * (high - low) * actions

    @property
    def told(self) -> list[str]:
        """What goes in and what comes out, a line each."""
        frames = f"{counted(self.history, 'frame')} of:"
        lines = [f"sample time {self.time_step:g} s; an observation is {frames}"]
        lines += [
            f"  measured[{i}]: {c.name} [{c.unit}], observed as (value - {c.zero:g}) * {c.factor:g}"
            for i, c in enumerate(self.channels)
        ]
        lines.append("Commands:" if self.history == 1 else "the oldest first. Commands:")
        lines += [
            f"  command[{i}]: {c.name}{' rate' if c.kind == 'rate' else ''} "
            f"[{c.unit_of_command}], {c.low:g} to {c.high:g}; "
            f"the actuator's limits are {c.limits[0]:g} and {c.limits[1]:g} [{c.unit}]"
            for i, c in enumerate(self.commands)
        ]
        return lines


def _command(scene: Scene, name: str) -> Command:
    part = getattr(scene.actuation, name)
    limits = (-part.limit, part.limit) if name == "force" else (part.minimum, part.maximum)
    low, high, kind = *limits, part.command
    if kind == "rate":  # of one that is drawn a controller knows the middle
        high = float(np.mean(scene.range_of(f"actuation.{name}.rate_limit", part.rate_limit)))
        low = -high
    return Command(name=name, unit=UNITS[name], kind=kind, low=low, high=high, limits=limits)
