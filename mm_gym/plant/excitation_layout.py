"""A scene's excitation laid out: its rows, its description, its sample intervals."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from math import ceil, inf
from typing import TYPE_CHECKING, Any

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import record
from mm_gym.lanes import layout as at
from mm_gym.plant.excitation import HARMONIC, KINDS, NUMBER, Placed, motions_of, samples_of
from mm_gym.scene.excitation import Recorded, Sampled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from mm_gym.scene.excitation import NumberOrRange
    from mm_gym.scene.scene import Scene

    Parts = Sequence[Placed[Any]]

NEVER = {"plateau": inf, "time": inf}
"""Values of the fields that may be left out."""

MOST_INTERVALS = 10_000
"""Sample intervals of a control step."""

CORNERED_PHASE = 0.5
"""Longest sample interval with corners of records inside, times the plant's fastest rate."""

MOST_CORNERED = 1000
"""Sample intervals of a control step that the fastest rate may ask for."""

ON_GRID = 1e-10
"""Part of a sample interval below which a corner is at its end."""


@dataclass(frozen=True)
class Layout:
    """Where the excitation's numbers are.

    Attributes
    ----------
    parts
        The parts of the excitation.
    ground
        For each harmonic, whether it shakes the ground.
    names
        Dotted name of each field that can be set -> its row of a lane.
    values
        Row -> value or range, also of the rows that no field sets.
    description
        See `mm_gym.excitation.kinds`.
    jets, terms, size
        Row of the first jet, its terms, and the number of a lane's rows.
    intervals_per_step
        Sample intervals of a control step.
    records
        Dotted name of each set of records -> its files, in the order of their numbers.
    """

    parts: tuple[Placed[Any], ...]
    ground: tuple[bool, ...]
    names: dict[str, int]
    values: dict[int, NumberOrRange]
    description: NDArray[np.float64]
    jets: int
    terms: int
    size: int
    intervals_per_step: int
    records: dict[str, tuple[str, ...]]


def lay_out(scene: Scene, rate: float, turn: float = inf) -> Layout:
    """Lay out a scene's excitation.

    Parameters
    ----------
    scene
        The scene.
    rate
        The fastest rate of its plant [1/s].
    turn
        By how much a harmonic may turn in a sample interval [rad].

    Raises
    ------
    SceneError
        If a record cannot be read; the message names its field.
    CompileError
        If a control step has too many sample intervals.
    """
    parts = _parts(scene)
    intervals, has_corners = _divide(scene, parts, rate)
    many = _fastest_turn(scene, parts) / intervals / turn
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
    jets = at.HARMONICS + at.HARMONIC_ROWS * harmonics
    # Harmonics stand before the jets, all other parts behind them.
    free = {True: at.HARMONICS, False: jets + 2 * terms}
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


def _description(parts: Parts, *, has_corners: bool) -> NDArray[np.float64]:
    described = [placed for placed in parts if placed.kind.code != HARMONIC]
    codes = {placed.kind.code for placed in described}
    slots = [len(described), has_corners, kernels.IMPULSE in codes, kernels.RECORD in codes]
    for placed in described:
        target = kernels.GROUND if placed.part.target == "ground" else kernels.FORCE
        slots += [placed.kind.code, target, placed.first, *placed.kind.slots(placed)]
    return np.concatenate([slots, *(placed.samples.ravel() for placed in parts)])


def _divide(scene: Scene, parts: Parts, rate: float) -> tuple[int, bool]:
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


def _fastest_turn(scene: Scene, parts: Parts) -> float:
    """Return the most that a harmonic turns in a control step [rad]."""
    frequencies = [one.highest("frequency") for one in parts if one.kind.code == HARMONIC]
    return scene.control.time_step * max(frequencies, default=0.0)


def _is_on_grid(placed: Placed[Recorded], interval: float) -> bool:
    """Tell whether the corners of all records of a set are sample instants in all episodes."""
    scale, start = placed.lowest("time_scale"), placed.lowest("start")
    if scale != placed.highest("time_scale") or start != placed.highest("start"):
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        for times, _ in motions_of(placed):
            places: NDArray[np.float64] = (times - start) * scale / interval
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
        which = (
            "the record lasts"
            if len(ends) == 1
            else f"{len(late)} of {len(ends)} records last up to"
        )
        warnings.warn(
            f"{placed.name}: {which} {max(late):g} s, of which an episode of {lasts:g} s "
            f"reaches {reached:g} s; set control.steps, start or time_scale if the rest matters",
            stacklevel=6,  # where `compile_scene` was called
        )


def _intervals_per_step(scene: Scene, parts: Parts) -> int:
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
