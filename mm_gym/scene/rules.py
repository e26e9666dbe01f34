"""Rules across fields, over single values and over ranges of them."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from mm_gym.scene.part import Part

RANGE = "range"
"""Type of the errors that `ordered` raises."""

LARGEST = 1.7976931348623157e308
"""The largest double."""


class Rule(NamedTuple):
    """A rule across fields of a part.

    A rule that holds at all ends of its fields' ranges must hold in between.

    Attributes
    ----------
    fields
        Names of the fields that it reads.
    finding
        Their values -> what is wrong, as "field: text", or None.
    """

    fields: tuple[str, ...]
    finding: Callable[..., str | None]


class Ratio(NamedTuple):
    """A number to draw in place of a field whose range would depend on another field.

    Attributes
    ----------
    field, of
        The field is the ratio times the other one, and so keeps all rules that read it.
    allows
        Tells whether a number is allowed.
    allowed
        The same in words.
    """

    field: str
    of: str
    allows: Callable[[float], bool]
    allowed: str


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


def joint_findings(
    name: str,
    part: Part,
    ranges: Mapping[str, tuple[float, float]],
    wrong: frozenset[str] = frozenset(),
) -> Iterator[str]:
    """Yield what is wrong across a part's fields somewhere in their ranges.

    Parameters
    ----------
    name
        Dotted name of the part.
    part
        The part, with a value for each field.
    ranges
        Field -> range of the values that are drawn in its place.
    wrong
        Dotted names of fields and ranges whose values are not known.
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
        stated = [getattr(part, field) for field in rule.fields]
        if not drawn or rule.finding(*stated) is not None:
            continue
        ends = [
            ranges.get(field, (value,)) for field, value in zip(rule.fields, stated, strict=True)
        ]
        texts = (rule.finding(*corner) for corner in product(*ends))
        text = next((text for text in texts if text is not None), None)
        if text is not None:
            yield _named(name, text, drawn) + _advice(name, part, drawn)


def _named(name: str, text: str, drawn: list[str]) -> str:
    """Return a finding under the name of a field that is drawn."""
    field = text.partition(": ")[0]
    if field in drawn:
        return f"randomization.{name}.{text}"
    return f"randomization.{name}.{drawn[0]}: {name}.{text}"


def _advice(name: str, part: Part, drawn: list[str]) -> str:
    """Say how to draw fields that depend on one another."""
    for ratio, (field, of, *_) in part.ratios.items():
        if field in drawn and of in drawn:
            return f", which is drawn too; draw {name}.{ratio} in place of {name}.{field}"
    return ""
