"""What a caller says of a file: the unit, and where in it the samples are."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import NoReturn, TypeAlias

from mm_gym.arrays import Array
from mm_gym.errors import check_name, refuse, suggest, whole_number

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

FORCE_UNITS = {"N": 1.0, "kN": 1000.0, "lbf": 4.4482216152605}  # unit of force -> its size [N]

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
    rf"{LENGTH}(?:/{SECOND}(?:/{SECOND}|\*{SECOND}|\^?2|\*\*2|\xb2|\ufffd)"
    rf"|[ .*\xb7\u22c5]?{SECOND}\^?[-\u207b\u2212][2\xb2])(?![A-Z0-9])"
)
"""An acceleration in any of the usual spellings, such as CM/SEC/SEC; group 1 is the length.
A raised 2 in another encoding than UTF-8 is read as U+FFFD."""

STATED = re.compile(
    r"\bUNITS?\b ?(OF|ARE|IS|IN|:|=)? ?(?:OF|ARE|IS|IN|:|=)? ?[(\[]? ?([^ ,;:=()\[\]]+)"
)
"""UNITS OF G, UNITS: G, UNITS = G, the units are (G)."""

OTHERS = (
    re.compile(r"[(\[] ?(?:IN )?([A-Z']+) ?[)\]]"),
    re.compile(r"\bIN (G|G'S|GALS?)(?![\w/])"),
)
"""(G), [GAL], IN G."""

UNKNOWN = re.compile(
    rf"[(\[] ?(?:IN )?((?:MILLI|MICRO|M|U|\u039c|%)[ -]?G|{LENGTH}/{SECOND}) ?[)\]]"
)
"""(MG), [M/S]: a fraction of g, or a velocity."""

TIMES = re.compile(
    r"(?<![A-Z])(?:TIMES?|T) ?(?:[(\[/_] ?|IN )"
    r"(MS|MSEC|MILLISECONDS|US|\u039cS|MICROSECONDS|MIN|MINUTES|H|HOURS)(?![A-Z0-9])"
)
"""TIME (MS), T IN MIN: times that are not in seconds."""

LONGEST_LINE = 2000  # characters of a header's line that are looked at


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


def other_times(line: str) -> str | None:
    """Return how a heading states times that are not in seconds, in words, or None."""
    found = TIMES.search(_words(line))
    return f"the header states times in {found[1]}; allowed: s" if found else None


def _words(line: str) -> str:
    return " ".join(line[:LONGEST_LINE].upper().split())


def _stated(line: str) -> Iterator[tuple[str, str | None]]:
    """Return each unit that a line states as it is written there, and its name, if it has one."""
    words = re.sub(r" ?([/^]) ?", r"\1", _words(line))
    for found in ACCELERATION.finditer(words):
        yield found[0], SPELLINGS[found[1]]
    for found in STATED.finditer(words):
        text = found[2].rstrip(".")
        unit = SPELLINGS.get(text) if text in SPELLINGS and not _is_length(text) else None
        if unit is not None or (found[1] and not ACCELERATION.search(found[0])):
            yield text, unit
    for found in UNKNOWN.finditer(words):
        yield found[1], None
    for pattern in OTHERS:
        for found in pattern.finditer(words):
            if found[1] in SPELLINGS and not _is_length(found[1]):
                yield found[1], SPELLINGS[found[1]]


def _is_length(text: str) -> bool:
    return SPELLINGS[text].endswith("/s^2")


LARGEST = 1e12  # largest magnitude of a number in a file; larger numbers mark missing samples
Samples: TypeAlias = tuple[Array, Array, float]
"""Instants [s], samples in a file's unit, and their least spacing [s]."""

SHORTEST = 1e-9  # shortest spacing of samples [s]
MOST_COLUMNS = 1000  # columns of a file, at most
MOST_LINES = 2**24  # of a file, which has at most 16 MiB


@dataclass(frozen=True)
class Options:
    """The options of `mm_gym.records.read_record`, which documents them.

    Attributes
    ----------
    usual
        Unit of a file without a unit, unless it is in PEER's format; by default it is refused.
    """

    unit: str | None = None
    time_step: float | None = None
    column: int | str | None = None
    skip: int = 0
    variable: str | None = None
    usual: str | None = None

    def check(self) -> None:
        """Raise `SceneError` for an option that no file could have."""
        if self.unit is not None:
            check_name("unit", self.unit, UNITS)
        is_step = isinstance(self.time_step, Real) and SHORTEST <= self.time_step <= LARGEST
        if isinstance(self.time_step, bool) or not (self.time_step is None or is_step):
            refuse("time_step", f"{self.time_step!r}", f"{SHORTEST:g} to {LARGEST:g} s")
        whole_number("skip", self.skip, 0, MOST_LINES)
        is_number = type(self.column) is int and 1 <= self.column <= MOST_COLUMNS
        if not (self.column is None or is_number or (isinstance(self.column, str) and self.column)):
            refuse("column", f"{self.column!r}", f"a number from 1 to {MOST_COLUMNS}, or a name")
        if not (self.variable is None or (isinstance(self.variable, str) and self.variable)):
            refuse("variable", f"{self.variable!r}", "the name of a variable")

    def places(
        self, columns: int, names: Sequence[str], refuse: Callable[[str], NoReturn]
    ) -> tuple[int, ...]:
        """Return the columns that are read, from 0: (times, samples), or (samples,).

        The names are those of the columns if the file states them; `refuse` raises `SceneError` for
        a text, with the file and the place in it.
        """
        if columns > MOST_COLUMNS:
            refuse(f"got {columns} columns; allowed: at most {MOST_COLUMNS}")
        if self.column is None:
            if columns > 2:  # noqa: PLR2004 - time and sample
                named = f" ({', '.join(names)})" if names else ""
                refuse(
                    f"got {columns} columns{named}; allowed: one, or two with the times first. Set "
                    "column to the number or the name of the one with the samples"
                )
            place = columns - 1
        else:
            place = self._place(columns, names, refuse)
        if self.time_step is not None:
            if columns > 1 and self.column is None:
                refuse(
                    "the file states times, so time_step has no effect; set column too if it "
                    "states none"
                )
            return (place,)
        if columns == 1:
            refuse("a file with one column states no times; set time_step")
        if place == 0:
            refuse("column 1 has the times; allowed: 2 or more, or 1 with time_step")
        return 0, place

    def _place(self, columns: int, names: Sequence[str], refuse: Callable[[str], NoReturn]) -> int:
        if isinstance(self.column, int):
            if self.column > columns:
                refuse(f"column: got {self.column}; allowed: 1 to {columns}")
            return self.column - 1
        column = str(self.column)
        if names.count(column) == 1:
            return names.index(column)
        if column in names:
            refuse(f"column: got {column!r}, the name of several; allowed: 1 to {columns}")
        allowed = f"1 to {columns}"
        if names:
            allowed += f", {', '.join(map(repr, names))}"
        else:
            allowed += "; no line above the samples names as many columns"
        return refuse(f"column: got {column!r}{suggest(column, names)}; allowed: {allowed}")
