"""Recorded motions in files: PEER's AT2, and columns of text.

Records are read strictly: the first line that does not fit is refused, because nobody would notice
a sample that is misread or missing.
"""

from __future__ import annotations

import math
import re
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.files import read_bytes
from mm_gym.record_numbers import (
    FORTRAN,
    LARGEST,
    NUMBER,
    NUMERIC,
    apart,
    floats,
    glued_floats,
    table,
)
from mm_gym.record_units import ACCELERATION_UNITS, FORCE_UNITS, UNITS, contradiction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from os import PathLike

    from numpy.typing import NDArray

__all__ = [
    "ACCELERATION_UNITS",
    "FORCE_UNITS",
    "LARGEST",
    "UNITS",
    "Record",
    "read_record",
    "resample",
]

MOST_BYTES = 16 * 2**20
"""Largest file: about an hour and a half at 200 Hz."""

MOST_SAMPLES = 10_000_000
"""Most samples after resampling, of 8 bytes each."""

SHORTEST = 1e-9
"""Shortest spacing of samples [s]."""

CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")
HEADER_LINES = 4

MOST_HEADINGS = 1000
"""Lines before the first sample, at most."""

LONGEST_LINE = 1 << 20
"""Characters of a line, at most: some 70,000 samples."""

BLOCK = 1 << 16
"""Characters that are read together, in whole lines: a file takes little more memory than its
numbers, and only the block of a line that does not fit is looked at line by line."""
COUNTS = "NPTS= (number of samples), DT= (seconds)"


@dataclass(frozen=True)
class Record:
    """Samples of a ground acceleration or of a force.

    Attributes
    ----------
    times
        (n,) float64, increasing instants [s] of at least 0; not necessarily evenly spaced.
    values
        (n,) float64 samples [m/s^2] or [N].
    time_step
        Spacing of the samples [s]; the shortest one if the file states times.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    time_step: float


def read_record(path: str | PathLike[str], *, unit: str, time_step: float | None = None) -> Record:
    """Read a recorded motion.

    A file named ``.AT2``, or with the word NPTS in its first four lines, has the format of the PEER
    ground motion databases: four header lines, one of which states NPTS and DT, then the samples
    in any number of columns. All other files have one or two columns, separated by commas,
    semicolons or white space: samples, or time [s] and sample. Headings without numbers may come
    first, and ``#`` begins a comment.

    Parameters
    ----------
    path
        The file.
    unit
        Unit of the samples, one of `UNITS`.
    time_step
        Spacing of the samples [s], for a file with one column; other files state their times.

    Raises
    ------
    SceneError
        If the file is missing or too large, or for the first line that does not fit.
    """
    file = Path(path)
    if unit not in UNITS:
        msg = f"unit: got {unit!r}{suggest(str(unit), UNITS)}; allowed: {', '.join(UNITS)}"
        raise SceneError(msg)
    if time_step is not None and not SHORTEST <= time_step <= LARGEST:
        msg = f"time_step: got {time_step}; allowed: {SHORTEST:g} to {LARGEST:g} s"
        raise SceneError(msg)
    text = _read_text(file)
    head = text.split("\n", HEADER_LINES)[:HEADER_LINES]
    if file.suffix.lower() == ".at2" or any(map(_counts_in, head)):
        _check_no_time_step(file, time_step, "NPTS and DT")
        times, values, spacing = _read_peer(file, text, unit)
    else:
        times, values, spacing = _read_columns(file, text, unit, time_step)
    if len(values) < 2:  # noqa: PLR2004 - the ends of a line
        _refuse(file, None, "got one sample; allowed: at least two")
    values *= UNITS[unit]
    times.setflags(write=False)
    values.setflags(write=False)
    return Record(times, values, spacing)


def resample(
    record: Record, step: float, *, scale: float = 1.0, time_scale: float = 1.0
) -> NDArray[np.float64]:
    """Resample a record at k * step, k = 0, 1, ...

    The motion is the piecewise-linear interpolant of the points (time_scale * times[i],
    scale * values[i]), and zero before the first and after the last of them. The result holds its
    values at the instants up to the last point, and a zero one step later. Linear interpolation
    between the instants reproduces the motion where its points are among the instants; elsewhere
    it cuts corners, within one step.

    Parameters
    ----------
    record
        What `read_record` returned.
    step
        Spacing of the result [s].
    scale
        Factor of the values [-].
    time_scale
        Factor of the times [-]; 0.5 makes the motion twice as fast.

    Returns
    -------
    (m,) float64 samples [m/s^2] or [N].

    Raises
    ------
    SceneError
        If the result would have more than `MOST_SAMPLES` samples, or one beyond the largest double.
    """
    rounding = 16.0 * np.finfo(np.float64).eps
    with np.errstate(over="ignore"):
        last = np.multiply(record.times[-1], time_scale) / step * (1.0 + rounding)
    if not last < MOST_SAMPLES:
        msg = (
            f"the record lasts {last:.3g} steps of {step:g} s; allowed: at most {MOST_SAMPLES:.0e}"
        )
        raise SceneError(msg)
    instants = np.arange(int(last) + 1) * step / time_scale
    after = np.clip(np.searchsorted(record.times, instants), 1, len(record.times) - 1)
    for index in (after - 1, after):  # an instant within round-off of a point is that point
        point = record.times[index]
        instants = np.where(np.abs(instants - point) <= rounding * point, point, instants)
    samples = np.interp(instants, record.times, record.values, left=0.0, right=0.0)
    with np.errstate(over="ignore"):
        samples *= scale
    if not np.all(np.isfinite(samples)):
        msg = f"scale: got {scale:g}, which makes samples larger than the largest double"
        raise SceneError(msg)
    return np.append(samples, 0.0)


def _read_text(file: Path) -> str:
    """Return a text file with the ends of its lines as editors count them."""
    # A station's name may be in any encoding; a number with a replaced character is refused.
    text = read_bytes(file, most=MOST_BYTES).decode("utf-8-sig", errors="replace")
    # Some files were sent twice as text, and have a carriage return too many.
    text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    strange = CONTROL.search(text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        _refuse(file, line, f"got the character {strange[0]!r}; allowed: text")
    if not text.strip():
        _refuse(file, None, "the file is empty")
    return text


def _blocks(file: Path, text: str, start: int, number: int) -> Iterator[tuple[int, str]]:
    """Return a text from a line's start on in blocks of whole lines, each after its line number."""
    while start < len(text):
        end = text.find("\n", start + BLOCK) + 1 or len(text)
        block = text[start:end].removesuffix("\n")
        if len(block) > LONGEST_LINE:
            number += block.count("\n", 0, BLOCK)
            _refuse(file, number, f"a line of more than {LONGEST_LINE} characters")
        yield number, block
        start, number = end, number + block.count("\n") + 1


def _counts_in(line: str) -> bool:
    """Tell whether a line states the number of samples, outside a comment."""
    return "NPTS" in line.partition("#")[0].upper()


def _check_no_time_step(file: Path, time_step: float | None, states: str) -> None:
    if time_step is not None:
        _refuse(file, None, f"the file states {states}, so time_step has no effect")


def _read_peer(
    file: Path, text: str, unit: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    lines = text.split("\n", HEADER_LINES)
    head = lines[:HEADER_LINES]
    last = next((n for n, line in enumerate(head, 1) if _counts_in(line)), HEADER_LINES)
    if len(lines) <= last:
        allowed = f"{last} header lines, then samples"
        _refuse(file, len(lines), f"the file ends within its header; allowed: {allowed}")
    _check_unit(file, enumerate(head[:last], 1), unit)
    count, step = _counts(file, last, lines[last - 1])
    start = sum(len(line) + 1 for line in lines[:last])
    parts = [_numbers(file, *block) for block in _blocks(file, text, start, last + 1)]
    values = np.concatenate(parts) if parts else np.empty(0)
    if len(values) != count:
        end = max(last, text.count("\n", 0, len(text.rstrip())) + 1)
        _refuse(file, end, f"got {len(values)} samples; line {last} promises {count}")
    return _evenly(count, step), values, step


def _numbers(file: Path, number: int, block: str) -> NDArray[np.float64]:
    """Return the numbers in any columns of a block of lines."""
    text = block.replace(",", " ")
    for read in (floats, glued_floats):  # the slow way below finds what is wrong
        values = read(text)
        if values is not None:
            return values
    rows = [line.replace(",", " ").split() for line in block.split("\n")]
    rows = [[part for cell in row for part in apart(cell)] for row in rows]
    return _values(file, rows, range(number, number + len(rows)))


def _check_unit(file: Path, head: Iterable[tuple[int, str]], unit: str) -> None:
    """Refuse velocities and displacements, and a unit that a line of the header contradicts."""
    for number, line in head:
        text = contradiction(line, unit)
        if text:
            _refuse(file, number, text)


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
        _refuse(file, number, f"NPTS is missing; allowed: {COUNTS}")
    if dt is None:
        _refuse(file, number, f"DT is missing; allowed: {COUNTS}")
    if not re.fullmatch(r"0*[1-9][0-9]{0,8}", npts):
        _refuse(
            file, number, f"NPTS: got {reprlib.repr(npts)}; allowed: an integer from 1 to 999999999"
        )
    if unit.upper() not in {"", "S", "SEC", "SECS", "SECOND", "SECONDS", "NPTS"}:
        _refuse(file, number, f"DT: got the unit {reprlib.repr(unit)}; allowed: SEC")
    step = float(dt.translate(FORTRAN)) if NUMBER.fullmatch(dt) else 0.0
    if not SHORTEST <= step <= LARGEST:
        allowed = f"a number from {SHORTEST:g} to {LARGEST:g} s"
        _refuse(file, number, f"DT: got {reprlib.repr(dt)}; allowed: {allowed}")
    return int(npts), step


def _values(file: Path, rows: list[list[str]], numbers: Sequence[int]) -> NDArray[np.float64]:
    """Return the numbers in all cells, or refuse the first one that is not allowed."""
    values: list[float] = []
    for number, row in zip(numbers, rows, strict=True):
        for cell in row:
            value = float(cell.translate(FORTRAN)) if NUMBER.fullmatch(cell) else math.nan
            if not abs(value) <= LARGEST:
                allowed = f"a number of magnitude at most {LARGEST:g}"
                _refuse(file, number, f"got {reprlib.repr(cell)}; allowed: {allowed}")
            values.append(value)
    return np.array(values)


def _read_columns(
    file: Path, text: str, unit: str, time_step: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    start, number = _check_headings(file, text, unit)
    first = text[start:].partition("\n")[0].partition("#")[0].strip()
    separator = next((mark for mark in ";," if mark in first), None)
    columns, blocks = len(first.split(separator)), list(_blocks(file, text, start, number))
    fitting = table(separator, columns)
    parts = [_cells(file, block, fitting, separator, columns) for block in blocks]
    values = np.concatenate(parts)
    if columns == 1:
        if time_step is None:
            _refuse(file, number, "a file with one column states no times; set time_step")
        return _evenly(len(values), time_step), values, time_step
    _check_no_time_step(file, time_step, "times")
    times, values = values[::2].copy(), values[1::2].copy()
    ends = np.cumsum([len(part) // 2 for part in parts])

    def line_of(row: int) -> int:
        k = int(np.searchsorted(ends, row, side="right"))
        return _texts(*blocks[k])[1][row - (int(ends[k - 1]) if k else 0)]

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
    return _values(file, rows, numbers)


def _texts(number: int, block: str) -> tuple[list[str], list[int]]:
    """Return the lines of a block without comments, and their numbers; empty ones are left out."""
    texts = [line.partition("#")[0].strip() for line in block.split("\n")]
    return list(filter(None, texts)), [n for n, text in enumerate(texts, number) if text]


def _check_columns(file: Path, rows: list[list[str]], numbers: list[int], columns: int) -> None:
    for number, row in zip(numbers, rows, strict=True):
        if len(row) != columns or columns > 2:  # noqa: PLR2004 - time and sample
            got = "1 column" if len(row) == 1 else f"{len(row)} columns"
            allowed = "one or two, the same number on every line below the headings"
            _refuse(file, number, f"got {got}; allowed: {allowed}")


def _evenly(count: int, step: float) -> NDArray[np.float64]:
    return np.multiply(step, np.arange(count), dtype=np.float64)


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
        _check_unit(file, [(number, line)], unit)
        if end < 0:
            _refuse(file, None, "the file holds no samples")
        start = end + 1
    return _refuse(file, None, f"the first {MOST_HEADINGS} lines hold no samples")


def _check_times(file: Path, times: NDArray[np.float64], line_of: Callable[[int], int]) -> None:
    if times[0] < 0.0:
        _refuse(file, line_of(0), f"time: got {times[0]:g}; allowed: at least 0 s")
    slow = np.flatnonzero(np.diff(times) < SHORTEST)
    if slow.size:
        i = int(slow[0]) + 1
        allowed = f"at least {SHORTEST:g} s more than {times[i - 1]:.17g} on line {line_of(i - 1)}"
        _refuse(file, line_of(i), f"time: got {times[i]:.17g}; allowed: {allowed}")


def _refuse(file: Path, line: int | None, text: str) -> NoReturn:
    msg = f"{file}: {text}" if line is None else f"{file}:{line}: {text}"
    raise SceneError(msg)
