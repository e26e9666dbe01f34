"""Measurement of a comparison: every contestant of a task in the same episodes, and studies.

In **robustness** controllers run as designed on scenes that are not the ones they were designed
for. The **frequency** response is the steady one of the closed loop, at several amplitudes.
**Effort** compares response and effort with those of no control and of the best passive damper.
"""

import multiprocessing
import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from math import nan
from pathlib import Path

import numpy as np
from scipy.signal import periodogram

from agents.control.controller import Controller, Reads
from agents.control.scene import ENDLESS, drawn_but
from agents.controllers.constant import best_constant
from agents.controllers.tuned import NOT_SCORED, Baselines, baselines
from agents.evaluation.aggregates import Sample
from agents.evaluation.contestants import Entry, Episodes, Field
from agents.rollout import Rollout
from agents.scoring import evaluate, spread_frequency, tail_mean, validation_cost
from mm_gym import (
    CompileError,
    DesignError,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    metrics,
)
from mm_gym.arrays import Array

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


def variants(scene: Scene, records: Records | None = None) -> dict[tuple[str, float], Scene]:
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
    files = records.files if records else ()
    names = [file.name for file in files]
    for file in files:
        name = file if names.count(file.name) > 1 else file.name
        found[f"{RECORD} {name}", 1.0] = _recorded(scene, file, records.unit)
    return found


def check_records(scenes: Iterable[Scene], records: Records | None) -> None:
    """Raise `SceneError` if a record cannot be read or does not suit one of the scenes."""
    for scene in scenes:
        for file in records.files if records else ():
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
    scene: Scene, rows: Sequence[Entry], episodes: Episodes, records: Records | None = None
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


POINTS = 192
"""Frequencies, from `SPAN` of the carriage's own, evenly over their logarithm: in steps of 0.8 %,
so that the peaks of a damped absorber are drawn round."""

SPAN = (0.4, 2.0)

DEFLECTIONS = (0.1, 0.3, 1.0)
"""Amplitudes of the force: static deflections of the carriage over its displacement_scale."""

PERIODS = (60, 20)
"""Periods of the carriage's own frequency that are waited for, and that are measured then."""

NAME = "excitation.0"


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The steady response of one controller."""

    label: str  # of the controller
    frequencies: Array  # (n,) of the force [rad/s]
    forces: Array  # (m,) its amplitudes [N]
    # (m, n) amplitude of x1 at the frequency of the force over the static deflection F / k1 [-].
    gain: Array
    # (m, n) root mean square of the rest of x1 over that of all [-]: 0 if x1 is harmonic.
    distortion: Array


def closed_loop(scene: Scene, controller: Controller, label: str) -> ClosedLoop:
    """Measure the steady response of a controller, each frequency and amplitude in a lane.

    A harmonic force takes the place of the scene's excitation; the sensors' noise and delay stay.
    """
    stiffness = scene.carriage.stiffness
    own = float(np.sqrt(stiffness / scene.carriage.mass))
    frequencies = own * np.geomspace(*SPAN, POINTS)
    forces = stiffness * scene.objective.displacement_scale * np.array(DEFLECTIONS)
    lanes = {
        f"{NAME}.frequency": np.tile(frequencies, len(forces)),
        f"{NAME}.amplitude": np.repeat(forces, POINTS),
    }
    step = scene.control.time_step
    waited, measured = (round(count * 2.0 * np.pi / own / step) for count in PERIODS)
    shaken = _shaken(scene, lanes, waited + measured)
    env = MovingMassVectorEnv(shaken, len(forces) * POINTS, autoreset_mode="Disabled")
    rollout = Rollout(env, controller, seed=0, options=lanes)
    displacement = np.stack([made.info["state"][:, 0].copy() for made in rollout])[waited:]
    time = step * np.arange(waited + 1, waited + measured + 1)
    gain, distortion = _harmonic_part(time, displacement, lanes[f"{NAME}.frequency"])
    shape = len(forces), POINTS
    static = np.repeat(forces / stiffness, POINTS)
    return ClosedLoop(
        label, frequencies, forces, (gain / static).reshape(shape), distortion.reshape(shape)
    )


def _shaken(scene: Scene, lanes: dict[str, Array], steps: int) -> Scene:
    """Return the scene at rest under a harmonic force whose numbers are drawn."""
    drawn = drawn_but(scene, "excitation.")
    harmonic = {"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}
    stretch = {} if scene.springs.kind == "none" else {"stretch": scene.initial.stretch}
    return scene.replace(
        excitation=[harmonic],
        initial=stretch,
        randomization=drawn | {name: (float(v.min()), float(v.max())) for name, v in lanes.items()},
        **ENDLESS,
        **{"control.steps": steps},
    )


def _harmonic_part(time: Array, values: Array, frequencies: Array) -> tuple[Array, Array]:
    """Return the amplitude (lanes,) at each frequency, and how much of the values is not of it.

    Least squares of a constant and a harmonic: the time need not be whole periods.
    """
    amplitude, rest = np.empty(len(frequencies)), np.empty(len(frequencies))
    for lane, w in enumerate(frequencies):
        basis = np.column_stack([np.ones_like(time), np.cos(w * time), np.sin(w * time)])
        found, *_ = np.linalg.lstsq(basis, values[:, lane], rcond=None)
        amplitude[lane] = np.hypot(found[1], found[2])
        moving = values[:, lane] - found[0]
        left = values[:, lane] - basis @ found
        rest[lane] = np.sqrt(np.mean(left**2) / max(np.mean(moving**2), np.finfo(float).tiny))
    return amplitude, rest


UNCONTROLLED, PASSIVE = "no control", "best passive damper"


def efforts(
    scene: Scene, rows: Sequence[Entry], episodes: Episodes
) -> list[dict[str, str | float]]:
    """Return the indices of every controller of a task, in the episodes of the first seed.

    A row names the controller, what its motions are compared with, and the means over the episodes
    of the indices that `mm_gym.metrics.Indices` explains. Of a training with several seeds it is
    the first run. A scene whose damper cannot be tuned has no passive reference; a carriage without
    mass has no indices.
    """
    seeds = range(episodes.first, episodes.first + episodes.each)
    options = spread_frequency(scene, episodes.each)
    try:
        references = {UNCONTROLLED: metrics.uncontrolled_response(scene, seeds, options)}
    except SimulationError:
        return []
    with suppress(DesignError):
        references[PASSIVE] = metrics.passive_response(scene, seeds, options)
    found: list[dict[str, str | float]] = []
    for row in rows:
        env = MovingMassVectorEnv(scene, len(seeds), autoreset_mode="Disabled")
        rollout = Rollout(env, row.controllers[0], seed=seeds, options=options)
        record = metrics.LaneResponse(env)
        for made in rollout:
            record.add(made.ran)
        response = record.response()
        for name, reference in references.items():
            sensors = len(scene.sensors.channels)
            measured = asdict(metrics.indices(response, reference, sensors=sensors))
            measured.pop("j17")  # the number of the controller's states
            means = {f"{index} [-]": float(np.mean(one)) for index, one in measured.items()}
            found.append({"controller": row.label, "over": name} | means)
    return found


@dataclass(frozen=True, eq=False)
class Motions:
    """What one controller did in some episodes; NaN after an early end."""

    time: Array  # (steps + 1,) from the start of the episode [s]
    # displacement, stroke: (steps + 1, episodes): x1 and x2 - x1 [m].
    displacement: Array
    stroke: Array
    applied: Array  # (steps + 1, episodes, k): what the actuators have, in the order of the action

    def spectrum(self) -> tuple[Array, Array]:
        """Return frequencies (n,) [Hz] and the one-sided power spectral density of x1 [m^2/Hz].

        It is the mean of the periodograms, in Hann's window, of the episodes that lasted to their
        end; both are empty if none did.
        """
        lasted = self.displacement[:, ~np.isnan(self.displacement).any(axis=0)]
        if not lasted.size:
            return np.empty(0), np.empty(0)
        step = self.time[1] - self.time[0]
        frequencies, power = periodogram(lasted, 1.0 / step, window="hann", axis=0)
        return frequencies, power.mean(axis=1)


def motions(scene: Scene, controller: Controller, episodes: Episodes) -> Motions:
    """Return what a controller does in the episodes of the first seed."""
    lanes, steps = episodes.each, scene.control.steps
    env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
    seeds = range(episodes.first, episodes.first + lanes)
    rollout = Rollout(env, controller, seed=seeds, options=spread_frequency(scene, lanes))
    position = np.full((steps + 1, lanes, 2), np.nan)
    applied = np.full((steps + 1, lanes, env.single_action_space.shape[0]), np.nan)
    position[0], applied[0] = rollout.info["state"][:, :2], rollout.info["applied"]
    for step, made in enumerate(rollout, 1):
        position[step, made.ran] = made.info["state"][made.ran, :2]
        applied[step, made.ran] = made.info["applied"][made.ran]
    x1, x2 = position[..., 0], position[..., 1]
    return Motions(scene.control.time_step * np.arange(steps + 1), x1, x2 - x1, applied)


@dataclass(frozen=True)
class Studies:
    """What is measured in addition to the cost."""

    robustness: bool = False  # whether the controllers are tried on changed scenes
    records: Records | None = None  # recorded motions among the changes
    frequency: bool = False  # whether the closed loop's response over frequency is measured
    effort: bool = False  # whether response and effort are, over references
    # Whether motions are recorded. All studies are then of a few controllers: those asked for by
    # name, what they are compared with and the best constant.
    motions: bool = False


@dataclass(frozen=True, eq=False)
class TaskResult:
    """What all controllers did on one task."""

    task: str  # its id, or the path of its scene
    # labels, reads: of each controller
    labels: tuple[str, ...]
    reads: tuple[Reads, ...]
    sample: Sample  # their penalties
    reference: int  # index of the best constant action
    # Index of the classical law of least cost on the validation episodes, or None.
    chosen: int | None
    # outcomes, loops, efforts, motions: what the studies gave, if they were asked for; motions by
    # label
    outcomes: Sequence[Outcome] = field(default_factory=list)
    loops: Sequence[ClosedLoop] = field(default_factory=list)
    efforts: Sequence[Mapping[str, str | float]] = field(default_factory=list)
    motions: Mapping[str, Motions] = field(default_factory=dict)
    # Label of each controller that could not be scored -> the reason.
    not_scored: Mapping[str, str] = field(default_factory=dict)

    @property
    def compared(self) -> int:
        """Index of what others are compared with: the chosen law, or else the best constant."""
        return self.reference if self.chosen is None else self.chosen


def entries(field: Field, task: str) -> tuple[list[Entry], dict[str, str]]:
    """Return the rows of a task, the best constant first, and why others cannot be designed."""
    scene = field.scenes[task]
    made, not_scored = baselines(scene) if field.baselines else Baselines([], {})
    constant = made.pop(0) if made and scene.actuation.stretch is not None else best_constant(scene)
    rows = [Entry("best constant", [constant])]
    rows += [Entry(controller.name, [controller], classical=True) for controller in made]
    for one in field.contestants:
        try:
            if task in one.texts:
                rows.append(Entry(one.label, one.make(task, scene)))
        except (CompileError, DesignError) as error:
            not_scored[one.label] = str(error)
    return rows, not_scored


def measure_task(compared: Field, episodes: Episodes, studies: Studies, task: str) -> TaskResult:
    """Run all controllers of a task through the same episodes, and through the studies."""
    scene = compared.scenes[task]
    made, not_scored = entries(compared, task)
    rows, penalties = [], []
    for row in made:
        try:
            penalties.append(row.penalties(scene, episodes))
            rows.append(row)
        except NOT_SCORED as error:
            if not rows:  # what all others are compared with
                raise
            not_scored[row.label] = str(error)
    changes = studies.robustness or studies.records is not None
    # The classical law that does best on the validation episodes is one of those that observe.
    laws = [k for k, row in enumerate(rows) if row.classical]
    laws = [k for k in laws if rows[k].controllers[0].reads == "observation"]
    result = TaskResult(
        task=task,
        labels=tuple(row.label for row in rows),
        reads=tuple(row.controllers[0].reads for row in rows),
        sample=Sample(np.stack(penalties), np.array([row.trained for row in rows])),
        reference=0,
        chosen=min(
            laws, key=lambda k: validation_cost(scene, rows[k].controllers[0]), default=None
        ),
        not_scored=not_scored,
    )
    if studies.motions:
        named = [one.label for one in compared.contestants]
        shown = dict.fromkeys([*named, result.labels[result.compared], result.labels[0]])
        rows = [row for label in shown for row in rows if row.label == label]
    return replace(
        result,
        outcomes=outcomes(scene, rows, episodes, studies.records) if changes else [],
        loops=[closed_loop(scene, row.controllers[0], row.label) for row in rows]
        if studies.frequency and scene.carriage.mass > 0.0  # else no frequency of its own
        else [],
        efforts=efforts(scene, rows, episodes) if studies.effort else [],
        motions={row.label: motions(scene, row.controllers[0], episodes) for row in rows}
        if studies.motions
        else {},
    )


def measure(
    compared: Field, episodes: Episodes, studies: Studies | None = None, processes: int = 1
) -> list[TaskResult]:
    """Measure all tasks, in as many processes; the results do not depend on their number."""
    job, tasks = partial(measure_task, compared, episodes, studies or Studies()), compared.scenes
    if min(processes, len(tasks)) == 1:
        return [job(task) for task in tasks]
    # New interpreters: a fork would copy locks that other threads of this one hold.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        return list(pool.map(job, tasks))
