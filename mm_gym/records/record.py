"""Recorded motions: how a file of one is read, and its samples at other instants."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import SceneError, finite_number, positive_number
from mm_gym.files import as_path
from mm_gym.records.arrays import READERS, read_arrays
from mm_gym.records.options import UNITS, Options
from mm_gym.records.text import header_of, read_columns, read_peer, read_text, refuse, states_counts

MOST_SAMPLES = 10_000_000  # most samples after resampling, of 8 bytes each


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

    times: Array
    values: Array
    time_step: float


def resample(record: Record, step: float, *, scale: float = 1.0, time_scale: float = 1.0) -> Array:
    """Return samples (m,) [m/s^2] or [N] of a record at k * step, k = 0, 1, ...

    The motion is the piecewise-linear interpolant of the points (time_scale * times[i],
    scale * values[i]), and zero before the first and after the last of them. The result holds its
    values at the instants up to the last point, and a zero one step later. Linear interpolation
    between the instants reproduces the motion where its points are among the instants; elsewhere
    it cuts corners, within one step.

    Parameters
    ----------
    step
        Spacing of the result [s].
    scale
        Factor of the values [-].
    time_scale
        Factor of the times [-]; 0.5 makes the motion twice as fast.

    Raises
    ------
    SceneError
        If step or time_scale is not greater than 0, scale is no finite number, or the result would
        have more than `MOST_SAMPLES` samples, or one beyond the largest double.
    """
    step, time_scale = positive_number("step", step), positive_number("time_scale", time_scale)
    factor = finite_number("scale", scale)
    rounding = 16.0 * np.finfo(np.float64).eps
    with np.errstate(over="ignore"):
        last = np.multiply(record.times[-1], time_scale) / step * (1.0 + rounding)
    if not last < MOST_SAMPLES:
        most = f"at most {MOST_SAMPLES:.0e}"
        msg = f"the record lasts {last:.3g} steps of {step:g} s; allowed: {most}"
        raise SceneError(msg)
    instants = np.arange(int(last) + 1) * step / time_scale
    after = np.clip(np.searchsorted(record.times, instants), 1, len(record.times) - 1)
    for index in (after - 1, after):  # an instant within round-off of a point is that point
        point = record.times[index]
        instants = np.where(np.abs(instants - point) <= rounding * point, point, instants)
    samples = np.interp(instants, record.times, record.values, left=0.0, right=0.0)
    with np.errstate(over="ignore"):
        samples *= factor
    if not np.all(np.isfinite(samples)):
        msg = f"scale: got {scale:g}, which makes samples larger than the largest double"
        raise SceneError(msg)
    return np.append(samples, 0.0)


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
    return read_with(as_path(path), Options(unit, time_step, column, skip, variable))


def read_with(file: Path, options: Options) -> Record:
    """Read a recorded motion with these options, as `read_record` does."""
    options.check()
    unit, times, values, spacing = _read(file, options)
    if len(values) < 2:  # noqa: PLR2004 - the ends of a line
        refuse(file, None, "got one sample; allowed: at least two")
    values *= UNITS[unit]
    times.setflags(write=False)
    values.setflags(write=False)
    return Record(times, values, spacing)


def _read(file: Path, options: Options) -> tuple[str, Array, Array, float]:
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
    unit = options.unit or options.usual
    if unit is None:
        msg = f"unit: missing; {file} is not in PEER's format AT2. Allowed: {', '.join(UNITS)}"
        raise SceneError(msg)
    return unit
