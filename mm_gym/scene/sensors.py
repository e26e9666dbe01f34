"""What passes between the agent and the plant: actuators and sensors."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from mm_gym.scene.excitation import NonNegative
from mm_gym.scene.part import Part, listed

Channel = Literal[
    "carriage_displacement",
    "sphere_displacement",
    "sphere_offset",
    "carriage_velocity",
    "sphere_velocity",
    "slip_velocity",
    "stretch",
    "carriage_acceleration",
    "sphere_acceleration",
    "spring_force",
    "disturbance_force",
    "ground_acceleration",
]


class Sensors(Part):
    """What the agent sees: channels of `history` control steps, oldest first."""

    channels: Annotated[tuple[Channel, ...], BeforeValidator(listed), Field(min_length=1)] = (
        "carriage_displacement",
        "sphere_offset",
        "carriage_velocity",
        "sphere_velocity",
    )
    """accelerations are absolute; the forces are those of the sphere's springs on the carriage and
    of the disturbance"""
    noise: dict[Channel, NonNegative] = Field(default_factory=dict[Channel, NonNegative])
    """standard deviation of a channel's Gaussian noise, in its SI unit"""
    delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """control steps by which the newest frame is late"""
    history: Annotated[int, Field(ge=1, le=1000)] = 1
    """frames observed"""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for channel in self.channels:
            if self.channels.count(channel) > 1:
                msg = f"channels: {channel!r} is listed more than once"
                raise ValueError(msg)
        for channel in self.noise:
            if channel not in self.channels:
                msg = f"noise.{channel}: has no effect; the channel is not among sensors.channels"
                raise ValueError(msg)
        return self
