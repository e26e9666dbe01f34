"""Recorded motions as text: the AT2 format of the PEER databases, and columns."""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import SceneError
from mm_gym.files import read_bytes
from mm_gym.records.options import LARGEST, SHORTEST, Options, Samples, contradiction, other_times

Block = tuple[int, str]


NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[EeDd][+-]?\d+)?", re.ASCII)
"""A number as Fortran writes it. It matches in one way only, so long lines need no backtracking.
Not possessive: before Python 3.11.5 possessive groups may match too much."""

NUMERIC = re.compile(r"[+-]?(?:\.?\d|(?:nan|inf|infinity)\b)", re.ASCII | re.IGNORECASE)
"""Start of a cell that is a number, or was meant to be one."""

GLUED = re.compile(r"(?<=[0-9.])(?=[+-])", re.ASCII)
"""Place between two numbers that only a sign separates."""

PLAIN = re.compile(r"[0-9.+\-EeDd \t\n]*+")
FORTRAN = str.maketrans("Dd", "Ee")


def apart(cell: str) -> list[str]:
    """Split numbers that only a sign separates, as in full Fortran columns.

    Each must have a decimal point: in ``1.5-105`` the sign may belong to an exponent.
    """
    parts = NUMBER.findall(cell)
    joined = "".join(parts) == cell and all("." in part for part in parts)
    return parts if joined and all(part[0] in "+-" for part in parts[1:]) else [cell]


def glued_floats(text: str) -> Array | None:
    """Return the numbers in a text as `apart` splits them, or None if one has no decimal point."""
    values = floats(GLUED.sub(" ", text))
    return values if values is not None and text.count(".") == len(values) else None


def floats(text: str) -> Array | None:
    """Return the numbers in a text, or None if one is not allowed: the fast way."""
    if not PLAIN.fullmatch(text):  # float() takes more, such as nan and 1_000
        return None
    try:
        words = text.replace("D", "E").replace("d", "e").split()
        values = np.fromiter(map(float, words), np.float64, len(words))
    except ValueError:
        return None
    return values if np.all(np.abs(values) <= LARGEST) else None


def pointed(text: str, mark: str) -> str:
    """Return numbers with a decimal mark as numbers with a point; what had one is spoilt."""
    return text if mark == "." else text.replace(".", "?").replace(mark, ".")


MOST_BYTES = 16 * 2**20  # largest file: about an hour and a half at 200 Hz

CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")

LONGEST_LINE = 1 << 20  # characters of a line, at most: some 70,000 samples

BLOCK = 1 << 16
"""Characters that are read together, in whole lines: a file takes little more memory than its
numbers, and only the block of a line that does not fit is looked at line by line."""


def read_text(file: Path) -> str:
    """Return a text file with the ends of its lines as editors count them."""
    # A station's name may be in any encoding; a number with a replaced character is refused.
    text = read_bytes(file, most=MOST_BYTES).decode("utf-8-sig", errors="replace")
    # Some files were sent twice as text, and have a carriage return too many.
    text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    strange = CONTROL.search(text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        refuse(file, line, f"got the character {strange[0]!r}; allowed: text")
    if not text.strip():
        refuse(file, None, "the file is empty")
    return text


def blocks(file: Path, text: str, start: int, number: int) -> Iterator[tuple[int, str]]:
    """Return a text from a line's start on in blocks of whole lines, each after its line number."""
    while start < len(text):
        end = text.find("\n", start + BLOCK) + 1 or len(text)
        block = text[start:end].removesuffix("\n")
        if len(block) > LONGEST_LINE:
            number += block.count("\n", 0, BLOCK)
            refuse(file, number, f"a line of more than {LONGEST_LINE} characters")
        yield number, block
        start, number = end, number + block.count("\n") + 1


def check_unit(file: Path, head: Iterable[tuple[int, str]], unit: str) -> None:
    """Refuse velocities and displacements, and a unit that a line of the header contradicts."""
    for number, line in head:
        text = contradiction(line, unit)
        if text:
            refuse(file, number, text)


def series(values: Array, step: float | None, where: Callable[[int], str]) -> Samples:
    """Return rows (n, 1) that are a step [s] apart, or (n, 2) with their own instants [s].

    Instants that are negative or do not increase are refused; `where` names the place of one.
    """
    if values.shape[1] == 1:
        step = step or 0.0  # `Options.places` has asked for it
        return evenly(len(values), step), values[:, 0].copy(), step
    times, samples = values.T.copy()
    if times[0] < 0.0:
        msg = f"{where(0)}: time: got {times[0]:g}; allowed: at least 0 s"
        raise SceneError(msg)
    slow = np.flatnonzero(np.diff(times) < SHORTEST)
    if slow.size:
        i = int(slow[0]) + 1
        allowed = f"at least {SHORTEST:g} s more than {times[i - 1]:.17g}, the one before it"
        msg = f"{where(i)}: time: got {times[i]:.17g}; allowed: {allowed}"
        raise SceneError(msg)
    return times, samples, float(np.min(np.diff(times), initial=np.inf))


def values_of(
    file: Path,
    rows: list[list[str]],
    numbers: Sequence[int],
    places: Sequence[int] | None = None,
    mark: str = ".",
) -> Array:
    """Return the numbers in the cells of lines, or refuse the first one that is not allowed.

    `places` are the cells' columns, from 0; by default their order in the line.
    """
    values: list[float] = []
    for number, row in zip(numbers, rows, strict=True):
        for k, cell in enumerate(row):
            plain = pointed(cell, mark)
            value = float(plain.translate(FORTRAN)) if NUMBER.fullmatch(plain) else math.nan
            if not abs(value) <= LARGEST:
                allowed = f"a number of magnitude at most {LARGEST:g}"
                if mark != ".":
                    allowed += ", with a decimal comma as the numbers before it"
                column = k + 1 if places is None else places[k] + 1
                got = reprlib.repr(cell)
                refuse(file, number, f"column {column}: got {got}; allowed: {allowed}")
            values.append(value)
    return np.array(values)


def evenly(count: int, step: float) -> Array:
    """Return instants [s] at an even spacing from 0 on."""
    return np.multiply(step, np.arange(count), dtype=np.float64)


def refuse(file: Path, line: int | None, text: str) -> NoReturn:
    """Raise `SceneError` for a line of a file, or for the whole of it."""
    msg = f"{file}: {text}" if line is None else f"{file}:{line}: {text}"
    raise SceneError(msg)


HEADER_LINES = 4
COUNTS = "NPTS= (number of samples), DT= (seconds)"


def states_counts(line: str) -> bool:
    """Tell whether a line states the number of samples, outside a comment."""
    return "NPTS" in line.partition("#")[0].upper()


def header_of(text: str, skip: int) -> list[str]:
    """Return the header's lines, or as many as there are, behind those that are skipped."""
    return text.split("\n", skip + HEADER_LINES)[skip : skip + HEADER_LINES]


def read_peer(file: Path, text: str, unit: str, skip: int) -> Samples:
    """Return the instants [s], the samples in the file's unit, and their spacing [s]."""
    lines = text.split("\n", skip + HEADER_LINES)
    head = list(enumerate(header_of(text, skip), skip + 1))
    last = next((n for n, line in head if states_counts(line)), skip + HEADER_LINES)
    if len(lines) <= last:
        allowed = f"{last - skip} header lines, then samples"
        refuse(file, len(lines), f"the file ends within its header; allowed: {allowed}")
    check_unit(file, head[: last - skip], unit)
    count, step = _counts(file, last, lines[last - 1])
    start = sum(len(line) + 1 for line in lines[:last])
    parts = [_numbers(file, *block) for block in blocks(file, text, start, last + 1)]
    values = np.concatenate(parts) if parts else np.empty(0)
    if len(values) != count:
        end = max(last, text.count("\n", 0, len(text.rstrip())) + 1)
        refuse(file, end, f"got {len(values)} samples; line {last} promises {count}")
    return evenly(count, step), values, step


def _numbers(file: Path, number: int, block: str) -> Array:
    """Return the numbers in any columns of a block of lines."""
    text = block.replace(",", " ")
    for read in (floats, glued_floats):  # the slow way below finds what is wrong
        values = read(text)
        if values is not None:
            return values
    rows = [line.replace(",", " ").split() for line in block.split("\n")]
    rows = [[part for cell in row for part in apart(cell)] for row in rows]
    return values_of(file, rows, range(number, number + len(rows)))


def _counts(file: Path, number: int, line: str) -> tuple[int, float]:
    """Return NPTS and DT [s] from ``NPTS= 4000, DT= .005 SEC`` or ``4000  .005  NPTS, DT``."""
    before = re.match(r"[\s,]*([^\s,]+)[\s,]+([^\s,]+)[\s,]+NPTS\s*,\s*DT\b", line, re.IGNORECASE)
    if before:
        npts, dt, unit = before[1], before[2], ""
    else:
        found = re.search(r"\bNPTS\s*=\s*([^\s,]+)", line, re.IGNORECASE)
        npts = found[1] if found else None
        found = re.search(rf"\bDT\s*=\s*({NUMBER.pattern}|[^\s,]+)\s*(\w*)", line, re.IGNORECASE)
        dt, unit = (found[1], found[2]) if found else (None, "")
    if npts is None:
        refuse(file, number, f"NPTS is missing; allowed: {COUNTS}")
    if dt is None:
        refuse(file, number, f"DT is missing; allowed: {COUNTS}")
    if not re.fullmatch(r"0*[1-9][0-9]{0,8}", npts):
        refuse(
            file, number, f"NPTS: got {reprlib.repr(npts)}; allowed: an integer from 1 to 999999999"
        )
    if unit.upper() not in {"", "S", "SEC", "SECS", "SECOND", "SECONDS", "NPTS"}:
        refuse(file, number, f"DT: got the unit {reprlib.repr(unit)}; allowed: SEC")
    step = float(dt.translate(FORTRAN)) if NUMBER.fullmatch(dt) else 0.0
    if not SHORTEST <= step <= LARGEST:
        allowed = f"a number from {SHORTEST:g} to {LARGEST:g} s"
        refuse(file, number, f"DT: got {reprlib.repr(dt)}; allowed: {allowed}")
    return int(npts), step


MOST_HEADINGS = 1000  # lines before the first sample, at most


class Form(NamedTuple):
    """How the lines of samples are written."""

    separator: str | None  # of the columns: a semicolon, a comma, or None for tabs and blanks
    columns: int  # their number
    places: tuple[int, ...]  # those that are read, from 0
    mark: str  # decimal mark


def read_columns(file: Path, text: str, unit: str, options: Options) -> Samples:
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
        times = other_times(line) if options.time_step is None else None
        if times is not None:
            refuse(file, n, times)
    pieces = list(blocks(file, text, start, number))
    form = Form(separator, columns, places, _decimal_mark(pieces, separator, places))
    rows = [_cells(file, block, form) for block in pieces]
    values = np.concatenate(rows)

    def where(row: int) -> str:
        ends = np.cumsum([len(part) for part in rows])
        k = int(np.searchsorted(ends, row, side="right"))
        line = _texts(*pieces[k])[1][row - (int(ends[k - 1]) if k else 0)]
        return f"{file}:{line}: column 1"

    return series(values, options.time_step, where)


def _headings(file: Path, text: str, skip: int) -> tuple[list[Block], int, int]:
    """Return the lines before the first number but those skipped, and its place and line."""
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


def _cells(file: Path, block: Block, form: Form) -> Array:
    """Return the numbers (rows, 1 or 2) in a block of lines."""
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
