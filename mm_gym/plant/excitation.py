"""A scene's excitation: its kinds, one row each, and its rows, description and sample intervals."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import ceil, expm1, inf, log, sqrt
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import CompileError, SceneError, refuse
from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process, noise, record
from mm_gym.excitation import kinds as kernels
from mm_gym.lanes import layout
from mm_gym.records.options import Options
from mm_gym.records.record import Record, read_with
from mm_gym.records.spectrum import peak_responses
from mm_gym.scene.excitation import FilteredNoise, Impulse, NumberOrRange, Recorded, Sampled, Sweep
from mm_gym.scene.part import Part
from mm_gym.scene.scene import Scene, bounds

Slots = tuple[float, float, float, float]

NUMBER = "record"  # field of the number of an episode's record in a set, which nobody states
MOST_SAMPLES = 10_000_000  # samples of the records of a part, at most, of 16 bytes each
HARMONIC = -1  # code of a harmonic, which has no branch in the kernels: the methods know its rows

P = TypeVar("P", bound="Part")

SWEEP_REMAINDER = 2e-14
"""Bound of what a sweep's series may leave out, relative to its amplitude; in truth some tenth."""

MOST_PER_TURN = 64
"""Sample intervals to `kernels.LONGEST_TURN`, at most, that a fast sweep asks for."""

NOISE_PHASE = 0.25  # longest default sample time of filtered noise, times its highest frequency
MOST_IMPULSES = 16.0  # random impulses that fall into a sample interval on average, at most

SHORTFALL = 0.01
"""Most that the standard deviation half-way between two samples of noise is below theirs, unless
`sample_time` is set."""


@dataclass(frozen=True)
class Kind(Generic[P]):
    """How a kind of excitation is compiled."""

    fields: dict[str, int]  # numeric field -> its row among those of a part
    rows: int  # of a part
    code: int = HARMONIC  # of its branches in `mm_gym.excitation.kinds`
    terms: int = 0  # coefficients of what it adds to a jet
    # row -> value, of rows that no field sets
    constants: dict[int, float] = field(default_factory=dict[int, float])
    # the longest sample interval [s] where the part asks for none
    interval: Callable[[Placed[P]], float] = lambda _: inf
    # times [s] and values (2, n) that the kernels interpolate, and the shortest spacing [s]
    samples: Callable[[P], tuple[Array, float]] = lambda _: (np.empty(0), 0.0)
    # the kind's own slots of the description
    slots: Callable[[Placed[P]], Slots] = lambda _: (0.0, 0.0, 0.0, 0.0)
    # how many more rows follow from fields that are drawn
    drawn_rows: Callable[[Placed[P]], int] = lambda _: 0
    # writes what follows from the fields into a description (n,), for a sample interval [s]
    prepare: Callable[[Placed[P], Array, float], None] = lambda _, __, ___: None

    def fields_of(self, part: P) -> dict[str, int]:
        """Return numeric field of a part -> its row, in which a record has other fields too."""
        return _record_fields(part) if isinstance(part, Recorded) else self.fields


@dataclass(frozen=True)
class Placed(Generic[P]):
    """A part of a scene's excitation, with the place of its numbers."""

    kind: Kind[P]
    part: P
    name: str  # dotted, such as "excitation.0"
    first: int  # its first row
    values: dict[str, NumberOrRange]  # field -> value, or range of values
    samples: Array  # these, and the step, are what `Kind.samples` returned
    step: float
    data: int  # slot of the description at which the samples begin

    def lowest(self, name: str) -> float:
        """Return the least value of a field."""
        return bounds(self.values[name])[0]

    def highest(self, name: str) -> float:
        """Return the largest value of a field."""
        return bounds(self.values[name])[1]

    def names(self) -> dict[str, int]:
        """Return the dotted name of each field that can be set -> its row of a lane."""
        return {
            f"{self.name}.{name}": self.first + self.kind.fields_of(self.part)[name]
            for name in self.values
            if name == NUMBER or self.part.value_of(name) is not None
        }

    def rows(self) -> dict[int, NumberOrRange]:
        """Return row of a lane -> value or range, also of the rows that no field sets."""
        rows = self.kind.fields_of(self.part)
        own = {rows[name]: value for name, value in self.values.items()}
        return {self.first + row: value for row, value in (self.kind.constants | own).items()}


def _sweep_interval(placed: Placed[Sweep]) -> float:
    """Return the longest sample interval [s] over which the series of a sweep is right."""
    lowest = [placed.lowest(name) for name in ("start_frequency", "end_frequency")]
    highest = [placed.highest(name) for name in ("start_frequency", "end_frequency")]
    longest = kernels.LONGEST_TURN / max(highest)
    duration = max(placed.lowest("duration"), longest)
    spread = log(max(highest[0] / lowest[1], highest[1] / lowest[0]))
    is_logarithmic = placed.part.spacing == "logarithmic"
    change = spread if is_logarithmic else -expm1(-spread)
    for parts in range(1, MOST_PER_TURN + 1):
        interval, turn = longest / parts, kernels.LONGEST_TURN / parts
        growth = change * interval / duration
        if _sweep_remainder(turn, growth, is_logarithmic=is_logarithmic) <= SWEEP_REMAINDER:
            return interval
    return longest / MOST_PER_TURN


def _sweep_remainder(turn: float, growth: float, *, is_logarithmic: bool) -> float:
    """Return a bound of what the series of sin(phase) leaves out over a sample interval.

    The phase turns by at most `turn` [rad]; by `growth` changes the frequency, relative to its
    highest, or its logarithm. On a circle of radius r about the start |sin(phase)| is at most
    exp(phase(r)), and so is each coefficient times r^n (Cauchy).
    """
    r = np.linspace(2.0, 40.0, 77)
    if is_logarithmic and growth > 0.0:
        phase = turn * np.expm1(growth * r) / growth
    else:
        phase = turn * (r + 0.5 * growth * r**2)
    n = kernels.SWEEP_TERMS
    return float(np.exp(np.min(phase - n * np.log(r) - np.log1p(-1.0 / r))))


def _impulse_interval(placed: Placed[Impulse]) -> float:
    rate = placed.highest("rate")
    return MOST_IMPULSES / rate if rate > 0.0 else inf


def _impulse_slots(placed: Placed[Impulse]) -> Slots:
    size = placed.part.size
    return float(isinstance(size, tuple)), *bounds(size), 0.0


def _record_fields(part: Recorded) -> dict[str, int]:
    """Return field -> row: of what a record is scaled to, and of the number in a set."""
    fields = {"time_scale": record.TIME_SCALE, "start": record.START}
    if part.scale_to is None:
        fields["scale"] = record.SCALE
    elif part.scale_to.peak is not None:
        fields["scale_to.peak"] = record.SCALE
    else:
        fields["scale_to.spectral_acceleration"] = record.SCALE
    return fields | ({NUMBER: record.NUMBER} if part.files is not None else {})


def _record_samples(part: Recorded) -> tuple[Array, float]:
    is_force = part.target == "force" and part.inertial_mass is None
    options = Options(
        unit=part.unit or ("N" if is_force else None),  # a force is never in PEER's g
        time_step=part.time_step,
        column=part.column,
        skip=part.skip,
        variable=part.variable,
        usual="m/s^2",
    )
    mass = 1.0 if part.inertial_mass is None else -part.inertial_mass
    motions: list[Array] = []
    factors: list[float] = []
    shortest, total = inf, 0
    for file in part.paths:
        motion = read_with(Path(file), options)
        total += len(motion.times)
        if total > MOST_SAMPLES:
            refuse(f"{file}", f"{total} samples in the files up to it", f"{MOST_SAMPLES}")
        motions.append(np.vstack([motion.times, mass * motion.values]))
        factors.append(_factor(part, file, motion))
        shortest = min(shortest, motion.time_step)
    return record.block_of(motions, factors, record.ROUND_OFF), shortest


def _factor(part: Recorded, file: str, motion: Record) -> float:
    """Return the factor that makes a record's measure 1, if it is scaled to a value of that."""
    scale_to = part.scale_to
    if scale_to is None:
        return 1.0
    if scale_to.period is None:
        measure = float(np.max(np.abs(motion.values)))
    else:  # an oscillator of period T under a record slowed by s is one of period T / s under it
        period = scale_to.period / part.time_scale
        measure = peak_responses(motion.times, motion.values, period, scale_to.damping)[0].item()
    if not measure > 0.0:
        msg = f"{file}: all samples are 0; allowed: a record that can be scaled"
        raise SceneError(msg)
    return 1.0 / measure


def _record_slots(placed: Placed[Recorded]) -> Slots:
    count = record_count(placed)
    table = placed.samples[: record.LINE * count].reshape(count, record.LINE)
    return placed.data, count, float(np.all(table[:, record.SPACING] > 0.0)), 0.0


def record_count(placed: Placed[Recorded]) -> int:
    """Return the number of records in a set: its first one begins behind the table."""
    return int(placed.samples[record.DATA]) // record.LINE


def motions_of(placed: Placed[Recorded]) -> Iterator[Array]:
    """Yield times [s] and values (2, n) of each record in a set."""
    for number in range(record_count(placed)):
        yield record.points_in(placed.samples, number)[0]


def _noise_phase(filters: Array, *, passes_velocity: bool) -> float:
    """Return the longest interval [s] of filters with a highest frequency of 1 rad/s."""

    def falls_short(interval: float) -> bool:
        matrices = shaping.filter_matrices(filters, interval, passes_velocity=passes_velocity)
        root = np.zeros((shaping.ORDER, shaping.ORDER))
        root[np.tril_indices(shaping.ORDER)] = matrices[shaping.START_SPREAD : shaping.OUTPUT]
        spread = matrices[shaping.OUTPUT :] @ root
        # The covariance of two neighbours is 3 - 2 variance, by (E15).
        variance = spread @ spread
        return bool(0.5 * (3.0 - variance) < (1.0 - SHORTFALL) ** 2 * variance)

    low, high = NOISE_PHASE, NOISE_PHASE
    while falls_short(low):
        low, high = 0.5 * low, low
    for _ in range(20 if low < high else 0):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if falls_short(middle) else (middle, high)
    return low


def _is_level(placed: Placed[FilteredNoise]) -> bool:
    """Tell whether the envelope is 1 at all times."""
    falls = placed.lowest("plateau") < inf and placed.highest("decay") > 0.0
    return placed.highest("rise") == 0.0 and not falls


def _filtered(
    fields: dict[str, int], *, passes_velocity: bool, constants: dict[int, float] | None = None
) -> Kind[FilteredNoise]:
    """Return a kind of filtered noise, see `mm_gym.excitation.filters.write_matrices`."""
    filters = {name: row for name, row in fields.items() if row in noise.FILTER}
    frequencies = {noise.LOW_PASS, noise.HIGH_PASS}

    def rows_of(placed: Placed[FilteredNoise], values: Iterable[float]) -> Array:
        """Return the filters whose fields have these values, (2, 2)."""
        rows = np.zeros(noise.HIGH_PASS_DAMPING + 1)
        given = placed.kind.constants | dict(zip(filters.values(), values, strict=True))
        rows[list(given)] = list(given.values())
        return rows[noise.LOW_PASS :].reshape(2, 2)

    def interval(placed: Placed[FilteredNoise]) -> float:
        highest = max(placed.highest(name) for name in filters if filters[name] in frequencies)
        shortest = NOISE_PHASE
        for corner in product(*({placed.lowest(name), placed.highest(name)} for name in filters)):
            scaled = rows_of(placed, corner) / [highest, 1.0]
            shortest = min(shortest, _noise_phase(scaled, passes_velocity=passes_velocity))
        return shortest / highest

    def is_drawn(placed: Placed[FilteredNoise]) -> bool:
        return any(placed.lowest(name) != placed.highest(name) for name in filters)

    def states(placed: Placed[FilteredNoise]) -> int:
        has_high_pass = any(
            placed.highest(name) > 0.0 for name in filters if filters[name] == noise.HIGH_PASS
        )
        return shaping.ORDER if has_high_pass else shaping.ORDER // 2

    def slots(placed: Placed[FilteredNoise]) -> Slots:
        place = 0.0 if is_drawn(placed) else placed.data
        return passes_velocity, states(placed), place, _is_level(placed)

    def prepare(placed: Placed[FilteredNoise], described: Array, interval: float) -> None:
        if not is_drawn(placed):  # else each lane has its own
            own = rows_of(placed, [placed.lowest(name) for name in filters])
            described[placed.data : placed.data + shaping.MATRICES] = shaping.filter_matrices(
                own, interval, passes_velocity=passes_velocity
            )

    envelope = {"rise": noise.RISE, "plateau": noise.PLATEAU, "decay": noise.DECAY}
    return Kind(
        fields={"rms": noise.RMS} | envelope | fields,
        rows=noise.ROWS,
        code=kernels.FILTER,
        terms=2,
        constants=constants or {},
        interval=interval,
        samples=lambda _: (np.zeros(shaping.MATRICES), 0.0),
        slots=slots,
        drawn_rows=lambda placed: shaping.MATRICES if is_drawn(placed) else 0,
        prepare=prepare,
    )


SOIL = {"ground_frequency": noise.LOW_PASS, "ground_damping": noise.LOW_PASS_DAMPING}
HIGH_PASS = {"filter_frequency": noise.HIGH_PASS, "filter_damping": noise.HIGH_PASS_DAMPING}
BUTTERWORTH = {noise.LOW_PASS_DAMPING: sqrt(0.5), noise.HIGH_PASS_DAMPING: sqrt(0.5)}

KINDS: dict[str, Kind[Any]] = {
    "harmonic": Kind(
        fields={
            "amplitude": layout.AMPLITUDE,
            "frequency": layout.FREQUENCY,
            "phase": layout.PHASE,
        },
        rows=layout.HARMONIC_ROWS,
    ),
    "sweep": Kind(
        fields={
            "amplitude": kernels.SWEEP_AMPLITUDE,
            "start_frequency": kernels.START_FREQUENCY,
            "end_frequency": kernels.END_FREQUENCY,
            "duration": kernels.DURATION,
            "phase": kernels.SWEEP_PHASE,
        },
        rows=kernels.SWEEP_ROWS,
        code=kernels.SWEEP,
        terms=kernels.SWEEP_TERMS,
        interval=_sweep_interval,
        slots=lambda placed: (float(placed.part.spacing == "logarithmic"), 0.0, 0.0, 0.0),
    ),
    "noise": _filtered(
        {"low_frequency": noise.HIGH_PASS, "high_frequency": noise.LOW_PASS},
        passes_velocity=False,
        constants=BUTTERWORTH,
    ),
    "kanai_tajimi": _filtered(SOIL, passes_velocity=True),
    "clough_penzien": _filtered(SOIL | HIGH_PASS, passes_velocity=True),
    "impulse": Kind(
        fields={
            "size": impulse_process.SIZE,
            "rate": impulse_process.RATE,
            "time": impulse_process.TIME,
        },
        rows=impulse_process.ROWS,
        code=kernels.IMPULSE,
        interval=_impulse_interval,
        slots=_impulse_slots,
    ),
    "record": Kind(
        fields={},  # see `_record_fields`
        rows=record.ROWS,
        code=kernels.RECORD,
        terms=2,
        constants={record.NUMBER: 0.0},  # of one record
        interval=lambda placed: placed.step * placed.lowest("time_scale"),
        samples=_record_samples,
        slots=_record_slots,
    ),
}
"""Kind of excitation, by the name that a scene gives it -> how it is compiled."""


def samples_of(name: str, part: Any) -> tuple[Any, Array, float]:  # noqa: ANN401 - of any kind
    """Return a part, whose pattern of files is replaced by what it found, and its `Kind.samples`.

    A record that cannot be read is refused with field, file, line and column.
    """
    try:
        if isinstance(part, Recorded) and part.files is not None:
            part = part.model_copy(update={"files": part.paths})
        return part, *KINDS[part.kind].samples(part)
    except SceneError as error:
        msg = f"{name}.{part.source}: {error}"
        raise SceneError(msg) from error


NEVER = {"plateau": inf, "time": inf}  # values of the fields that may be left out
MOST_INTERVALS = 10_000  # sample intervals of a control step

CORNERED_PHASE = 0.5
"""Longest sample interval with corners of records inside, times the plant's fastest rate."""

MOST_CORNERED = 1000  # sample intervals of a control step that the fastest rate may ask for
ON_GRID = 1e-10  # part of a sample interval below which a corner is at its end


@dataclass(frozen=True)
class Layout:
    """Where the excitation's numbers are."""

    parts: tuple[Placed[Any], ...]
    ground: tuple[bool, ...]  # for each harmonic, whether it shakes the ground
    names: dict[str, int]  # dotted name of each field that can be set -> its row of a lane
    values: dict[int, NumberOrRange]  # of rows, also of those that no field sets
    description: Array  # see `mm_gym.excitation.kinds`
    jets: int  # row of the first jet
    terms: int  # of a jet
    size: int  # number of a lane's rows
    intervals_per_step: int
    records: dict[str, tuple[str, ...]]  # of sets of records -> files, in their numbers' order


def lay_out(scene: Scene, rate: float, turn: float = inf) -> Layout:
    """Lay out a scene's excitation, given the fastest rate of its plant [1/s].

    In a sample interval a harmonic may turn by so much [rad].
    """
    parts = _parts(scene)
    intervals, has_corners = _divide(scene, parts, rate)
    frequencies = [one.highest("frequency") for one in parts if one.kind.code == HARMONIC]
    many = scene.control.time_step * max(frequencies, default=0.0) / intervals / turn
    intervals *= max(1, ceil(min(many, 2.0 * MOST_INTERVALS) - 1e-9))
    if intervals > MOST_INTERVALS:
        msg = (
            f"excitation: a harmonic divides control.time_step = {scene.control.time_step:g} s "
            f"into {many:.3g} sample intervals; allowed: {MOST_INTERVALS}. Shorten the step"
        )
        raise CompileError(msg)
    terms = max((placed.kind.terms for placed in parts), default=0)
    terms = max(terms, record.TERMS) if has_corners else terms
    harmonics = sum(placed.kind.code == HARMONIC for placed in parts)
    jets = layout.HARMONICS + layout.HARMONIC_ROWS * harmonics
    # Harmonics stand before the jets, all other parts behind them.
    free = {True: layout.HARMONICS, False: jets + 2 * terms}
    for k, placed in enumerate(parts):
        is_harmonic = placed.kind.code == HARMONIC
        parts[k] = replace(placed, first=free[is_harmonic])
        free[is_harmonic] += placed.kind.rows + placed.kind.drawn_rows(placed)
    for placed in parts:
        if placed.part.kind == "record":
            _warn_of_rest(scene, placed)
    return Layout(
        parts=tuple(parts),
        ground=tuple(
            placed.part.target == "ground" for placed in parts if placed.kind.code == HARMONIC
        ),
        names={name: row for placed in parts for name, row in placed.names().items()},
        values={row: value for placed in parts for row, value in placed.rows().items()},
        description=_description(parts, has_corners=has_corners),
        jets=jets,
        terms=terms,
        size=free[False],
        intervals_per_step=intervals,
        records={
            placed.name: placed.part.paths
            for placed in parts
            if isinstance(placed.part, Recorded) and placed.part.files is not None
        },
    )


def _parts(scene: Scene) -> list[Placed[Any]]:
    """Return the parts of a scene's excitation, without their rows."""
    kinds = [KINDS[part.kind] for part in scene.excitation]
    data = kernels.FIRST + kernels.SIZE * sum(kind.code != HARMONIC for kind in kinds)
    parts: list[Placed[Any]] = []
    for k, kind in enumerate(kinds):
        name = f"excitation.{k}"
        part, samples, step = samples_of(name, scene.excitation[k])
        values = _values(scene, k, part)
        parts.append(Placed(kind, part, name, 0, values, samples, step, data))
        data += samples.size
    return parts


def _values(scene: Scene, k: int, part: Any) -> dict[str, NumberOrRange]:  # noqa: ANN401 - of any kind
    """Return value or range of each numeric field.

    A range that the part itself states is left out: the kernels draw from it as often as they need.
    """
    values: dict[str, NumberOrRange] = {}
    for name in KINDS[part.kind].fields_of(part):
        value: NumberOrRange | None = part.value_of(name)
        if name == NUMBER:
            values[name] = 0.0, float(len(part.files))
        elif value is None:
            values[name] = NEVER[name]
        elif name.startswith("scale_to"):
            values[name] = value
        elif not isinstance(value, tuple):
            values[name] = scene.range_of(f"excitation.{k}.{name}", value)
    return values


def _description(parts: Sequence[Placed[Any]], *, has_corners: bool) -> Array:
    described = [placed for placed in parts if placed.kind.code != HARMONIC]
    codes = {placed.kind.code for placed in described}
    slots = [len(described), has_corners, kernels.IMPULSE in codes, kernels.RECORD in codes]
    for placed in described:
        target = kernels.GROUND if placed.part.target == "ground" else kernels.FORCE
        slots += [placed.kind.code, target, placed.first, *placed.kind.slots(placed)]
    return np.concatenate([slots, *(placed.samples.ravel() for placed in parts)])


def _divide(scene: Scene, parts: Sequence[Placed[Any]], rate: float) -> tuple[int, bool]:
    """Return the sample intervals of a control step, and whether corners of records lie inside.

    The corners become sample instants where the spacing of the samples allows it.
    """
    step = scene.control.time_step
    records = [placed for placed in parts if placed.part.kind == "record"]
    own = [placed for placed in records if placed.part.sample_time is None]
    others = [placed for placed in parts if placed not in own]
    shortest = min((_sample_time(placed) for placed in own), default=inf)
    if not records or step <= MOST_INTERVALS * shortest:
        intervals = _intervals_per_step(scene, parts)
        if all(_is_on_grid(placed, step / intervals) for placed in records):
            return intervals, False
    phase = min(rate * step, MOST_CORNERED * CORNERED_PHASE)  # a NaN is the second
    return max(_intervals_per_step(scene, others), ceil(phase / CORNERED_PHASE)), True


def _is_on_grid(placed: Placed[Recorded], interval: float) -> bool:
    """Tell whether the corners of all records of a set are sample instants in all episodes."""
    scale, start = placed.lowest("time_scale"), placed.lowest("start")
    if scale != placed.highest("time_scale") or start != placed.highest("start"):
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        for times, _ in motions_of(placed):
            places: Array = (times - start) * scale / interval
            close = ON_GRID + record.ROUND_OFF * np.abs(places)
            if np.any((np.abs(places - np.round(places)) > close) & (places > 0.0)):
                return False
    return True


def _warn_of_rest(scene: Scene, placed: Placed[Recorded]) -> None:
    """Warn of records that no episode reaches the end of."""
    ends: list[float] = []
    for times, values in motions_of(placed):
        shaken = np.flatnonzero(values)
        ends.append(float(times[min(shaken[-1] + 1, len(times) - 1)]) if shaken.size else 0.0)
    lasts = scene.control.steps * scene.control.time_step
    with np.errstate(over="ignore", divide="ignore"):
        reached = placed.highest("start") + np.divide(lasts, placed.lowest("time_scale"))
    late = [end for end in ends if end > reached * (1.0 + 1e-9)]
    if late:
        several = f"{len(late)} of {len(ends)} records last up to"
        which = "the record lasts" if len(ends) == 1 else several
        warnings.warn(
            f"{placed.name}: {which} {max(late):g} s, of which an episode of {lasts:g} s "
            f"reaches {reached:g} s; set control.steps, start or time_scale if the rest matters",
            stacklevel=6,  # where `compile_scene` was called
        )


def _intervals_per_step(scene: Scene, parts: Sequence[Placed[Any]]) -> int:
    """Return into how many sample intervals the shortest sample time divides a control step."""
    times = {placed.name: _sample_time(placed) for placed in parts} | {"": inf}
    name = min(times, key=lambda name: times[name])
    shortest = times[name]
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


def _sample_time(placed: Placed[Any]) -> float:
    """Return the longest sample interval [s] that a part asks for or allows."""
    asked = placed.part.sample_time if isinstance(placed.part, Sampled) else None
    return placed.kind.interval(placed) if asked is None else asked
