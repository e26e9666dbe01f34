"""The reading of a file: which format it has, and what a caller may ask of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mm_gym.errors import SceneError, suggest
from mm_gym.records.columns import read_columns
from mm_gym.records.numbers import LARGEST
from mm_gym.records.peer import HEADER_LINES, read_peer, states_counts
from mm_gym.records.record import Record
from mm_gym.records.text import SHORTEST, check_no_time_step, read_text, refuse
from mm_gym.records.units import UNITS

if TYPE_CHECKING:
    from os import PathLike


def read_record(
    path: str | PathLike[str], *, unit: str | None = None, time_step: float | None = None
) -> Record:
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
        Unit of the samples, one of `UNITS`; by default g for PEER's format. Other files need it.
    time_step
        Spacing of the samples [s], for a file with one column; other files state their times.

    Raises
    ------
    SceneError
        If the unit is missing, the file is missing or too large, or for the first line that does
        not fit.
    """
    file = Path(path)
    if unit is not None and unit not in UNITS:
        msg = f"unit: got {unit!r}{suggest(str(unit), UNITS)}; allowed: {', '.join(UNITS)}"
        raise SceneError(msg)
    if time_step is not None and not SHORTEST <= time_step <= LARGEST:
        msg = f"time_step: got {time_step}; allowed: {SHORTEST:g} to {LARGEST:g} s"
        raise SceneError(msg)
    text = read_text(file)
    head = text.split("\n", HEADER_LINES)[:HEADER_LINES]
    if file.suffix.lower() == ".at2" or any(map(states_counts, head)):
        check_no_time_step(file, time_step, "NPTS and DT")
        unit = unit or "g"
        times, values, spacing = read_peer(file, text, unit)
    else:
        if unit is None:
            msg = f"unit: missing; {file} is not of PEER's format. Allowed: {', '.join(UNITS)}"
            raise SceneError(msg)
        times, values, spacing = read_columns(file, text, unit, time_step)
    if len(values) < 2:  # noqa: PLR2004 - the ends of a line
        refuse(file, None, "got one sample; allowed: at least two")
    values *= UNITS[unit]
    times.setflags(write=False)
    values.setflags(write=False)
    return Record(times, values, spacing)
