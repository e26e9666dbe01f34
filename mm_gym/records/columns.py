"""Text in columns: samples alone, or times and samples, and columns that are not read."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.records.numbers import NUMERIC, floats, pointed, table
from mm_gym.records.text import (
    blocks,
    check_times,
    check_unit,
    evenly,
    refuse,
    values_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from mm_gym.records.options import Options

    Block = tuple[int, str]

MOST_HEADINGS = 1000
"""Lines before the first sample, at most."""


class Form(NamedTuple):
    """How the lines of samples are written.

    Attributes
    ----------
    separator
        Of the columns: a semicolon, a comma, or None for tabs and blanks.
    columns
        Their number.
    places
        Those that are read, from 0.
    mark
        Decimal mark.
    """

    separator: str | None
    columns: int
    places: tuple[int, ...]
    mark: str


def read_columns(
    file: Path, text: str, unit: str, options: Options
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the instants [s], the samples in the file's unit, and their least spacing [s]."""
    headings, start, number = _headings(file, text, options.skip)
    first = _line(text, start).partition("#")[0].strip()
    separator = next((mark for mark in ";," if mark in first), None)
    columns = len(first.split(separator))
    named = {n: cells for n, line in headings if (cells := _names(line, separator, columns))}
    names = _matching(named, options.column)
    places = options.places(columns, names, lambda words: refuse(file, number, words))
    for n, line in headings:
        own = columns > 2 and n in named and (_is_split(line) or named[n] is names)  # noqa: PLR2004
        check_unit(file, [(n, named[n][places[-1]] if own else line)], unit)
    pieces = list(blocks(file, text, start, number))
    form = Form(separator, columns, places, _decimal_mark(pieces, separator, places))
    fitting = table(separator, columns, form.mark)
    rows = [_cells(file, block, fitting, form) for block in pieces]
    values = np.concatenate(rows)
    if len(places) == 1:
        step = options.time_step or 0.0  # `places` has asked for it
        return evenly(len(values), step), values[:, 0], step

    def where(row: int) -> str:
        ends = np.cumsum([len(part) for part in rows])
        k = int(np.searchsorted(ends, row, side="right"))
        line = _texts(*pieces[k])[1][row - (int(ends[k - 1]) if k else 0)]
        return f"{file}:{line}: column 1"

    times, values = values.T.copy()
    check_times(times, where)
    return times, values, float(np.min(np.diff(times), initial=np.inf))


def _headings(file: Path, text: str, skip: int) -> tuple[list[Block], int, int]:
    """Return the lines before the first number, where in the text that line begins, and its number.

    The lines that are skipped are not among them.
    """
    headings: list[Block] = []
    start = 0
    for number in range(1, skip + MOST_HEADINGS + 2):
        if number > skip:
            line = _line(text, start)
            words = re.split(
                r"[,;\t]" if _is_split(line) else r"\s+", line.partition("#")[0].strip()
            )
            if any(NUMERIC.match(word.strip()) for word in words):
                return headings, start, number
            headings.append((number, line))
        start = text.find("\n", start) + 1
        if start == 0:
            if number <= skip:
                refuse(file, None, f"skip: got {skip}; the file has {number} lines")
            refuse(file, None, "the file holds no samples")
    return refuse(file, None, f"the first {skip + MOST_HEADINGS} lines hold no samples")


def _line(text: str, start: int) -> str:
    end = text.find("\n", start)
    return text[start:] if end < 0 else text[start:end]


def _is_split(line: str) -> bool:
    """Tell whether more than blanks separates the words of a heading."""
    return any(mark in line for mark in ",;\t")


def _names(line: str, separator: str | None, columns: int) -> list[str]:
    """Return the names in a heading's line, if it has one for each column."""
    words = line.strip().lstrip("#").strip()
    for mark in dict.fromkeys((separator or "\t", "\t", ";", ",", None)):
        cells = [cell.strip().strip("\"'").strip() for cell in words.split(mark)]
        if len(cells) == columns and words:
            return cells
    return []


def _matching(named: dict[int, list[str]], column: int | str | None) -> list[str]:
    """Return the names among which a column's is, else those nearest to the samples."""
    lines = list(named.values())
    return next((names for names in lines if column in names), lines[-1] if lines else [])


def _decimal_mark(pieces: list[Block], separator: str | None, places: tuple[int, ...]) -> str:
    """Return the first decimal mark in the columns that are read; a comma needs semicolons."""
    for piece in pieces if separator == ";" else ():
        if "," not in piece[1]:
            if "." in piece[1]:
                return "."
            continue
        for text in _texts(*piece)[0]:
            cells = text.split(separator)
            for place in places:
                found = re.search(r"[.,]", cells[place]) if place < len(cells) else None
                if found:
                    return found[0]
    return "."


def _cells(file: Path, block: Block, fitting: re.Pattern[str], form: Form) -> NDArray[np.float64]:
    """Return the numbers (rows, 1 or 2) in a block of lines."""
    body = block[1]
    if "#" in body:
        body = "\n".join(_texts(*block)[0])
    if fitting.fullmatch(body + "\n"):
        plain = body.replace(form.separator, " ") if form.separator else body
        values = floats(pointed(plain, form.mark))
        if values is not None:
            return values.reshape(-1, form.columns)[:, form.places]
    texts, numbers = _texts(*block)
    rows: list[list[str]] = []
    for number, text in zip(numbers, texts, strict=True):
        cells = text.split(form.separator)
        if len(cells) != form.columns:
            columns = "1 column" if form.columns == 1 else f"{form.columns} columns"
            got = "1 column" if len(cells) == 1 else f"{len(cells)} columns"
            allowed = f"{columns} on every line, as on the first one with samples"
            refuse(file, number, f"got {got}; allowed: {allowed}")
        rows.append([cells[place].strip() for place in form.places])
    words = [cell for row in rows for cell in row]
    joined = pointed("\n".join(words), form.mark)
    values = None if " " in joined or "\t" in joined else floats(joined)
    if values is None or len(values) != len(words):  # the slow way finds what is wrong
        values = values_of(file, rows, numbers, form.places, form.mark)
    return values.reshape(-1, len(form.places))


def _texts(number: int, block: str) -> tuple[list[str], list[int]]:
    """Return the lines of a block without comments, and their numbers; empty ones are left out."""
    texts = [line.partition("#")[0].strip() for line in block.split("\n")]
    return list(filter(None, texts)), [n for n, text in enumerate(texts, number) if text]
