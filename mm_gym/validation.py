"""The base of every part of a scene, and how its findings become one `SceneError`."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from mm_gym.errors import SceneError, suggest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pydantic_core import ErrorDetails


class Part(BaseModel):
    """A frozen piece of a scene: strict numbers, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    def __init__(self, **data: object) -> None:
        try:
            self.__pydantic_validator__.validate_python(data, self_instance=self)
        except ValidationError as error:
            raise SceneError(report(type(self), error)) from None

    # Without this mark pydantic calls __init__ for each nested part and the first finding would hide all others.
    __init__.__pydantic_base_init__ = True  # pyright: ignore[reportFunctionMemberAccess]


def report(model: type[Part], error: ValidationError) -> str:
    """Return one line per finding: where, what, got, allowed."""
    lines: dict[str, str] = {}
    for finding in error.errors():
        where, owner = _locate(model, finding["loc"])
        # A field that takes a number or a range reports once per alternative; the first says enough.
        lines.setdefault(where, _explain(finding, owner))
    return "\n".join(f"{where}: {text}" if where else text for where, text in lines.items())


def _explain(finding: ErrorDetails, owner: type[Part] | None) -> str:
    kind, got = finding["type"], finding["input"]
    if kind == "extra_forbidden":
        allowed = list(owner.model_fields) if owner else []
        return (
            f"unknown key{suggest(str(finding['loc'][-1]), allowed)}; allowed: {', '.join(allowed)}"
        )
    if kind == "missing":
        return "missing"
    if kind == "union_tag_not_found":
        return "'kind' is missing"
    if kind == "value_error":
        return str(finding["msg"]).removeprefix("Value error, ")
    if kind == "union_tag_invalid":
        context = finding.get("ctx", {})
        allowed = [tag.strip("' ") for tag in str(context["expected_tags"]).split(",")]
        return f"unknown kind {context['tag']!r}{suggest(str(context['tag']), allowed)}; allowed: {', '.join(allowed)}"
    allowed = str(finding["msg"]).removeprefix("Input should be ").replace("valid number", "number")
    if kind == "literal_error" and isinstance(got, str):
        options = [
            option
            for option in str(finding.get("ctx", {}).get("expected", "")).split("'")
            if option.isidentifier()
        ]
        return f"got {got!r}{suggest(got, options)}; allowed: {allowed}"
    return f"got {got!r}; allowed: {allowed}"


def _locate(model: type[Part], location: tuple[int | str, ...]) -> tuple[str, type[Part] | None]:
    """Return the dotted name of a finding, without pydantic's labels of alternatives, and the part it lies in."""
    names: list[str] = []
    present: list[type[Part]] = [model]
    owner: type[Part] | None = model
    for depth, item in enumerate(location):
        field = next(
            (part.model_fields[str(item)] for part in present if item in part.model_fields), None
        )
        if field is not None:
            owner = next(part for part in present if item in part.model_fields)
            names.append(str(item))
            present = list(_parts_of(field.annotation))
        elif isinstance(item, int):
            names.append(str(item))
        elif tagged := [part for part in present if _tag(part) == item]:
            present, owner = tagged, tagged[0]
        elif depth == len(location) - 1 and present:
            owner = present[0]
            names.append(str(item))
    return ".".join(names), owner


def _tag(part: type[Part]) -> str | None:
    field = part.model_fields.get("kind")
    return None if field is None else field.default


def _parts_of(annotation: object) -> Iterator[type[Part]]:
    if isinstance(annotation, type) and issubclass(annotation, Part):
        yield annotation
    for argument in get_args(annotation):
        yield from _parts_of(argument)
