"""What a caller says of a file: its unit, and where in it the samples are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

from mm_gym.errors import SceneError, suggest
from mm_gym.records.numbers import LARGEST
from mm_gym.records.units import UNITS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

SHORTEST = 1e-9
"""Shortest spacing of samples [s]."""

MOST_COLUMNS = 1000
"""Columns of a file, at most."""


@dataclass(frozen=True)
class Options:
    """The options of `mm_gym.records.read_record`, which documents them."""

    unit: str | None = None
    time_step: float | None = None
    column: int | str | None = None
    skip: int = 0
    variable: str | None = None

    def check(self) -> None:
        """Raise `SceneError` for an option that no file could have."""
        if self.unit is not None and self.unit not in UNITS:
            nearest = suggest(str(self.unit), UNITS)
            _refuse("unit", self.unit, f"{', '.join(UNITS)}", nearest)
        if self.time_step is not None and not SHORTEST <= self.time_step <= LARGEST:
            msg = f"time_step: got {self.time_step}; allowed: {SHORTEST:g} to {LARGEST:g} s"
            raise SceneError(msg)
        if type(self.skip) is not int or self.skip < 0:
            _refuse("skip", self.skip, "a number of lines, 0 or more")
        is_number = type(self.column) is int and 1 <= self.column <= MOST_COLUMNS
        if not (self.column is None or is_number or (isinstance(self.column, str) and self.column)):
            _refuse("column", self.column, f"a number from 1 to {MOST_COLUMNS}, or a name")
        if not (self.variable is None or (isinstance(self.variable, str) and self.variable)):
            _refuse("variable", self.variable, "the name of a variable")

    def places(
        self, columns: int, names: Sequence[str], refuse: Callable[[str], NoReturn]
    ) -> tuple[int, ...]:
        """Return the columns that are read, from 0: (times, samples), or (samples,).

        Parameters
        ----------
        columns
            Number of columns in the file.
        names
            Their names, if the file states them.
        refuse
            Raises `SceneError` for a text, with the file and the place in it.
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


def _refuse(name: str, got: object, allowed: str, nearest: str = "") -> NoReturn:
    msg = f"{name}: got {got!r}{nearest}; allowed: {allowed}"
    raise SceneError(msg)
