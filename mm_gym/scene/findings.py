"""What is known of a part that has wrong fields, and findings over the ranges of what is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from itertools import product
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from mm_gym.scene.part import FIELDS_ONLY, Part, dotted_name, is_known, located, plain

P = TypeVar("P", bound=Part)

ROUNDS = 10
"""Most rounds of mending: a mended kind may show wrong fields that were not looked at before."""

STANDS_IN = {"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}
"""Values in place of wrong ones without a default; all others are 1."""


def draft_of(model: type[P], data: Mapping[str, object]) -> tuple[P, frozenset[str]] | None:
    """Return the data with values that are allowed in place of wrong ones, and the wrong ones.

    These are the dotted names of what was wrong or missing. The rules across fields are not
    checked. None is returned if too much is wrong.
    """
    mended, wrong = cast("dict[str, Any]", plain(data)), set[str]()
    for _ in range(ROUNDS):
        try:
            part = model.model_validate(mended, context=FIELDS_ONLY)
        except ValidationError as error:
            for finding in error.errors():
                names, owner = located(model, finding["loc"])
                wrong.add(_mend(mended, names, owner, finding["type"]))
        else:
            return part, frozenset(wrong)
    return None


def findings_of(part: Part, wrong: frozenset[str], prefix: str = "") -> Iterator[str]:
    """Yield what is wrong across the fields of a part and of all parts in it."""
    for name, value in part:
        inner: dict[str, object] = {name: value}
        if isinstance(value, tuple):
            inner = {f"{name}.{k}": one for k, one in enumerate(cast("tuple[object, ...]", value))}
        for place, child in inner.items():
            if isinstance(child, Part):
                yield from findings_of(child, wrong, f"{prefix}{place}.")
    for text in part.findings(wrong, prefix):
        yield prefix + text


def _mend(data: dict[str, Any], names: list[str], owner: type[Part] | None, kind: str) -> str:
    """Replace what is wrong in the data and return its dotted name."""
    if names[0] == "randomization" and len(names) > 1:
        data["randomization"].pop(names[1], None)
        return dotted_name(names[:2])
    holder, depth = _holder(data, names)
    name = names[depth]
    if kind == "extra_forbidden":
        holder.pop(name, None)
        # It may stand for a field whose name is misspelt.
        nearest = get_close_matches(name, owner.model_fields if owner else (), n=1)
        return dotted_name([*names[:depth], *(nearest or [name])])
    if isinstance(holder, list):
        holder[int(name)] = dict(STANDS_IN)
    elif owner and name in owner.model_fields and owner.model_fields[name].is_required():
        holder[name] = STANDS_IN.get(name, 1.0)
    else:
        holder.pop(name, None)
    return dotted_name(names[: depth + 1])


def _holder(data: dict[str, Any], names: list[str]) -> tuple[Any, int]:
    """Return the deepest table that holds one of the names, or the excitation, and which name."""
    holder, depth = data, 0
    while depth < len(names) - 1:
        inner: Any = holder.get(names[depth])
        if isinstance(inner, list) and names[depth] == "excitation":
            entries = cast("list[Any]", inner)
            depth += 1
            if depth == len(names) - 1:
                return entries, depth
            inner = entries[int(names[depth])]
        if not isinstance(inner, dict):  # a wrong entry makes any other list wrong as a whole
            break
        holder, depth = cast("dict[str, Any]", inner), depth + 1
    return holder, depth


def joint_findings(
    name: str,
    part: Part,
    ranges: Mapping[str, tuple[float, float]],
    wrong: frozenset[str] = frozenset(),
) -> Iterator[str]:
    """Yield what is wrong across a part's fields somewhere in the ranges that they are drawn from.

    The part has a value for each field. What is not known is left out: dotted names in `wrong`.
    """
    given = {part.ratios[field].field for field in ranges if field in part.ratios}
    for field in given.intersection(ranges):
        yield f"randomization.{name}.{field}: has no effect: it follows from a ratio drawn too"
    for rule in part.rules:
        drawn = [field for field in rule.fields if field in ranges]
        names = [f"{name}.{field}" for field in rule.fields]
        names += [f"randomization.{each}" for each in names]
        if given.intersection(rule.fields) or not is_known(names, wrong):
            continue
        stated = {field: part.value_of(field) for field in rule.fields}
        if not drawn or rule.finding(*stated.values()) is not None:
            continue
        ends = [ranges.get(field, (value,)) for field, value in stated.items()]
        texts = (rule.finding(*corner) for corner in product(*ends))
        text = next((text for text in texts if text is not None), None)
        if text is not None:
            if text.partition(": ")[0] not in drawn:
                text = f"{drawn[0]}: {name}.{text}"
            yield f"randomization.{name}.{text}{_advice(name, part, drawn)}"


def _advice(name: str, part: Part, drawn: list[str]) -> str:
    """Say how to draw fields that depend on one another."""
    for ratio, (field, of, *_) in part.ratios.items():
        if field in drawn and of in drawn:
            return f", which is drawn too; draw {name}.{ratio} in place of {name}.{field}"
    return ""
