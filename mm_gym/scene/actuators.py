"""Actuators: a force, the stretch of the springs, damping or voltage of a semi-active device."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from mm_gym.scene.excitation import NonNegative, Positive
from mm_gym.scene.part import Part, Rule, below, never


class Actuator(Part):
    """An actuator, which holds its value over each control step.

    Without lag and rate limit it reaches its command at once. A lag lets it go
    1 - exp(-time_step / lag) of the way in a control step; then the rate limit applies, then the
    limits.
    """

    rate_limit: Positive | None = None
    """[N/s], [1/s], [N/m] or [V/s]; none by default"""
    lag: NonNegative = 0.0
    """time constant of a first-order lag [s]; 0 for none"""
    command: Literal["position", "rate"] = "position"
    """meaning of an action in [-1, 1]: a value within the limits, or a fraction of rate_limit"""

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("command", "rate_limit"),
            lambda command, limit: command == "rate" and limit is None,
            "rate_limit: missing; command = 'rate' needs it",
        ),
    )


class ForceActuator(Actuator):
    """A control force u on the carriage [N]; action 1 is +limit."""

    limit: Positive = 4.0
    """[N]"""
    between: Literal["ground", "masses"] = "ground"
    """what the actuator pushes against: the ground, or the sphere, on which -u then acts"""


class StretchActuator(Actuator):
    """The pre-stretch of the springs [-]."""

    minimum: Annotated[float, Field(ge=1)] = 1.0
    """[-]"""
    maximum: Annotated[float, Field(gt=1)] = 3.0
    """[-]"""

    rules: ClassVar[tuple[Rule, ...]] = (*Actuator.rules, below("minimum", "maximum"))


class DampingActuator(Actuator):
    """The damping coefficient of a semi-active device [N s/m].

    An episode begins with the damping of the interface, or of the carriage. The device only takes
    energy out of the motion.
    """

    of: Literal["interface", "carriage"] = "interface"
    """which damper it is: that of a viscous interface, or of the carriage"""
    minimum: NonNegative = 0.0
    """[N s/m]"""
    maximum: Positive = 10.0
    """[N s/m]"""

    rules: ClassVar[tuple[Rule, ...]] = (*Actuator.rules, below("minimum", "maximum"))

    @property
    def held(self) -> str:
        """Dotted name of what it holds."""
        return f"{self.of}.damping"


class VoltageActuator(Actuator):
    """The voltage of a magnetorheological damper [V].

    An episode begins with the voltage of the interface.
    """

    lag: NonNegative = 1.0 / 190.0
    """time constant of a first-order lag [s], by default that of Spencer et al. (1997); 0 for
    none"""
    minimum: NonNegative = 0.0
    """[V]"""
    maximum: Positive = 2.25
    """[V], by default where the damper of Spencer et al. saturates"""

    rules: ClassVar[tuple[Rule, ...]] = (*Actuator.rules, below("minimum", "maximum"))

    @property
    def held(self) -> str:
        """Dotted name of what it holds."""
        return "interface.voltage"


class Actuation(Part):
    """The actuators; an environment needs at least one."""

    force: ForceActuator | None = None
    stretch: StretchActuator | None = None
    damping: DampingActuator | None = None
    voltage: VoltageActuator | None = None

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("damping", "voltage"),
            lambda damping, voltage: damping is not None and voltage is not None,
            "voltage: not allowed with damping; remove one of the two",
        ),
    )

    @property
    def device(self) -> DampingActuator | VoltageActuator | None:
        """The actuator of the semi-active device, if there is one."""
        return self.damping or self.voltage

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the action."""
        return tuple(name for name, actuator in self if actuator is not None)

    @property
    def damped(self) -> str | None:
        """Dotted name of the damping or voltage that is actuated, if one is."""
        return None if self.device is None else self.device.held

    @property
    def is_between(self) -> bool:
        """Whether there is a force, and it acts between the masses."""
        return self.force is not None and self.force.between == "masses"
