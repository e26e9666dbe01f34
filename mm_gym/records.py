"""Recorded motions in files: PEER's AT2, and columns of text.

Records are read strictly: the first line that does not fit is refused, because nobody would notice
a sample that is misread or missing.
"""

from __future__ import annotations

import math
import re
import reprlib
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from mm_gym.errors import SceneError, suggest
from mm_gym.files import read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from os import PathLike

    from numpy.typing import NDArray

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

FORCE_UNITS = {"N": 1.0, "kN": 1000.0, "lbf": 4.4482216152605}
"""Unit of force -> its size [N]."""

UNITS = ACCELERATION_UNITS | FORCE_UNITS

MOST_BYTES = 16 * 2**20
"""Largest file: about an hour and a half at 200 Hz."""

MOST_SAMPLES = 10_000_000
"""Most samples after resampling, of 8 bytes each."""

LARGEST = 1e12
"""Largest magnitude of a number in a file; larger numbers mark missing samples."""

SHORTEST = 1e-9
"""Shortest spacing of samples [s]."""

NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[EeDd][+-]?\d+)?", re.ASCII)
"""A number as Fortran writes it. It matches in one way only, so long lines need no backtracking.
Not possessive: before Python 3.11.5 possessive groups may match too much."""

NUMERIC = re.compile(r"[+-]?(?:\.?\d|(?:nan|inf|infinity)\b)", re.ASCII | re.IGNORECASE)
"""Start of a cell that is a number, or was meant to be one."""

PLAIN = re.compile(r"[0-9.+\-EeDd \t\n]*+")
FORTRAN = str.maketrans("Dd", "Ee")
CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")
HEADER_LINES = 4
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
    lines = _read_lines(file)
    if file.suffix.lower() == ".at2" or any(map(_counts_in, lines[:HEADER_LINES])):
        _check_no_time_step(file, time_step, "NPTS and DT")
        times, values, spacing = _read_peer(file, lines, unit)
    else:
        times, values, spacing = _read_columns(file, lines, time_step)
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


def _read_lines(file: Path) -> list[str]:
    """Return the lines of a text file, split as editors count them."""
    # A station's name may be in any encoding; a number with a replaced character is refused.
    text = read_bytes(file, most=MOST_BYTES).decode("utf-8-sig", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    strange = CONTROL.search(text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        _refuse(file, line, f"got the character {strange[0]!r}; allowed: text")
    if not text.strip():
        _refuse(file, None, "the file is empty")
    return text.split("\n")


def _counts_in(line: str) -> bool:
    """Tell whether a line states the number of samples, outside a comment."""
    return "NPTS" in line.partition("#")[0].upper()


def _check_no_time_step(file: Path, time_step: float | None, states: str) -> None:
    if time_step is not None:
        _refuse(file, None, f"the file states {states}, so time_step has no effect")


def _read_peer(
    file: Path, lines: list[str], unit: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    head = lines[:HEADER_LINES]
    last = next((n for n, line in enumerate(head, 1) if _counts_in(line)), HEADER_LINES)
    if len(lines) <= last:
        text = f"the file ends within its header; allowed: {last} header lines, then samples"
        _refuse(file, len(lines), text)
    _check_quantity(file, head[: last - 1], unit)
    count, step = _counts(file, last, lines[last - 1])
    body, numbers = lines[last:], range(last + 1, len(lines) + 1)
    values = _floats("\n".join(body).replace(",", " "))
    if values is None:
        cells = [line.replace(",", " ").split() for line in body]
        rows = [[part for cell in row for part in _apart(cell)] for row in cells]
        values = _values(file, rows, numbers)
    if len(values) != count:
        end = max((n for n, line in zip(numbers, body, strict=True) if line.strip()), default=last)
        _refuse(file, end, f"got {len(values)} samples; line {last} promises {count}")
    return _evenly(count, step), values, step


def _check_quantity(file: Path, head: list[str], unit: str) -> None:
    """Refuse velocities and displacements, and units that the header contradicts."""
    for number, line in enumerate(head, 1):
        words = line.upper()
        for quantity in ("VELOCITY", "DISPLACEMENT"):
            if f"{quantity} TIME" in words:
                text = f"the header states a {quantity.lower()}; allowed: an acceleration"
                _refuse(file, number, text)
        stated = re.search(r"\bUNITS\s+OF\s+([^\s,;]+)", words)
        if stated and (stated[1].rstrip(".") == "G") != (unit == "g"):
            text = f"the header states units of {stated[1][:20]}; got unit = {unit!r}"
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


def _apart(cell: str) -> list[str]:
    """Split numbers that only a sign separates, as in full Fortran columns.

    Each must have a decimal point: in ``1.5-105`` the sign may belong to an exponent.
    """
    parts = NUMBER.findall(cell)
    joined = "".join(parts) == cell and all("." in part for part in parts)
    return parts if joined and all(part[0] in "+-" for part in parts[1:]) else [cell]


def _floats(text: str) -> NDArray[np.float64] | None:
    """Return the numbers in a text, or None if one is not allowed: the fast way."""
    if not PLAIN.fullmatch(text):  # float() takes more, such as nan and 1_000
        return None
    try:
        values = np.array(list(map(float, text.translate(FORTRAN).split())))
    except ValueError:
        return None
    return values if np.all(np.abs(values) <= LARGEST) else None


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
    file: Path, lines: list[str], time_step: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    texts = [line.partition("#")[0].strip() for line in lines]
    numbers = [number for number, text in enumerate(texts, 1) if text]
    texts = list(filter(None, texts))
    first = _headings(texts)
    if first == len(texts):
        _refuse(file, None, "the file holds no samples")
    texts, numbers = texts[first:], numbers[first:]
    separator = next((mark for mark in ";," if mark in texts[0]), None)
    columns = len(texts[0].split(separator))
    body = "\n".join(texts)
    values = None
    if _table(separator, columns).fullmatch(body):
        values = _floats(body.replace(separator, " ") if separator else body)
    if values is None:
        rows = [[cell.strip() for cell in text.split(separator)] for text in texts]
        _check_columns(file, rows, numbers)
        values = _values(file, rows, numbers)
    if columns == 1:
        if time_step is None:
            _refuse(file, numbers[0], "a file with one column states no times; set time_step")
        return _evenly(len(values), time_step), values, time_step
    _check_no_time_step(file, time_step, "times")
    times, values = values[::2].copy(), values[1::2].copy()
    _check_times(file, times, numbers)
    return times, values, float(np.min(np.diff(times), initial=np.inf))


def _table(separator: str | None, columns: int) -> re.Pattern[str]:
    """Return the pattern of lines with one or two cells that may be numbers."""
    between = rf"[ \t]*+{separator}[ \t]*+" if separator else r"[ \t]++"
    row = between.join([r"[0-9.+\-EeDd]++"] * min(columns, 2))
    return re.compile(rf"(?:{row}\n)*{row}")


def _check_columns(file: Path, rows: list[list[str]], numbers: list[int]) -> None:
    columns = len(rows[0])
    for number, row in zip(numbers, rows, strict=True):
        if len(row) != columns or columns > 2:  # noqa: PLR2004 - time and sample
            got = "1 column" if len(row) == 1 else f"{len(row)} columns"
            allowed = "one or two, the same number on every line below the headings"
            _refuse(file, number, f"got {got}; allowed: {allowed}")


def _evenly(count: int, step: float) -> NDArray[np.float64]:
    return np.multiply(step, np.arange(count), dtype=np.float64)


def _headings(texts: Iterable[str]) -> int:
    """Return the number of lines at the start that hold no number."""

    def is_heading(text: str) -> bool:
        return not any(NUMERIC.match(word) for word in re.split(r"[\s,;]+", text))

    return sum(1 for _ in takewhile(is_heading, texts))


def _check_times(file: Path, times: NDArray[np.float64], numbers: list[int]) -> None:
    if times[0] < 0.0:
        _refuse(file, numbers[0], f"time: got {times[0]:g}; allowed: at least 0 s")
    slow = np.flatnonzero(np.diff(times) < SHORTEST)
    if slow.size:
        i = int(slow[0]) + 1
        allowed = f"at least {SHORTEST:g} s more than {times[i - 1]:.17g} on line {numbers[i - 1]}"
        _refuse(file, numbers[i], f"time: got {times[i]:.17g}; allowed: {allowed}")


def _refuse(file: Path, line: int | None, text: str) -> NoReturn:
    msg = f"{file}: {text}" if line is None else f"{file}:{line}: {text}"
    raise SceneError(msg)
