"""Sensors: the channels that the agent observes, with their errors, delay and history."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeAlias

from pydantic import BeforeValidator, Field

from mm_gym.scene.excitation import NonNegative
from mm_gym.scene.part import Part, Rule, listed
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    Channel: TypeAlias = str
else:
    Channel = Literal[*CHANNELS]
    """A name of the table of channels."""


def _listed_once(channels: tuple[str, ...]) -> str | None:
    twice = [channel for channel in channels if channels.count(channel) > 1]
    return f"channels: {twice[0]!r} is listed more than once" if twice else None


def _is_seen(name: str, errors: dict[str, float], channels: tuple[str, ...]) -> str | None:
    idle = [channel for channel in errors if channel not in channels]
    if not idle:
        return None
    return f"{name}.{idle[0]}: has no effect; the channel is not among sensors.channels"


class Sensors(Part):
    """What the agent observes: the channels at the last `history` control steps, oldest first."""

    channels: Annotated[tuple[Channel, ...], BeforeValidator(listed), Field(min_length=1)] = (
        "carriage_displacement",
        "sphere_offset",
        "carriage_velocity",
        "sphere_velocity",
    )
    """accelerations are absolute; applied_force is the force of the actuator on the carriage,
    spring_force that of the sphere's springs, disturbance_force that of the excitation"""
    noise: dict[Channel, NonNegative] = Field(default_factory=dict[Channel, NonNegative])
    """standard deviation of a channel's Gaussian noise, in the channel's SI unit"""
    bias: dict[Channel, float] = Field(default_factory=dict[Channel, float])
    """constant error added to a channel, in its SI unit"""
    delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """age of the newest frame, in control steps"""
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """probability that no frame arrives in a control step: the last one is shown again"""
    history: Annotated[int, Field(ge=1, le=1000)] = 1
    """number of frames observed; a frame holds all channels at one control step"""

    rules: ClassVar[tuple[Rule, ...]] = (
        Rule(("channels",), _listed_once),
        Rule(("noise", "channels"), partial(_is_seen, "noise")),
        Rule(("bias", "channels"), partial(_is_seen, "bias")),
    )
