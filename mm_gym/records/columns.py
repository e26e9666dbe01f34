"""Text in one or two columns: samples, or times and samples."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.records.numbers import NUMERIC, floats, table
from mm_gym.records.text import (
    SHORTEST,
    blocks,
    check_no_time_step,
    check_unit,
    evenly,
    refuse,
    values_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

MOST_HEADINGS = 1000
"""Lines before the first sample, at most."""


def read_columns(
    file: Path, text: str, unit: str, time_step: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the instants [s], the samples in the file's unit, and their least spacing [s]."""
    start, number = _check_headings(file, text, unit)
    first = text[start:].partition("\n")[0].partition("#")[0].strip()
    separator = next((mark for mark in ";," if mark in first), None)
    columns, pieces = len(first.split(separator)), list(blocks(file, text, start, number))
    fitting = table(separator, columns)
    parts = [_cells(file, block, fitting, separator, columns) for block in pieces]
    values = np.concatenate(parts)
    if columns == 1:
        if time_step is None:
            refuse(file, number, "a file with one column states no times; set time_step")
        return evenly(len(values), time_step), values, time_step
    check_no_time_step(file, time_step, "times")
    times, values = values[::2].copy(), values[1::2].copy()
    ends = np.cumsum([len(part) // 2 for part in parts])

    def line_of(row: int) -> int:
        k = int(np.searchsorted(ends, row, side="right"))
        return _texts(*pieces[k])[1][row - (int(ends[k - 1]) if k else 0)]

    _check_times(file, times, line_of)
    return times, values, float(np.min(np.diff(times), initial=np.inf))


def _cells(
    file: Path,
    block: tuple[int, str],
    fitting: re.Pattern[str],
    separator: str | None,
    columns: int,
) -> NDArray[np.float64]:
    """Return the numbers in one or two columns of a block of lines."""
    body = block[1]
    if "#" in body:
        body = "\n".join(_texts(*block)[0])
    if fitting.fullmatch(body + "\n"):
        values = floats(body.replace(separator, " ") if separator else body)
        if values is not None:
            return values
    texts, numbers = _texts(*block)
    rows = [[cell.strip() for cell in text.split(separator)] for text in texts]
    _check_columns(file, rows, numbers, columns)
    return values_of(file, rows, numbers)


def _texts(number: int, block: str) -> tuple[list[str], list[int]]:
    """Return the lines of a block without comments, and their numbers; empty ones are left out."""
    texts = [line.partition("#")[0].strip() for line in block.split("\n")]
    return list(filter(None, texts)), [n for n, text in enumerate(texts, number) if text]


def _check_columns(file: Path, rows: list[list[str]], numbers: list[int], columns: int) -> None:
    for number, row in zip(numbers, rows, strict=True):
        if len(row) != columns or columns > 2:  # noqa: PLR2004 - time and sample
            got = "1 column" if len(row) == 1 else f"{len(row)} columns"
            allowed = "one or two, the same number on every line below the headings"
            refuse(file, number, f"got {got}; allowed: {allowed}")


def _check_headings(file: Path, text: str, unit: str) -> tuple[int, int]:
    """Check the units in the lines before the first number; return where that line begins.

    Returns
    -------
    Position in the text, and the line's number.
    """
    start = 0
    for number in range(1, MOST_HEADINGS + 2):
        end = text.find("\n", start)
        line = text[start:] if end < 0 else text[start:end]
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip())
        if any(NUMERIC.match(word) for word in words):
            return start, number
        check_unit(file, [(number, line)], unit)
        if end < 0:
            refuse(file, None, "the file holds no samples")
        start = end + 1
    return refuse(file, None, f"the first {MOST_HEADINGS} lines hold no samples")


def _check_times(file: Path, times: NDArray[np.float64], line_of: Callable[[int], int]) -> None:
    if times[0] < 0.0:
        refuse(file, line_of(0), f"time: got {times[0]:g}; allowed: at least 0 s")
    slow = np.flatnonzero(np.diff(times) < SHORTEST)
    if slow.size:
        i = int(slow[0]) + 1
        allowed = f"at least {SHORTEST:g} s more than {times[i - 1]:.17g} on line {line_of(i - 1)}"
        refuse(file, line_of(i), f"time: got {times[i]:.17g}; allowed: {allowed}")
