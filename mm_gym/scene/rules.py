"""Rules across fields, and ratios to draw that keep them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

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
