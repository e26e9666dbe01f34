"""Actuators: a force on the carriage, the stretch of the springs."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mm_gym.scene.excitation import NonNegative, Positive
from mm_gym.scene.part import Part


class Actuator(Part):
    """An actuator, which holds its value over each control step.

    Without lag and rate limit it reaches its command at once. A lag lets it go
    1 - exp(-time_step / lag) of the way in a control step; then the rate limit applies, then the
    limits.
    """

    rate_limit: Positive | None = None
    """[N/s] or [1/s]; none by default"""
    lag: NonNegative = 0.0
    """time constant of a first-order lag [s]; 0 for none"""
    command: Literal["position", "rate"] = "position"
    """meaning of an action in [-1, 1]: a value within the limits, or a fraction of rate_limit"""

    @model_validator(mode="after")
    def _rate_is_limited(self) -> Self:
        if self.command == "rate" and self.rate_limit is None:
            msg = "rate_limit: missing; command = 'rate' needs it"
            raise ValueError(msg)
        return self


class ForceActuator(Actuator):
    """A control force on the carriage [N]; action 1 is +limit."""

    limit: Positive = 4.0
    """[N]"""


class StretchActuator(Actuator):
    """The pre-stretch of the springs [-]."""

    minimum: Annotated[float, Field(ge=1)] = 1.0
    """[-]"""
    maximum: Annotated[float, Field(gt=1)] = 3.0
    """[-]"""

    @model_validator(mode="after")
    def _minimum_below_maximum(self) -> Self:
        if self.minimum >= self.maximum:
            msg = f"minimum: got {self.minimum}; allowed: less than maximum = {self.maximum}"
            raise ValueError(msg)
        return self


class Actuation(Part):
    """The actuators; an environment needs at least one."""

    force: ForceActuator | None = None
    stretch: StretchActuator | None = None
