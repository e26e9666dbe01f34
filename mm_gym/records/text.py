"""Text of recorded motions in blocks of lines, its numbers, and refusals that name the line."""

from __future__ import annotations

import math
import re
import reprlib
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from mm_gym.errors import SceneError
from mm_gym.files import read_bytes
from mm_gym.records.numbers import FORTRAN, LARGEST, NUMBER, pointed
from mm_gym.records.options import SHORTEST
from mm_gym.records.units import contradiction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

MOST_BYTES = 16 * 2**20
"""Largest file: about an hour and a half at 200 Hz."""

CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")

LONGEST_LINE = 1 << 20
"""Characters of a line, at most: some 70,000 samples."""

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


def check_times(times: NDArray[np.float64], where: Callable[[int], str]) -> None:
    """Refuse instants [s] that are negative or do not increase; `where` names the place of one."""
    if times[0] < 0.0:
        msg = f"{where(0)}: time: got {times[0]:g}; allowed: at least 0 s"
        raise SceneError(msg)
    slow = np.flatnonzero(np.diff(times) < SHORTEST)
    if slow.size:
        i = int(slow[0]) + 1
        allowed = f"at least {SHORTEST:g} s more than {times[i - 1]:.17g}, the one before it"
        msg = f"{where(i)}: time: got {times[i]:.17g}; allowed: {allowed}"
        raise SceneError(msg)


def values_of(
    file: Path,
    rows: list[list[str]],
    numbers: Sequence[int],
    places: Sequence[int] | None = None,
    mark: str = ".",
) -> NDArray[np.float64]:
    """Return the numbers in all cells, or refuse the first one that is not allowed.

    Parameters
    ----------
    rows, numbers
        The cells of each line, and the lines' numbers.
    places
        Columns of the cells, from 0; by default their order in the line.
    mark
        Decimal mark.
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


def evenly(count: int, step: float) -> NDArray[np.float64]:
    """Return instants [s] at an even spacing from 0 on."""
    return np.multiply(step, np.arange(count), dtype=np.float64)


def refuse(file: Path, line: int | None, text: str) -> NoReturn:
    """Raise `SceneError` for a line of a file, or for the whole of it."""
    msg = f"{file}: {text}" if line is None else f"{file}:{line}: {text}"
    raise SceneError(msg)
