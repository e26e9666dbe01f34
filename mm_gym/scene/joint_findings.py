"""Rules across fields over the ranges that values are drawn from."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

from mm_gym.scene.rules import is_known

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from mm_gym.scene.part import Part


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
