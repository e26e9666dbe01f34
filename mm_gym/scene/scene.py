"""The scene that a person writes: all defaults, ranges, units and rules across fields."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Annotated, Self, cast

from pydantic import BeforeValidator, Field, JsonValue, PlainValidator, model_validator
from pydantic_core import PydanticKnownError

from mm_gym.errors import SceneError, suggest
from mm_gym.kernels.channels import CHANNELS
from mm_gym.scene.actuators import Actuation
from mm_gym.scene.dotted_names import put
from mm_gym.scene.excitation import (
    FIXED_FIELDS,
    Excitation,
    NumberOrRange,
    Positive,
    Range,
)
from mm_gym.scene.mechanics import Carriage, Interface, NoSprings, Sphere, Springs, Viscous
from mm_gym.scene.part import Part, dotted_name, listed
from mm_gym.scene.sensors import Sensors

if TYPE_CHECKING:
    from mm_gym.scene.dotted_names import Data


Weight = Annotated[float, Field(ge=0, le=1e12)]
Scale = Annotated[float, Field(ge=1e-12, le=1e12)]


class Initial(Part):
    """The state at the start of an episode: numbers, or [low, high] for a uniform draw."""

    carriage_displacement: NumberOrRange = 0.0
    """x1 [m]"""
    sphere_offset: NumberOrRange = 0.0
    """x2 - x1 [m]"""
    carriage_velocity: NumberOrRange = 0.0
    """v1 [m/s]"""
    sphere_velocity: NumberOrRange = 0.0
    """v2 [m/s]"""
    stretch: NumberOrRange | None = None
    """lambda [-], if the stretch is actuated; by default springs.stretch"""


class Objective(Part):
    """The reward, from the state at the end of a control step and the clipped action `a` [-].

    reward = -(w_x (x1/x_ref)^2 + w_v (v1/v_ref)^2 + w_u sum(a^2) + w_s ((x2 - x1)/s_ref)^2)
    """

    displacement_weight: Weight = 1.0
    """w_x [-]"""
    displacement_scale: Scale = 0.01
    """x_ref [m]; also the scale of observed displacements"""
    velocity_weight: Weight = 0.0
    """w_v [-]"""
    velocity_scale: Scale = 0.5
    """v_ref [m/s]; also the scale of observed velocities"""
    effort_weight: Weight = 0.0
    """w_u [-]"""
    stroke_weight: Weight = 0.0
    """w_s [-]"""
    stroke_scale: Scale = 0.02
    """s_ref [m]; also the scale of the observed offset"""
    displacement_limit: Positive | None = None
    """[m]: an episode terminates when |x1| exceeds it"""
    rail_half_length: Positive | None = None
    """[m]: an episode terminates when |x2 - x1| exceeds it"""


class Control(Part):
    """Length and number of the control steps."""

    time_step: Positive = 0.01
    """dt [s], the length of a control step"""
    steps: Annotated[int, Field(ge=1, le=1_000_000_000)] = 400
    """number of control steps in an episode"""


def _method_names() -> list[str]:
    from mm_gym.methods import names  # noqa: PLC0415 - it imports numba

    return ["auto", *names()]


def _known_method(name: object) -> str:
    """Return the name of a method; refuse any other value as pydantic's `Literal` does."""
    if name == "auto" or (isinstance(name, str) and name in _method_names()):
        return cast("str", name)
    *others, last = map(repr, _method_names())
    expected = f"{', '.join(others)} or {last}"
    raise PydanticKnownError("literal_error", {"expected": expected})  # noqa: EM101


def _list_methods(schema: dict[str, JsonValue]) -> None:
    schema["enum"] = list(_method_names())


MethodName = Annotated[
    str,
    PlainValidator(_known_method, json_schema_input_type=str),
    Field(json_schema_extra=_list_methods),
]
"""``"auto"``, or the name of a method."""


class Solver(Part):
    """Method and accuracy of the propagation; see `docs/numerics.md`."""

    method: MethodName = "auto"
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-9
    """bound of the relative error over a control step, for the methods that take a tolerance"""
    substeps: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """number of substeps in each sample interval, for the fixed-step methods; without sampled
    excitation a control step is one sample interval"""


class Scene(Part):
    """A carriage and a sphere, their coupling and excitation, and what the agent does and sees.

    Every field has a default; a scene states only what differs. All parts are frozen.
    `Scene(...)` raises one `SceneError` with all findings.
    """

    carriage: Carriage = Carriage()
    sphere: Sphere = Sphere()
    interface: Interface = Viscous()
    springs: Springs = NoSprings()
    excitation: Annotated[tuple[Excitation, ...], BeforeValidator(listed)] = ()
    initial: Initial = Initial()
    actuation: Actuation = Actuation()
    sensors: Sensors = Sensors()
    objective: Objective = Objective()
    control: Control = Control()
    randomization: dict[str, Range] = Field(default_factory=dict)
    """dotted name of any numeric field -> [low, high], drawn uniformly for each episode"""
    solver: Solver = Solver()

    @model_validator(mode="after")
    def _rules_across_parts(self) -> Self:
        problems = [*self._stretch_problems(), *self._range_problems()]
        problems += self._randomization_problems(known=problems)
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits that identify the content of the scene."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def replace(self, **values: object) -> Scene:
        """Return a validated copy with fields replaced by dotted name.

        Raises
        ------
        SceneError
            If a name is unknown, or the copy is not valid.

        Examples
        --------
        >>> Scene().replace(**{"carriage.mass": 0.2}).carriage.mass
        0.2
        """
        data = self._dump()
        for name, value in values.items():
            put(data, name, value)
        return Scene.of(data)

    def _dump(self) -> dict[str, Data]:
        return self.model_dump(mode="json")

    def _stretch_problems(self) -> list[str]:
        springs, actuator, initial = self.springs, self.actuation.stretch, self.initial.stretch
        problems: list[str] = []
        if springs.kind == "none":
            if actuator is not None:
                problems.append(
                    "actuation.stretch: there are no springs to stretch; set springs.kind"
                )
            problems += [
                f"sensors.channels: {channel!r} needs springs; set springs.kind"
                for channel in self.sensors.channels
                if CHANNELS[channel].scale == "stretch"
            ]
        if initial is not None and actuator is None:
            problems.append(
                "initial.stretch: has no effect without actuation.stretch; set springs.stretch"
            )
        if actuator is not None and springs.kind != "none":
            name, value = (
                ("initial", initial) if initial is not None else ("springs", springs.stretch)
            )
            low, high = bounds(value)
            if low < actuator.minimum or high > actuator.maximum:
                allowed = f"within actuation.stretch, {actuator.minimum} to {actuator.maximum}"
                problems.append(f"{name}.stretch: got {value}; allowed: {allowed}")
        return problems

    def _range_problems(self) -> list[str]:
        ranges = {f"initial.{name}": value for name, value in self.initial.model_dump().items()}
        ranges |= {
            dotted_name(("randomization", name)): value
            for name, value in self.randomization.items()
        }
        return [
            f"{name}: got [{value[0]}, {value[1]}]; allowed: [low, high] with low <= high"
            for name, value in ranges.items()
            if isinstance(value, tuple) and value[0] > value[1]
        ]

    def _randomization_problems(self, known: list[str]) -> list[str]:
        problems: list[str] = []
        names = self._drawable()
        for name, ends in self.randomization.items():
            if name not in names:
                texts = [f"not a number of this scene that can be drawn{suggest(name, names)}"]
            elif name == "springs.stretch" and self.actuation.stretch is not None:
                texts = ["has no effect with actuation.stretch; set initial.stretch"]
            else:
                texts = [text for text in self._refusals(name, ends) if text not in known]
            where = dotted_name(("randomization", name))
            problems += [f"{where}: {text}" for text in texts]
        return problems

    def _refusals(self, name: str, ends: tuple[float, float]) -> list[str]:
        """Return the findings for the scene with the field at either end of a range."""
        texts: list[str] = []
        for value in dict.fromkeys(ends):
            trial = self._dump()
            trial["randomization"] = {}
            put(trial, name, value)
            try:
                Scene.of(trial)
            except SceneError as error:
                texts += [line.removeprefix(f"{name}: ") for line in str(error).splitlines()]
        return texts

    def _drawable(self) -> list[str]:
        """Return the dotted names of the numbers that may be randomised.

        Those of `initial` are not among them, because they take ranges themselves.
        """
        parts: dict[str, Part] = {
            "carriage": self.carriage,
            "sphere": self.sphere,
            "interface": self.interface,
            "springs": self.springs,
        }
        parts |= {f"excitation.{index}": part for index, part in enumerate(self.excitation)}
        return [
            f"{prefix}.{field}"
            for prefix, part in parts.items()
            for field, value in part
            if isinstance(value, float) and field not in FIXED_FIELDS
        ]


def bounds(value: NumberOrRange) -> tuple[float, float]:
    """Return (low, high) of a number or a range."""
    return value if isinstance(value, tuple) else (value, value)
