"""Recorded motions, and their samples at the instants that a simulation asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_SAMPLES = 10_000_000
"""Most samples after resampling, of 8 bytes each."""


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
