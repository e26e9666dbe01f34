"""The reading of a file: which format it has, and what a caller may ask of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mm_gym.errors import SceneError
from mm_gym.records.arrays import READERS, read_arrays
from mm_gym.records.columns import read_columns
from mm_gym.records.options import Options
from mm_gym.records.peer import header_of, read_peer, states_counts
from mm_gym.records.record import Record
from mm_gym.records.text import read_text, refuse
from mm_gym.records.units import UNITS

if TYPE_CHECKING:
    from os import PathLike

    import numpy as np
    from numpy.typing import NDArray


def read_record(
    path: str | PathLike[str],
    *,
    unit: str | None = None,
    time_step: float | None = None,
    column: int | str | None = None,
    skip: int = 0,
    variable: str | None = None,
) -> Record:
    """Read a recorded motion.

    A file named ``.AT2``, or with the word NPTS in its first four lines, has the format of the PEER
    ground motion databases: four header lines, one of which states NPTS and DT, then the samples
    in any number of columns. A file named ``.npy``, ``.npz`` (NumPy) or ``.mat`` (MATLAB 5 or 7.3)
    has arrays, (n,) or (n, k), of which nothing is executed; an array with fewer rows than columns
    has its series in rows, which are read as if they were its columns. All other files are text in
    columns, separated by semicolons, commas, tabs or blanks: samples, or times [s] and samples.
    With semicolons the decimal mark may be a comma. Headings without numbers may come first, and
    ``#`` begins a comment.

    Parameters
    ----------
    path
        The file.
    unit
        Unit of the samples, one of `UNITS`; by default g for PEER's format. Other files need it.
    time_step
        Spacing of the samples [s]: then no column has times.
    column
        Number of the column with the samples, from 1, or its name in the headings; of an array with
        its series in rows, the number of the row. By default the only one, or the second of two.
        Without a time_step the first column has the times.
    skip
        Lines at the beginning of a text that are not looked at.
    variable
        Name of the array in a ``.mat`` or ``.npz`` file; by default the only one. A field of a
        MATLAB struct has the struct's name before its own: ``"test.table.acceleration"``.

    Raises
    ------
    SceneError
        If an option is not allowed or has no effect, the file is missing or too large, or for the
        first line, or row, that does not fit.
    DependencyNotInstalled
        If a file of MATLAB 7.3 is read without h5py.
    """
    file = Path(path)
    options = Options(unit, time_step, column, skip, variable)
    options.check()
    unit, times, values, spacing = _read(file, options)
    if len(values) < 2:  # noqa: PLR2004 - the ends of a line
        refuse(file, None, "got one sample; allowed: at least two")
    values *= UNITS[unit]
    times.setflags(write=False)
    values.setflags(write=False)
    return Record(times, values, spacing)


def _read(
    file: Path, options: Options
) -> tuple[str, NDArray[np.float64], NDArray[np.float64], float]:
    """Return the unit, the instants [s], the samples in this unit, and their least spacing [s]."""
    if file.suffix.lower() in READERS:
        return _stated_unit(file, options), *read_arrays(file, options)
    if options.variable is not None:
        refuse(file, None, "variable: no effect; allowed: for files named .npz, .mat")
    text = read_text(file)
    if file.suffix.lower() == ".at2" or any(map(states_counts, header_of(text, options.skip))):
        for name in ("time_step", "column"):
            if getattr(options, name) is not None:
                states = "PEER's format states NPTS and DT of one series"
                refuse(file, None, f"{states}, so {name} has no effect")
        unit = options.unit or "g"
        return unit, *read_peer(file, text, unit, options.skip)
    unit = _stated_unit(file, options)
    return unit, *read_columns(file, text, unit, options)


def _stated_unit(file: Path, options: Options) -> str:
    if options.unit is None:
        msg = f"unit: missing; {file} is not in PEER's format AT2. Allowed: {', '.join(UNITS)}"
        raise SceneError(msg)
    return options.unit
