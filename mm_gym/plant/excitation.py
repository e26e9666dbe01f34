"""A scene's excitation as the rows and the description that the kernels read."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf, sqrt
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import excitation as kernels
from mm_gym.kernels import layout as at
from mm_gym.kernels import noise
from mm_gym.records import read_record, resample
from mm_gym.scene.excitation import (
    CloughPenzien,
    FilteredNoise,
    Harmonic,
    Impulse,
    KanaiTajimi,
    Noise,
    Recorded,
    Sweep,
)
from mm_gym.scene.scene import bounds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.records import Record
    from mm_gym.scene.excitation import NumberOrRange
    from mm_gym.scene.scene import Scene

    Source = Sweep | Noise | KanaiTajimi | CloughPenzien | Impulse | Recorded

HARMONIC_FIELDS = {"amplitude": at.AMPLITUDE, "frequency": at.FREQUENCY, "phase": at.PHASE}

SWEEP_FIELDS = {
    "amplitude": kernels.SWEEP_AMPLITUDE,
    "start_frequency": kernels.START_FREQUENCY,
    "end_frequency": kernels.END_FREQUENCY,
    "duration": kernels.DURATION,
    "phase": kernels.SWEEP_PHASE,
}
NOISE_FIELDS = {
    "rms": noise.RMS,
    "rise": noise.RISE,
    "plateau": noise.PLATEAU,
    "decay": noise.DECAY,
}
SOIL_FIELDS = NOISE_FIELDS | {
    "ground_frequency": noise.LOW_PASS,
    "ground_damping": noise.LOW_PASS_DAMPING,
}
FIELDS: dict[str, dict[str, int]] = {
    "sweep": SWEEP_FIELDS,
    "noise": NOISE_FIELDS | {"low_frequency": noise.HIGH_PASS, "high_frequency": noise.LOW_PASS},
    "kanai_tajimi": SOIL_FIELDS,
    "clough_penzien": SOIL_FIELDS
    | {"filter_frequency": noise.HIGH_PASS, "filter_damping": noise.HIGH_PASS_DAMPING},
    "impulse": {"size": kernels.IMPULSE_SIZE, "rate": kernels.RATE, "time": kernels.TIME},
    "record": {
        "scale": kernels.RECORD_SCALE,
        "time_scale": kernels.TIME_SCALE,
        "start": kernels.RECORD_START,
    },
}
"""Row of each field within the rows of its kind."""

NEVER = {"plateau": inf, "time": inf}
"""What the absence of a field stands for."""

BUTTERWORTH = {
    noise.LOW_PASS_DAMPING: sqrt(0.5),
    noise.HIGH_PASS_DAMPING: sqrt(0.5),
}
"""Damping ratios of band-limited noise's filters."""

SWEEP_PHASE = 0.5
"""Longest sample interval of a sweep, times its highest frequency: so few terms are below round-off."""

SWEEP_TERMS = 14
"""Terms of a sweep's series: 0.5**14 / 14! is 7e-16."""

NOISE_PHASE = 0.25
"""Default sample time of filtered noise, times its highest frequency."""

MOST_INTERVALS = 10_000


@dataclass(frozen=True)
class Layout:
    """Where the excitation's numbers are.

    Attributes
    ----------
    rows
        Dotted name of each numeric field -> its row of a lane.
    values
        Row -> value or range, of these and of the rows that no field sets.
    description
        See `mm_gym.kernels.sources`.
    jets, terms, size
        Row of the first jet, its terms, and the number of a lane's rows.
    intervals_per_step
        Sample intervals of a control step.
    filters
        For each filter, its first row, whether it passes the velocity, and whether it is drawn.
    """

    rows: dict[str, int]
    values: dict[int, NumberOrRange]
    description: NDArray[np.float64]
    jets: int
    terms: int
    size: int
    intervals_per_step: int
    filters: tuple[tuple[int, bool, bool], ...]


def lay_out(scene: Scene) -> Layout:
    """Lay out a scene's excitation.

    Raises
    ------
    SceneError
        If a record cannot be read.
    CompileError
        If a control step has too many sample intervals.
    """
    harmonics = sum(isinstance(part, Harmonic) for part in scene.excitation)
    others = {k: part for k, part in enumerate(scene.excitation) if not isinstance(part, Harmonic)}
    records = {k: _read(part) for k, part in others.items() if isinstance(part, Recorded)}
    terms = _terms(others)
    jets = at.HARMONICS + at.HARMONIC_ROWS * harmonics
    free, next_harmonic = jets + 2 * terms, at.HARMONICS
    rows: dict[str, int] = {}
    values: dict[int, NumberOrRange] = {}
    slots, samples = [float(len(others))], [np.empty(0)]
    filters: list[tuple[int, bool, bool]] = []
    for k, part in enumerate(scene.excitation):
        harmonic = isinstance(part, Harmonic)
        fields, first = (HARMONIC_FIELDS, next_harmonic) if harmonic else (FIELDS[part.kind], free)
        for field, row in fields.items():
            value = getattr(part, field)
            if value is None:
                values[first + row] = NEVER[field]
            elif not isinstance(value, tuple):  # a range is drawn from by the kernel itself
                rows[f"excitation.{k}.{field}"] = first + row
                values[first + row] = scene.randomization.get(f"excitation.{k}.{field}") or value
        if isinstance(part, Harmonic):
            next_harmonic += at.HARMONIC_ROWS
            continue
        if isinstance(part, Noise):
            values |= {first + row: value for row, value in BUTTERWORTH.items()}
        if isinstance(part, FilteredNoise):
            drawn = _is_drawn(values, first)
            filters.append((first, not isinstance(part, Noise), drawn))
        slots += [*_slots(part, first), *_own_slots(part, first, values)]
        if k in records:
            data = 1 + kernels.SIZE * len(others) + sum(len(sample) for sample in samples)
            samples.append(resample(records[k], records[k].time_step))
            slots[-3:] = data, len(samples[-1]), records[k].time_step
        free += _row_count(part, terms)
    return Layout(
        rows=rows,
        values=values,
        description=np.concatenate([slots, *samples]),
        jets=jets,
        terms=terms,
        size=free,
        intervals_per_step=_intervals_per_step(scene, others, records, rows, values),
        filters=tuple(filters),
    )


def _terms(others: dict[int, Source]) -> int:
    if any(isinstance(part, Sweep) for part in others.values()):
        return SWEEP_TERMS
    return 2 if any(not isinstance(part, Impulse) for part in others.values()) else 0


def _row_count(part: Source, terms: int) -> int:
    if isinstance(part, Sweep):
        return kernels.SWEEP_ROWS + 2 * terms
    if isinstance(part, FilteredNoise):
        return noise.FILTER_ROWS
    return kernels.IMPULSE_ROWS if isinstance(part, Impulse) else kernels.RECORD_ROWS


def _is_drawn(values: dict[int, NumberOrRange], first: int) -> bool:
    """Tell whether a filter's own parameters differ between lanes."""
    own = range(first + noise.LOW_PASS, first + noise.HIGH_PASS_DAMPING + 1)
    return any(isinstance(values.get(row), tuple) for row in own)


def _slots(part: Source, first: int) -> list[float]:
    """Return the slots that all sources have: kind, target and first row."""
    kind = {"impulse": kernels.IMPULSE, "sweep": kernels.SWEEP, "record": kernels.RECORD}
    ground = kernels.GROUND if part.target == "ground" else kernels.FORCE
    return [kind.get(part.kind, kernels.FILTER), ground, first]


def _own_slots(part: Source, first: int, values: dict[int, NumberOrRange]) -> list[float]:
    if isinstance(part, Impulse):
        return [isinstance(part.size, tuple), *bounds(part.size)]
    if isinstance(part, Sweep):
        return [part.spacing == "logarithmic", 0.0, 0.0]
    if isinstance(part, FilteredNoise):
        return [not isinstance(part, Noise), _is_drawn(values, first), 0.0]
    return [0.0, 0.0, 0.0]


def _read(part: Recorded) -> Record:
    usual = "N" if part.target == "force" else "m/s^2"
    peer = part.file.lower().endswith(".at2") and part.target == "ground"
    unit = part.unit or ("g" if peer else usual)
    return read_record(part.file, unit=unit, time_step=part.time_step)


def _intervals_per_step(
    scene: Scene,
    others: dict[int, Source],
    records: dict[int, Record],
    rows: dict[str, int],
    values: dict[int, NumberOrRange],
) -> int:
    """Return into how many sample intervals the shortest sample time divides a control step."""
    shortest, name = inf, ""
    for k, part in others.items():

        def end(field: str, which: int, k: int = k) -> float:
            return bounds(values[rows[f"excitation.{k}.{field}"]])[which]

        if isinstance(part, Impulse):
            continue
        if isinstance(part, Sweep):
            time = SWEEP_PHASE / max(end("start_frequency", 1), end("end_frequency", 1))
        elif part.sample_time is not None:
            time = part.sample_time
        elif isinstance(part, Recorded):
            time = records[k].time_step * end("time_scale", 0)
        else:
            frequencies = ("high_frequency", "ground_frequency", "filter_frequency")
            present = [end(field, 1) for field in frequencies if field in FIELDS[part.kind]]
            time = NOISE_PHASE / max(present)
        if time < shortest:
            shortest, name = time, f"excitation.{k}"
    # A sample time may be too short for a double.
    intervals = max(1.0, scene.control.time_step / shortest) if shortest > 0.0 else inf
    if not intervals <= MOST_INTERVALS:
        msg = (
            f"{name}: samples {shortest:.3g} s apart divide control.time_step = "
            f"{scene.control.time_step:g} s into {intervals:.3g} sample intervals; allowed: "
            f"{MOST_INTERVALS}. Shorten the step, or set a longer sample_time"
        )
        raise CompileError(msg)
    return ceil(intervals - 1e-9)
