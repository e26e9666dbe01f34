"""Robustness: controllers as designed, on scenes that are not the ones they were designed for."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.comparison.entries import Entry
from agents.evaluation.aggregates import tail_mean
from mm_gym import SceneError, compile_scene

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from agents.comparison.entries import Episodes
    from mm_gym import Scene

NOMINAL = "as designed"

FACTORS = (0.7, 0.8, 0.9, 1.1, 1.2, 1.3)
"""Of mass, stiffness and damping of the carriage."""

PARTS = ("mass", "stiffness", "damping")

NOISE, DELAY, RECORD = "noise over scale", "delay [steps]", "record"
"""Studies by name; that of a record goes on with the name of its file."""

LEVELS = (0.01, 0.03, 0.1)
"""Standard deviations of the noise over each channel's scale."""

DELAYS = (0, 1, 2, 3)
"""Ages of the newest frame, in control steps."""


@dataclass(frozen=True)
class Records:
    """Recorded motions that take the place of the excitation.

    Attributes
    ----------
    files
        Their files.
    unit
        Of their values; by default g for AT2, else m/s^2 or N.
    """

    files: tuple[Path, ...] = ()
    unit: str | None = None


@dataclass(frozen=True)
class Outcome:
    """What one controller did on one changed scene.

    Attributes
    ----------
    study, level
        What is changed, and to which number, as "carriage.mass" and 1.1; a record has no number.
    label
        Of the controller.
    cost, worst, tail
        Root of the mean penalty, the largest cost of an episode, and that of the worst tenth [-].
    ratio
        Cost over that on the scene as designed [-].
    """

    study: str
    level: float
    label: str
    cost: float
    worst: float
    tail: float
    ratio: float


def variants(scene: Scene, records: Records | None = None) -> dict[tuple[str, float], Scene]:
    """Return the changed scenes by study and level, the scene as it is first.

    What the scene draws is drawn from a range that is changed by the same factor. A scene that
    cannot be changed so, as one without a damper, is left out.
    """
    found = {(NOMINAL, 1.0): scene}
    for part in PARTS:
        name = f"carriage.{part}"
        for factor in FACTORS:
            if getattr(scene.carriage, part) > 0.0:
                found[name, factor] = scene.replace(**_scaled(scene, name, factor))
    channels = compile_scene(scene).observed
    for level in LEVELS:
        own = scene.sensors.noise
        noise = {
            channel.name: float(np.hypot(own.get(channel.name, 0.0), level / channel.factor))
            for channel in channels
        }
        found[NOISE, level] = scene.replace(**{"sensors.noise": noise})
    for delay in DELAYS:
        found[DELAY, float(delay)] = scene.replace(**{"sensors.delay": delay})
    for file, unit in _files(records):
        found[f"{RECORD} {file.name}", 1.0] = _recorded(scene, file, unit)
    return found


def _scaled(scene: Scene, name: str, factor: float) -> dict[str, object]:
    if name in scene.randomization:
        low, high = scene.randomization[name]
        return {f"randomization.{name}": (factor * low, factor * high)}
    return {name: factor * getattr(scene.carriage, name.partition(".")[2])}


def check_records(scenes: Iterable[Scene], records: Records | None) -> None:
    """Raise `SceneError` if a record cannot be read or does not suit one of the scenes."""
    for scene in scenes:
        for file, unit in _files(records):
            try:
                compile_scene(_recorded(scene, file, unit))
            except SceneError as error:
                advice = re.sub(r"set unit = '(.*?)'", r"give --unit '\1'", str(error))
                msg = f"--records: {advice}"
                raise SceneError(msg) from None


def _files(records: Records | None) -> list[tuple[Path, str | None]]:
    return [] if records is None else [(file, records.unit) for file in records.files]


def _recorded(scene: Scene, file: Path, unit: str | None) -> Scene:
    """Return the scene with a record in place of its excitation."""
    drawn = {
        name: ends
        for name, ends in scene.randomization.items()
        if not str(name).startswith("excitation.")
    }
    target = scene.excitation[0].target if scene.excitation else "ground"
    part = {"kind": "record", "file": str(file.absolute()), "target": target, "unit": unit}
    return scene.replace(excitation=[part], randomization=drawn)


def outcomes(
    scene: Scene,
    rows: Sequence[Entry],
    episodes: Episodes,
    records: Records | None = None,
    *,
    studies: Sequence[str] = (),
) -> list[Outcome]:
    """Return what every controller of a task does on every changed scene.

    The controllers are those of the scene as it is: they are not told of the change. All go through
    the episodes of the first seed; of a training with several seeds it is the first run. Without
    names of studies it is all of them.
    """
    found: list[Outcome] = []
    nominal: dict[str, float] = {}
    for study, changed in variants(scene, records).items():
        if studies and study[0] not in (NOMINAL, *studies):
            continue
        for row in rows:
            outcome = _outcome(changed, row, episodes.of(0), study, nominal)
            nominal.setdefault(row.label, outcome.cost)
            found.append(outcome)
    return found


def _outcome(
    scene: Scene,
    row: Entry,
    episodes: Episodes,
    study: tuple[str, float],
    nominal: Mapping[str, float],
) -> Outcome:
    penalties = Entry(row.label, row.controllers[:1]).penalties(scene, episodes)
    cost = float(np.sqrt(penalties.mean()))
    return Outcome(
        *study,
        label=row.label,
        cost=cost,
        worst=float(np.sqrt(penalties.max())),
        tail=float(np.sqrt(tail_mean(penalties))),
        ratio=cost / nominal.get(row.label, cost),
    )
