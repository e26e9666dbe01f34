"""The AT2 format of the PEER ground motion databases."""

from __future__ import annotations

import re
import reprlib
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.records.numbers import FORTRAN, LARGEST, NUMBER, apart, floats, glued_floats
from mm_gym.records.text import SHORTEST, blocks, check_unit, evenly, refuse, values_of

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

HEADER_LINES = 4
COUNTS = "NPTS= (number of samples), DT= (seconds)"


def states_counts(line: str) -> bool:
    """Tell whether a line states the number of samples, outside a comment."""
    return "NPTS" in line.partition("#")[0].upper()


def read_peer(
    file: Path, text: str, unit: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the instants [s], the samples in the file's unit, and their spacing [s]."""
    lines = text.split("\n", HEADER_LINES)
    head = lines[:HEADER_LINES]
    last = next((n for n, line in enumerate(head, 1) if states_counts(line)), HEADER_LINES)
    if len(lines) <= last:
        allowed = f"{last} header lines, then samples"
        refuse(file, len(lines), f"the file ends within its header; allowed: {allowed}")
    check_unit(file, enumerate(head[:last], 1), unit)
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
