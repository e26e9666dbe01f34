"""Numbers in the text of recorded motions, as Fortran writes them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST = 1e12
"""Largest magnitude of a number in a file; larger numbers mark missing samples."""

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


def glued_floats(text: str) -> NDArray[np.float64] | None:
    """Return the numbers in a text as `apart` splits them, or None if one has no decimal point."""
    values = floats(GLUED.sub(" ", text))
    return values if values is not None and text.count(".") == len(values) else None


def floats(text: str) -> NDArray[np.float64] | None:
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


def table(separator: str | None, columns: int, mark: str = ".") -> re.Pattern[str]:
    """Return the pattern of lines of cells that may be numbers with a decimal mark, or empty."""
    between = rf"[ \t]*+{separator}[ \t]*+" if separator else r"[ \t]++"
    cell = rf"[0-9{mark}+\-EeDd]++"
    row = rf"{cell}(?:{between}{cell}){{{columns - 1}}}"
    return re.compile(rf"(?:[ \t]*+(?:{row}[ \t]*+)?+\n)*+")
