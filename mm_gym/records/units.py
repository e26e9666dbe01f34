"""Units of recorded motions, and the statements of units in the headers of files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

ACCELERATION_UNITS = {
    "m/s^2": 1.0,
    "cm/s^2": 0.01,
    "gal": 0.01,
    "mm/s^2": 0.001,
    "g": 9.80665,
    "ft/s^2": 0.3048,
    "in/s^2": 0.0254,
}
"""Unit of acceleration -> its size [m/s^2]; g is the standard acceleration of ISO 80000-3."""

FORCE_UNITS = {"N": 1.0, "kN": 1000.0, "lbf": 4.4482216152605}
"""Unit of force -> its size [N]."""

UNITS = ACCELERATION_UNITS | FORCE_UNITS

SPELLINGS = (
    {"G": "g", "GS": "g", "G'S": "g", "GRAVITY": "g", "GAL": "gal", "GALS": "gal"}
    | {"KN": "kN", "LBF": "lbf", "N": "N", "NEWTON": "N", "NEWTONS": "N"}
    | {"MM": "mm/s^2", "CM": "cm/s^2", "M": "m/s^2", "FT": "ft/s^2", "FEET": "ft/s^2"}
    | {"IN": "in/s^2", "INCH": "in/s^2", "INCHES": "in/s^2"}
)
"""Spelling of a unit, or of the length in a unit of acceleration, in capitals -> the unit."""

LENGTH = r"(?<![A-Z0-9/.])(MM|CM|M|FT|FEET|IN|INCH|INCHES)"
SECOND = r"(?:SECONDS|SECOND|SEC|S)"
ACCELERATION = re.compile(
    rf"{LENGTH}(?:/{SECOND}(?:/{SECOND}|\*{SECOND}|\^?2|\*\*2|\xb2)|[ .*]?{SECOND}\^?-2)"
    r"(?![A-Z0-9])"
)
"""An acceleration in any of the usual spellings, such as CM/SEC/SEC; group 1 is the length."""

STATED = re.compile(
    r"\bUNITS?\b ?(OF|ARE|IS|IN|:|=)? ?(?:OF|ARE|IS|IN|:|=)? ?[(\[]? ?([^ ,;:=()\[\]]+)"
)
"""UNITS OF G, UNITS: G, UNITS = G, the units are (G)."""

OTHERS = (
    re.compile(r"[(\[] ?(?:IN )?([A-Z']+) ?[)\]]"),
    re.compile(r"\bIN (G|G'S|GALS?)(?![\w/])"),
)
"""(G), [GAL], IN G."""

LONGEST_LINE = 2000
"""Characters of a header's line that are looked at."""


def contradiction(line: str, unit: str) -> str | None:
    """Return how a header's line contradicts a unit, in words, or None if it does not.

    A force in newtons is looked for only where a force is expected: elsewhere N is the north.
    """
    for quantity in ("velocity", "displacement"):
        if f"{quantity} time" in line.lower():
            return f"the header states a {quantity}; allowed: an acceleration"
    for text, stated in _stated(line):
        both = f"the header states units of {text[:20]}; got unit = {unit!r}"
        if stated is None:
            if unit == "g":  # what a file of this kind has if it states nothing
                return both
        elif (stated in FORCE_UNITS) != (unit in FORCE_UNITS):
            if stated != "N":
                return both
        elif UNITS[stated] != UNITS[unit]:
            return f"{both}; set unit = {stated!r}"
    return None


def _stated(line: str) -> Iterator[tuple[str, str | None]]:
    """Return each unit that a line states as it is written there, and its name, if it has one."""
    words = " ".join(line[:LONGEST_LINE].upper().split())
    words = re.sub(r" ?([/^]) ?", r"\1", words)
    for found in ACCELERATION.finditer(words):
        yield found[0], SPELLINGS[found[1]]
    for found in STATED.finditer(words):
        text = found[2].rstrip(".")
        unit = SPELLINGS.get(text) if text in SPELLINGS and not _is_length(text) else None
        if unit is not None or (found[1] and not ACCELERATION.search(found[0])):
            yield text, unit
    for pattern in OTHERS:
        for found in pattern.finditer(words):
            if found[1] in SPELLINGS and not _is_length(found[1]):
                yield found[1], SPELLINGS[found[1]]


def _is_length(text: str) -> bool:
    return SPELLINGS[text].endswith("/s^2")
