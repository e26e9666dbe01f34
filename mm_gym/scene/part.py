"""The base class of all parts of a scene: its rules, its findings, and its data by dotted name."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, Self, TypeAlias, cast, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from mm_gym.errors import SceneError, refuse, suggest

RANGE = "range"  # type of the errors that `ordered` raises
LARGEST = 1.7976931348623157e308  # the largest double


class Rule(NamedTuple):
    """A rule across fields of a part.

    A rule that holds at all ends of its fields' ranges must hold in between.
    """

    fields: tuple[str, ...]  # names of the fields that it reads
    finding: Callable[..., str | None]  # their values -> what is wrong, as "field: text", or None


def never(
    fields: tuple[str, ...],
    are: Callable[[Any, Any], bool] | Callable[[Any, Any, Any], bool],
    text: str,
) -> Rule:
    """Return the rule that fields are never so; the text, with their values, says what is wrong."""

    def finding(*values: object) -> str | None:
        return text.format(*values) if are(*values) else None

    return Rule(fields, finding)


def below(low: str, high: str, *, or_equal: bool = False) -> Rule:
    """Return the rule that a field is less than another, or at most that."""
    allowed = "at most" if or_equal else "less than"
    return never(
        (low, high),
        lambda one, other: one > other or (one == other and not or_equal),
        f"{low}: got {{0}}; allowed: {allowed} {high} = {{1}}",
    )


def one_of(one: str, other: str, allowed: str) -> Rule:
    """Return the rule that one of two fields is stated, and not both."""

    def finding(first: object, second: object) -> str | None:
        if first is None and second is None:
            return f"{one}: missing; allowed: {allowed}"
        both = first is not None and second is not None
        return f"{one}: got {other} too; allowed: one of them" if both else None

    return Rule((one, other), finding)


class Ratio(NamedTuple):
    """A number to draw in place of a field whose range would depend on another field."""

    field: str  # the ratio times the other one, so it keeps all rules that read it
    of: str  # the other one
    allows: Callable[[float], bool]  # tells whether a number is allowed
    allowed: str  # the same in words


def ordered(ends: tuple[float, float]) -> tuple[float, float]:
    """Return a range; refuse it if its ends are exchanged, or too far apart to draw between."""
    low, high = ends
    if low <= high and high - low <= LARGEST:
        return ends
    allowed = "[low, high] with low <= high"
    if low <= high:
        allowed = f"high - low of at most {LARGEST:.3g}, the largest number"
    raise PydanticCustomError(RANGE, f"got [{low}, {high}]; allowed: {allowed}")  # pyright: ignore[reportArgumentType] - a literal for its type checker only


def is_known(names: Iterable[str], wrong: frozenset[str]) -> bool:
    """Tell whether none of some dotted names is wrong, or belongs to what is."""
    return not any(
        name == other or name.startswith(f"{other}.") for name in names for other in wrong
    )


def is_whole(names: Iterable[str], wrong: frozenset[str]) -> bool:
    """Tell whether some dotted names are known, and so is everything that belongs to them."""
    names = tuple(names)
    return is_known(names, wrong) and is_known(wrong, frozenset(names))


FIELDS_ONLY = {"rules": False}  # context of a validation that leaves out the rules across fields


class Part(BaseModel):
    """A frozen part of a scene: strict numbers, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
    rules: ClassVar[tuple[Rule, ...]] = ()
    ratios: ClassVar[dict[str, Ratio]] = {}

    def __init__(self, /, **data: object) -> None:
        try:
            self.__pydantic_validator__.validate_python(data, self_instance=self)
        except ValidationError as error:
            raise SceneError(report(type(self), error)) from None

    # Without this mark pydantic would call __init__ for each nested part, and the first finding
    # would hide all others.
    __init__.__pydantic_base_init__ = True  # pyright: ignore[reportFunctionMemberAccess]

    @model_validator(mode="after")
    def _keeps_rules(self, info: ValidationInfo) -> Self:
        findings = [] if info.context == FIELDS_ONLY else self.findings()
        if findings:
            raise ValueError("\n".join(findings))
        return self

    def findings(self, wrong: frozenset[str] = frozenset(), prefix: str = "") -> list[str]:
        """Return what is wrong across the part's fields, each as "field: text".

        Rules that read wrong fields are left out; their dotted names begin with the prefix.
        """
        texts = [
            rule.finding(*map(self.value_of, rule.fields))
            for rule in self.rules
            if is_known((prefix + name for name in rule.fields), wrong)
        ]
        return [text for text in texts if text is not None]

    def value_of(self, name: str) -> Any:  # noqa: ANN401 - of any field
        """Return the value of a dotted name, or None where there is none."""
        value = self
        for word in name.split("."):
            value = getattr(value, word, None)
        return value

    def findings_with(self, field: str, value: float) -> list[str]:
        """Return what is wrong with another value of a field or ratio, other fields aside.

        The field may be an entry of a table: "noise.carriage_velocity".
        """
        if field in self.ratios:
            ratio = self.ratios[field]
            return [] if ratio.allows(value) else [f"got {value}; allowed: {ratio.allowed}"]
        data = holder = self.model_dump()
        *path, last = field.split(".")
        for word in path:
            holder = holder[word]
        holder[last] = value
        try:
            self.__pydantic_validator__.validate_python(data, context=FIELDS_ONLY)
        except ValidationError as error:
            lines = report(type(self), error).splitlines()
            return [line.removeprefix(f"{field}: ") for line in lines]
        return []


class Document(Part):
    """A part that a file holds by itself."""

    @classmethod
    def of(cls, data: Mapping[str, object]) -> Self:
        """Return the part that the data describes; raise `SceneError` with every finding."""
        if not isinstance(data, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
            refuse(cls.__name__, f"{data!r:.60}", "a dictionary of its fields")
        return cls(**data)


def listed(value: object) -> object:
    """Return a list as a tuple, because files have lists; refuse sets, which have no order."""
    return tuple(cast("list[object]", value)) if isinstance(value, list) else value


def report(model: type[Part], error: ValidationError) -> str:
    """Return one line for each finding: field, value, allowed values."""
    lines: dict[str, str] = {}
    findings = error.errors()
    places = [finding["loc"] for finding in findings]
    for finding in findings:
        place = finding["loc"]
        if finding["type"] == "too_short" and any(p[:-1] == place for p in places if p != place):
            continue  # it is short because its entries were refused, which is reported already
        names, owner = located(model, place)
        where, text = dotted_name(names), _explain(finding, owner)
        if finding["type"] == "value_error":  # of rules, one a line
            for line in text.splitlines():
                line = f"{where}.{line}" if where else line  # noqa: PLW2901
                lines[line] = line
        # "A number or a range" gives one finding for each alternative; the first one is enough,
        # unless the second one took it for a range.
        elif where not in lines or finding["type"] == RANGE:
            lines[where] = f"{where}: {text}" if where else text
    return "\n".join(lines.values())


def _explain(finding: ErrorDetails, owner: type[Part] | None) -> str:
    kind, got, context = finding["type"], finding["input"], finding.get("ctx", {})
    if kind == "extra_forbidden":
        allowed = list(owner.model_fields) if owner else []
        nearest = suggest(str(finding["loc"][-1]), allowed)
        return f"unknown key{nearest}; allowed: {', '.join(allowed)}"
    if kind in ("value_error", RANGE):
        return str(finding["msg"]).removeprefix("Value error, ")
    if kind == "union_tag_invalid":
        allowed = [tag.strip("' ") for tag in str(context["expected_tags"]).split(",")]
        tag = str(context["tag"])
        return f"unknown kind {tag!r}{suggest(tag, allowed)}; allowed: {', '.join(allowed)}"
    if kind in MISSING:
        return MISSING[kind]
    nearest = ""
    if kind == "literal_error" and isinstance(got, str):
        options = str(context["expected"]).split("'")
        nearest = suggest(got, [option for option in options if option.isidentifier()])
    takes_range = finding["loc"][-1] == "float"
    allowed = "a finite number or [low, high]" if takes_range else _allowed(finding)
    return f"got {_shown(got)}{nearest}; allowed: {allowed}"


def _shown(value: object) -> str:
    try:
        return reprlib.repr(value)
    except ValueError:  # Python refuses to write integers of more than some thousand digits
        return f"a number of type {type(value).__name__}"


MISSING = {"missing": "missing", "union_tag_not_found": "'kind' is missing"}
"""Texts about missing fields."""


def _allowed(finding: ErrorDetails) -> str:
    context = finding.get("ctx", {})
    if finding["type"] == "too_short":
        return f"at least {context['min_length']} entries"
    if finding["type"] == "too_long":
        return f"at most {context['max_length']} entries"
    text = str(finding["msg"]).removeprefix("Input should be ")
    # Words of a file instead of Python's types.
    for python, plain in (("valid tuple", "list"), ("a valid integer", "an integer")):
        text = text.replace(python, plain)
    return text.replace("valid ", "")


def located(
    model: type[Part], location: tuple[int | str, ...]
) -> tuple[list[str], type[Part] | None]:
    """Return the names that lead to a finding, and the part that holds it.

    pydantic's labels of alternatives are left out: the tag of a kind, and everything behind a field
    that takes a number or a range.
    """
    names: list[str] = []
    present: list[type[Part]] = [model]
    owner: type[Part] | None = model
    keyed = False  # inside a dictionary, where every key is a name
    for depth, item in enumerate(location):
        owners = [part for part in present if item in part.model_fields]
        if owners:
            owner, annotation = owners[0], owners[0].model_fields[str(item)].annotation
            names.append(str(item))
            present, keyed = list(parts_of(annotation)), get_origin(annotation) is dict
        elif isinstance(item, int) or keyed:
            names.append(str(item))
            keyed = False
        elif len(present) > 1 and (tagged := [one for one in present if _tag(one) == item]):
            present, owner = tagged, tagged[0]
        elif present and depth == len(location) - 1:
            owner = present[0]
            names.append(item)
        else:
            break
    return names, owner


def dotted_name(names: Iterable[str]) -> str:
    """Return names joined by dots, on one line whatever they hold."""
    return ".".join(name if name and name.isprintable() else ascii(name) for name in names)


def _tag(part: type[Part]) -> str | None:
    field = part.model_fields.get("kind")
    return None if field is None else field.default


def parts_of(annotation: object) -> Iterator[type[Part]]:
    """Yield the parts that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, Part):
        yield annotation
    for argument in get_args(annotation):
        yield from parts_of(argument)


Data: TypeAlias = "dict[str, Data] | list[Data] | str | float | bool | None"
"""A part as plain data, as in a file."""

KIND = "kind"


def put(data: dict[str, Data], changes: Mapping[str, object]) -> None:
    """Set the entries of plain data that dotted names refer to.

    A table that is not there is made, and a name is not checked, as if a file said it. A part whose
    kind changes keeps none of its other entries.
    """
    kinds_first = sorted(changes.items(), key=lambda change: change[0].rpartition(".")[2] != KIND)
    for name, given in kinds_first:
        value = plain(given)
        first, dot, rest = name.partition(".")  # those drawn are named as a whole
        words = [first, rest] if dot and first == "randomization" else name.split(".")
        *path, last = words
        holder = _table(data, path, name)
        if last == KIND and isinstance(holder, dict) and holder.get(KIND) != value:
            holder.clear()
        if isinstance(holder, list):
            holder[_index(holder, last, name)] = value
        else:
            holder[last] = value


DEEPEST = 5  # levels of data that are copied; a scene has fewer


def plain(value: object, depth: int = 0) -> Data:
    """Return a value as JSON and TOML have it: parts as tables, tuples and arrays as lists."""
    if isinstance(value, Part):
        return cast("Data", value.model_dump(mode="json"))
    if isinstance(value, np.ndarray | np.generic):
        return cast("Data", cast("NDArray[np.generic]", value).tolist())
    if isinstance(value, dict) and depth < DEEPEST:
        items = cast("dict[str, object]", value).items()
        return {name: plain(entry, depth + 1) for name, entry in items}
    if isinstance(value, list | tuple) and depth < DEEPEST:
        return [plain(entry, depth + 1) for entry in cast("list[object]", value)]
    return cast("Data", value)


def _table(data: dict[str, Data], path: list[str], name: str) -> dict[str, Data] | list[Data]:
    """Return the table or list at the end of a path, made if there is none."""
    holder: dict[str, Data] | list[Data] = data
    for word in path:
        if isinstance(holder, list):
            index = _index(holder, word, name)
            inner = holder[index] = _opened(holder[index])
        else:
            inner = holder[word] = _opened(holder.get(word))
        holder = inner
    return holder


def _opened(entry: Data) -> dict[str, Data] | list[Data]:
    return entry if isinstance(entry, dict | list) else {}


def _index(entries: list[Data], word: str, name: str) -> int:
    if word.isascii() and word.isdecimal() and int(word) < len(entries):
        return int(word)
    allowed = f"0 to {len(entries) - 1}" if entries else "none, the list is empty"
    msg = f"{name}: there is no entry {word!r}; allowed: {allowed}"
    raise SceneError(msg)
