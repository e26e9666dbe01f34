"""A scene's excitation laid out: its rows, its description, its sample intervals."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf, pi, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import excitation as kernels
from mm_gym.kernels import layout as at
from mm_gym.plant.excitation import HARMONIC, KINDS, Placed
from mm_gym.scene.excitation import Sampled
from mm_gym.scene.scene import bounds

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
        See `mm_gym.kernels.excitation`.
    jets, terms, size
        Row of the first jet, its terms, and the number of a lane's rows.
    intervals_per_step
        Sample intervals of a control step.
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


def lay_out(scene: Scene) -> Layout:
    """Lay out a scene's excitation.

    Raises
    ------
    SceneError
        If a record cannot be read.
    CompileError
        If a control step has too many sample intervals.
    """
    kinds = [KINDS[part.kind] for part in scene.excitation]
    harmonics = sum(kind.code == HARMONIC for kind in kinds)
    jets = at.HARMONICS + at.HARMONIC_ROWS * harmonics
    terms = max((kind.terms for kind in kinds), default=0)
    # Harmonics stand before the jets, all other parts behind them.
    free = {True: at.HARMONICS, False: jets + 2 * terms}
    data = kernels.FIRST + kernels.SIZE * (len(kinds) - harmonics)
    parts: list[Placed[Any]] = []
    for k, kind in enumerate(kinds):
        part, is_harmonic = scene.excitation[k], kind.code == HARMONIC
        samples, step = kind.samples(part)
        name, first = f"excitation.{k}", free[is_harmonic]
        values, period = _values(scene, k), _period(scene)
        parts.append(Placed(kind, part, name, first, values, samples, step, data, period))
        free[is_harmonic] += kind.rows
        data += len(samples)
    return Layout(
        parts=tuple(parts),
        ground=tuple(
            placed.part.target == "ground" for placed in parts if placed.kind.code == HARMONIC
        ),
        names={name: row for placed in parts for name, row in placed.names().items()},
        values={row: value for placed in parts for row, value in placed.rows().items()},
        description=_description(parts),
        jets=jets,
        terms=terms,
        size=free[False],
        intervals_per_step=_intervals_per_step(scene, parts),
    )


def _period(scene: Scene) -> float:
    """Return the shortest period [s] of the carriage, or, if it has no mass, of the sphere."""
    names = ("carriage.mass", "sphere.mass", "carriage.stiffness")
    stated = (scene.carriage.mass, scene.sphere.mass, scene.carriage.stiffness)
    drawn = [scene.randomization.get(*field) for field in zip(names, stated, strict=True)]
    m1, m2 = (bounds(value)[0] for value in drawn[:2])
    return 2.0 * pi * sqrt((m1 or m2) / bounds(drawn[2])[1])


def _values(scene: Scene, k: int) -> dict[str, NumberOrRange]:
    """Return value or range of each numeric field.

    A range that the part itself states is left out: the kernels draw from it as often as they need.
    """
    part = scene.excitation[k]
    values: dict[str, NumberOrRange] = {}
    for name in KINDS[part.kind].fields:
        value: NumberOrRange | None = getattr(part, name)
        if value is None:
            values[name] = NEVER[name]
        elif not isinstance(value, tuple):
            values[name] = scene.range_of(f"excitation.{k}.{name}", value)
    return values


def _description(parts: Parts) -> NDArray[np.float64]:
    described = [placed for placed in parts if placed.kind.code != HARMONIC]
    slots = [float(len(described))]
    for placed in described:
        target = kernels.GROUND if placed.part.target == "ground" else kernels.FORCE
        slots += [placed.kind.code, target, placed.first, *placed.kind.slots(placed)]
    return np.concatenate([slots, *(placed.samples for placed in parts)])


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
