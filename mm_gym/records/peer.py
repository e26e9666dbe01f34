"""The AT2 format of the PEER ground motion databases."""

from __future__ import annotations

import re
import reprlib
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.records.numbers import FORTRAN, LARGEST, NUMBER, apart, floats, glued_floats
from mm_gym.records.options import SHORTEST
from mm_gym.records.text import blocks, check_unit, evenly, refuse, values_of

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

HEADER_LINES = 4
COUNTS = "NPTS= (number of samples), DT= (seconds)"


def states_counts(line: str) -> bool:
    """Tell whether a line states the number of samples, outside a comment."""
    return "NPTS" in line.partition("#")[0].upper()


def header_of(text: str, skip: int) -> list[str]:
    """Return the header's lines, or as many as there are, behind those that are skipped."""
    return text.split("\n", skip + HEADER_LINES)[skip : skip + HEADER_LINES]


def read_peer(
    file: Path, text: str, unit: str, skip: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
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


def _numbers(file: Path, number: int, block: str) -> NDArray[np.float64]:
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
