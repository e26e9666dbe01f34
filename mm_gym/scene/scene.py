"""The scene that a person writes: all defaults, ranges, units and rules across fields."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, Protocol, cast

from pydantic import BeforeValidator, Field, PlainValidator
from pydantic_core import PydanticKnownError

from mm_gym.arrays import Array
from mm_gym.errors import SceneError, refuse, suggest
from mm_gym.files import read_bytes
from mm_gym.records.text import MOST_BYTES
from mm_gym.scene.actuators import Actuation, DampingActuator, VoltageActuator
from mm_gym.scene.excitation import (
    FIXED_FIELDS,
    Excitation,
    NumberOrRange,
    Positive,
    Range,
    Recorded,
)
from mm_gym.scene.findings import draft_of, findings_of, joint_findings
from mm_gym.scene.mechanics import (
    WITHOUT_STRETCH,
    Carriage,
    Interface,
    NoSprings,
    Sphere,
    Springs,
    Viscous,
)
from mm_gym.scene.part import Data, Document, Part, Rule, dotted_name, is_known, listed, never, put
from mm_gym.scene.sensors import Sensors

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

    reward = -(w_x (x1/x_ref)^2 + w_v (v1/v_ref)^2 + w_u sum(a^2) + w_s ((x2 - x1)/s_ref)^2
               + w_a (a1/a_ref)^2 + w_b (a2/b_ref)^2 + w_f (F/F_ref)^2)

    a1 and a2 are the absolute accelerations of carriage and sphere, F the force between them.
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
    carriage_acceleration_weight: Weight = 0.0
    """w_a [-]"""
    carriage_acceleration_scale: Scale = 25.0
    """a_ref [m/s^2]"""
    sphere_acceleration_weight: Weight = 0.0
    """w_b [-]"""
    sphere_acceleration_scale: Scale = 25.0
    """b_ref [m/s^2]"""
    coupling_force_weight: Weight = 0.0
    """w_f [-]"""
    coupling_force_scale: Scale = 1.0
    """F_ref [N]; of interface, springs and an actuator between the masses together, which the
    device's connection has to withstand"""
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


MethodName = Annotated[
    str,
    PlainValidator(_known_method, json_schema_input_type=str),
    Field(json_schema_extra=lambda schema: schema.update(enum=list(_method_names()))),
]
"""``"auto"``, or the name of a method."""


class Solver(Part):
    """Method and accuracy of the propagation; see `docs/numerics.md`."""

    method: MethodName = "auto"
    """what propagates the motion; "auto" chooses by the scene and the tolerance"""
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-9
    """bound of the relative error over a control step, for the methods that take a tolerance"""
    substeps: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """number of substeps in each sample interval, for the fixed-step methods; without sampled
    excitation a control step is one sample interval"""


WITHIN = ("actuation.stretch.minimum", "actuation.stretch.maximum", "springs.kind")
"""What the rules read that keep a stretch within its actuator's limits."""


NO_STRETCH = "springs.kind: got {1!r}; allowed: 'small_on_large', 'finite_stretch'"


def _needs_actuator(channel: str, name: str) -> Rule:
    return never(
        ("sensors.channels", f"actuation.{name}"),
        lambda channels, actuator: channel in channels and actuator is None,
        f"sensors.channels: {channel!r} needs an actuator; set actuation.{name}",
    )


def _within(
    name: str, value: NumberOrRange, actuator: str, least: float, most: float
) -> str | None:
    low, high = bounds(value)
    if least <= low <= high <= most or least >= most:
        return None
    return f"{name}: got {value}; allowed: within {actuator}, {least} to {most}"


def _begins_within(
    name: str, actuator: DampingActuator | VoltageActuator | None, value: NumberOrRange | None
) -> str | None:
    """Tell whether a damping or voltage, by its dotted name, begins within its limits."""
    if actuator is None or value is None or name != actuator.held:
        return None
    where = f"actuation.{name.partition('.')[2]}"
    return _within(name, value, where, actuator.minimum, actuator.maximum)


def _stretch_within(
    name: str, value: NumberOrRange | None, low: float | None, high: float | None, kind: str
) -> str | None:
    if value is None or low is None or high is None or kind in WITHOUT_STRETCH:
        return None
    return _within(f"{name}.stretch", value, "actuation.stretch", low, high)


def _springs_within(
    stretch: float | None, initial: object, low: float | None, high: float | None, kind: str
) -> str | None:
    if initial is not None:  # it counts, and the springs' own stretch does not
        return None
    return _stretch_within("springs", stretch, low, high, kind)


LATER = (
    "actuation.damping",
    "actuation.voltage",
    "actuation.force.between",
    "sensors.bias",
    "sensors.dropout",
    *(
        f"objective.{name}_{what}"
        for name in ("carriage_acceleration", "sphere_acceleration", "coupling_force")
        for what in ("weight", "scale")
    ),
)
"""Fields that scenes did not have when digests were first written into files."""


DELAY = "sensors.delay"
ERRORS = ("noise", "bias")  # fields of the sensors that have a number for each channel


def _owner(name: str) -> tuple[str, str]:
    """Return the dotted name of the part that a field drawn belongs to, and the field's name."""
    if name.startswith("sensors."):
        return "sensors", name.removeprefix("sensors.")
    prefix, _, field = name.rpartition(".")
    return prefix, field


def bounds(value: NumberOrRange) -> tuple[float, float]:
    """Return (low, high) of a number or a range."""
    return value if isinstance(value, tuple) else (value, value)


class Reward(Protocol):
    """What `mm_gym.OwnReward` has, for rooms below the one that makes it."""

    given: Any
    name: str
    arguments: tuple[str, ...]

    @cached_property
    def kernel(self) -> Callable[..., int]:
        """The kernel that rewards a step."""
        ...

    def costs(self, values: Array) -> Array:
        """Return the costs (n,) of lanes (rows, n)."""
        ...

    def first_fault(self, values: Array) -> int:
        """Return the first lane whose cost is not finite."""
        ...

    def fault(self, lane: Array) -> str:
        """Return what is wrong with the cost of a lane (rows,)."""
        ...


class Scene(Document):
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
    """dotted name of any numeric field -> [low, high], drawn uniformly for each episode: of the
    mechanics, the excitation, the sensors (a delay in whole steps), and of actuators lag and
    rate_limit; also of interface.kinetic_ratio = kinetic_coefficient / static_coefficient, and of
    low_ratio = low_frequency / high_frequency of noise, from which the first of the two fields then
    follows"""
    solver: Solver = Solver()

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("actuation.stretch", "springs.kind"),
            lambda actuator, kind: actuator is not None and kind in WITHOUT_STRETCH,
            f"actuation.stretch: there are no springs to stretch; {NO_STRETCH}",
        ),
        never(
            ("sensors.channels", "springs.kind"),
            lambda channels, kind: "stretch" in channels and kind in WITHOUT_STRETCH,
            f"sensors.channels: 'stretch' needs springs with a stretch; {NO_STRETCH}",
        ),
        never(
            ("actuation.damping.of", "interface.kind"),
            lambda damped, kind: damped == "interface" and kind != "viscous",
            "actuation.damping.of: got 'interface'; allowed: 'carriage', because interface.kind = "
            "{1!r} has no damping to control; set interface.kind = 'viscous'",
        ),
        never(
            ("actuation.voltage", "interface.kind"),
            lambda actuator, kind: actuator is not None and kind != "magnetorheological",
            "actuation.voltage: interface.kind: got {1!r}; allowed: 'magnetorheological'",
        ),
        _needs_actuator("applied_force", "force"),
        _needs_actuator("damping", "damping"),
        _needs_actuator("voltage", "voltage"),
        *(
            Rule((f"actuation.{name.split('.')[1]}", name), partial(_begins_within, name))
            for name in ("interface.damping", "carriage.damping", "interface.voltage")
        ),
        never(
            ("initial.stretch", "actuation.stretch"),
            lambda initial, actuator: initial is not None and actuator is None,
            "initial.stretch: has no effect without actuation.stretch; set springs.stretch",
        ),
        Rule(("initial.stretch", *WITHIN), partial(_stretch_within, "initial")),
        Rule(("springs.stretch", "initial.stretch", *WITHIN), _springs_within),
    )

    def __init__(self, /, **data: object) -> None:
        try:
            super().__init__(**data)
        except SceneError as error:
            lines, draft = str(error).splitlines(), draft_of(type(self), data)
            if draft is not None:
                lines += findings_of(*draft)
            raise SceneError("\n".join(dict.fromkeys(lines))) from None

    __init__.__pydantic_base_init__ = True  # pyright: ignore[reportFunctionMemberAccess] - as in Part

    def findings(self, wrong: frozenset[str] = frozenset(), prefix: str = "") -> list[str]:
        """Return what is wrong across the scene's fields, ranges included."""
        return [*super().findings(wrong, prefix), *self._randomization_findings(wrong)]

    @property
    def own_reward(self) -> Reward | None:
        """A caller's reward in place of `objective`, if there is one; see `mm_gym.rewarded`."""
        return None

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits that identify the content of the scene.

        Of records the content of the files counts, wherever they are.

        Raises
        ------
        SceneError
            If a record's file cannot be read: the field, and why.
        """
        records = [(i, p) for i, p in enumerate(self.excitation) if isinstance(p, Recorded)]
        left_out = self._without_effect()
        if records:
            left_out["excitation"] = {i: {"file", "files"} for i, _ in records}
        whole = hashlib.sha256(self.model_dump_json(exclude=left_out).encode())
        for i, part in records:
            if i > records[0][0]:
                whole.update(b"next")  # what one part has differs from what the other has
            try:
                for path in part.paths:
                    content = read_bytes(path, most=MOST_BYTES)
                    whole.update(hashlib.sha256(content).digest())
            except SceneError as error:
                msg = f"excitation.{i}.{part.source}: {error}"
                raise SceneError(msg) from error
        return whole.hexdigest()[:16]

    def _without_effect(self) -> dict[str, Any]:
        """Return the fields of `LATER` that have their default, as pydantic excludes fields."""
        found: dict[str, Any] = {}
        for name in LATER:
            *path, field = name.split(".")
            part: Part | None = self.value_of(".".join(path))
            inner = found
            if part is None:
                continue
            default = type(part).model_fields[field].get_default(call_default_factory=True)
            if getattr(part, field) == default:
                for word in path:
                    inner = inner.setdefault(word, {})
                inner[field] = True
        return found

    def replace(self, /, **values: object) -> Scene:
        """Return a validated copy with fields replaced by dotted name.

        Values are those of a scene file: ranges may be lists. A part of another kind begins with
        the defaults of that kind.

        Raises
        ------
        SceneError
            If a name is unknown, or the copy is not valid: with every finding, as for a file.

        Examples
        --------
        >>> Scene().replace(**{"carriage.mass": 0.2}).carriage.mass
        0.2
        """
        data = cast("dict[str, Data]", self.model_dump(mode="json"))
        put(data, values)
        return Scene.of(data)

    def range_of(self, name: str, stated: NumberOrRange) -> NumberOrRange:
        """Return a number or, if it is drawn, its range, by dotted name.

        A ratio that is drawn gives the range of the field that follows from it.
        """
        for ratio, (field, of) in self.drawn_ratios.items():
            if field == name:
                prefix, _, last = of.rpartition(".")
                own: float = getattr(self._drawable_parts()[prefix], last)
                low, high = bounds(self.randomization.get(of, own))
                least, most = self.randomization[ratio]
                return least * low, most * high
        return self.randomization.get(name, stated)

    @property
    def drawn_ratios(self) -> dict[str, tuple[str, str]]:
        """Dotted name of each ratio drawn -> those of the field it gives and of the other."""
        return {
            f"{prefix}.{name}": (f"{prefix}.{ratio.field}", f"{prefix}.{ratio.of}")
            for prefix, part in self._drawable_parts().items()
            for name, ratio in part.ratios.items()
            if f"{prefix}.{name}" in self.randomization
        }

    def _randomization_findings(self, wrong: frozenset[str]) -> list[str]:
        findings: list[str] = []
        names, parts = self._drawable(), self._drawable_parts()
        ranges: dict[str, dict[str, tuple[float, float]]] = {prefix: {} for prefix in parts}
        for name, ends in self.randomization.items():
            prefix, field = _owner(name)
            if not is_known([name], wrong):
                continue
            if name not in names:
                texts = [f"not a number of this scene that can be drawn{suggest(name, names)}"]
            elif name == "springs.stretch" and self.actuation.stretch is not None:
                texts = ["has no effect with actuation.stretch; set initial.stretch"]
            else:
                refused: dict[float, list[str]] = {}
                for end in ends:
                    value = int(end) if name == DELAY and end.is_integer() else end
                    refused[end] = parts[prefix].findings_with(field, value)
                texts = [text for end in refused for text in refused[end]]
                if name == self.actuation.damped and not texts:
                    found = _begins_within(name, self.actuation.device, ends)
                    texts += [] if found is None else [found.partition(": ")[2]]
                allowed = [end for end in ends if not refused[end]]
                if allowed:
                    ranges[prefix][field] = allowed[0], allowed[-1]
            where = dotted_name(("randomization", name))
            findings += [f"{where}: {text}" for text in texts]
        for prefix, part in parts.items():
            findings += joint_findings(prefix, part, ranges[prefix], wrong)
        return findings

    def _drawable(self) -> list[str]:
        """Return the dotted names that may be drawn; those of `initial` take ranges themselves."""
        names: list[str] = []
        for prefix, part in self._drawable_parts().items():
            numbers = [
                field
                for field, value in part
                if isinstance(value, float) and field not in FIXED_FIELDS
            ]
            names += [f"{prefix}.{field}" for field in (*numbers, *part.ratios)]
        sensors = self.sensors
        errors = [f"sensors.{what}.{c}" for what in ERRORS for c in sensors.channels]
        return [*names, DELAY, *errors]

    def _drawable_parts(self) -> dict[str, Part]:
        parts: dict[str, Part] = {
            "carriage": self.carriage,
            "sphere": self.sphere,
            "interface": self.interface,
            "springs": self.springs,
            "sensors": self.sensors,
        }
        parts |= {f"actuation.{name}": part for name, part in self.actuation if part is not None}
        return parts | {f"excitation.{index}": part for index, part in enumerate(self.excitation)}


def require_scene(scene: object) -> None:
    """Refuse anything but a scene."""
    if not isinstance(scene, Scene):
        refuse("scene", f"{scene!r:.60}", "a Scene, as load_scene returns it for an id or a file")
