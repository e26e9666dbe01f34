"""Controllers on scenes that are not the ones they were designed for."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from agents.control.scene import drawn_but
from agents.evaluation.contestants import Entry, Episodes
from agents.scoring import evaluate, tail_mean
from mm_gym import Scene, SceneError, compile_scene

NOMINAL = "as designed"

FACTORS = (0.7, 0.8, 0.9, 1.1, 1.2, 1.3)  # of mass, stiffness and damping of the carriage

PARTS = ("mass", "stiffness", "damping")

NOISE, DELAY, RECORD = "noise over scale", "delay [steps]", "record"
"""Studies by name; that of a record goes on with its file."""

LEVELS = (0.01, 0.03, 0.1)  # standard deviations of the noise over each channel's scale
DELAYS = (0, 1, 2, 3)  # ages of the newest frame, in control steps


@dataclass(frozen=True)
class Records:
    """Recorded motions that take the place of the excitation."""

    files: tuple[Path, ...] = ()  # their files
    unit: str | None = None  # of their values; by default g for AT2, else m/s^2 or N


NO_RECORDS = Records()


@dataclass(frozen=True)
class Outcome:
    """What one controller did on one changed scene."""

    # study, level: what is changed, and to which number, as "carriage.mass" and 1.1; a record has
    # no number
    study: str
    level: float
    label: str  # of the controller
    # cost, worst, tail: root of the mean penalty, the largest cost of an episode, and that of the
    # worst tenth [-]
    cost: float
    worst: float
    tail: float
    ratio: float  # cost over that on the scene as designed [-]; NaN where that is 0


def variants(scene: Scene, records: Records = NO_RECORDS) -> dict[tuple[str, float], Scene]:
    """Return the changed scenes by study and level, the scene as it is first.

    What the scene draws is drawn from a range that is changed by the same factor. A scene that
    cannot be changed so, as one without a damper or whose damper is actuated, is left out. Records
    are told apart by their path where two files have one name.
    """
    found = {(NOMINAL, 1.0): scene}
    for part in PARTS:
        name = f"carriage.{part}"
        if name == scene.actuation.damped:  # the number is only where the actuator begins
            continue
        for factor in FACTORS:
            value, ends = getattr(scene.carriage, part), scene.randomization.get(name)
            changed: dict[str, object] = {name: factor * value}
            if ends is not None:
                changed = {f"randomization.{name}": (factor * ends[0], factor * ends[1])}
            if value > 0.0:
                found[name, factor] = scene.replace(**changed)
    channels = compile_scene(scene).observed
    for level in LEVELS:
        own = scene.sensors.noise
        noise = {
            channel.name: float(np.hypot(own.get(channel.name, 0.0), level / channel.factor))
            for channel in channels
        }
        drawn = drawn_but(scene, "sensors.noise.")
        found[NOISE, level] = scene.replace(randomization=drawn, **{"sensors.noise": noise})
    for delay in DELAYS:
        drawn = drawn_but(scene, "sensors.delay")
        found[DELAY, float(delay)] = scene.replace(randomization=drawn, **{"sensors.delay": delay})
    names = [file.name for file in records.files]
    for file in records.files:
        name = file if names.count(file.name) > 1 else file.name
        found[f"{RECORD} {name}", 1.0] = _recorded(scene, file, records.unit)
    return found


def check_records(scenes: Iterable[Scene], records: Records) -> None:
    """Raise `SceneError` if a record cannot be read or does not suit one of the scenes."""
    for scene in scenes:
        for file in records.files:
            try:
                compile_scene(_recorded(scene, file, records.unit))
            except SceneError as error:
                advice = re.sub(r"set unit = '(.*?)'", r"give --unit '\1'", str(error))
                msg = f"--records: {advice}"
                raise SceneError(msg) from None


def _recorded(scene: Scene, file: Path, unit: str | None) -> Scene:
    """Return the scene with a record in place of its excitation."""
    drawn = drawn_but(scene, "excitation.")
    target = scene.excitation[0].target if scene.excitation else "ground"
    part = {"kind": "record", "file": str(file.absolute()), "target": target, "unit": unit}
    return scene.replace(excitation=[part], randomization=drawn)


def outcomes(
    scene: Scene, rows: Sequence[Entry], episodes: Episodes, records: Records = NO_RECORDS
) -> list[Outcome]:
    """Return what every controller of a task does on every changed scene.

    The controllers are those of the scene as it is: they are not told of the change. All go through
    the episodes of the first seed; of a training with several seeds it is the first run.
    """
    found: list[Outcome] = []
    nominal: dict[str, float] = {}
    for study, changed in variants(scene, records).items():
        for row in rows:
            penalties = evaluate(
                changed, row.controllers[0], seed=episodes.first, episodes=episodes.each
            ).penalties
            cost = float(np.sqrt(penalties.mean()))
            tail, worst = (float(np.sqrt(one)) for one in (tail_mean(penalties), penalties.max()))
            designed = nominal.setdefault(row.label, cost)
            ratio = cost / designed if designed else nan
            found.append(Outcome(*study, row.label, cost, worst, tail, ratio))
    return found
