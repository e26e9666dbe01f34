"""What trainings cost, kept as data: ``docs/results.json``, from which the page of results follows.

Costs are of the same held-out episodes. A training that is done again replaces its row.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from agents.control.controller import Controller
from agents.controllers.registry import entries
from agents.controllers.tuned import designed
from agents.controllers.with_observer import WithObserver
from agents.evaluation.aggregates import Estimate, interquartile_mean, proportion, shared_episodes
from agents.evaluation.headroom import CLASSICAL, SCORES, Cost, read_scores
from agents.evaluation.rigs import CONTROLLERS, read_robustness, task_of, variant_of
from agents.scoring import Evaluation, evaluate, validation_cost
from agents.sweeps.trials import (
    EPISODES,
    LEARNERS,
    Learner,
    algorithm_of,
    check_settings,
    read_score,
)
from agents.training.config import RunSettings
from agents.training.parts import agent_of, recorded_parts
from agents.training.runs import Run, RunError, by_dotted_name, read_checked
from mm_gym import Scene, load_scene
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.files import write_text
from mm_gym.tasks import ids, robust_ids, short_name

FILE = SCORES.with_name("results.json")
MOST_BYTES = 2**24  # largest file of results
DIGITS = 5  # of the costs in the file: a cost on a page has four
SAME = 1e-4  # largest relative difference of costs of one controller

Costs = Annotated[list[Cost], Field(min_length=EPISODES, max_length=EPISODES)]
"""Of each held-out episode."""


class Scored(BaseModel, strict=True, allow_inf_nan=False, extra="forbid"):
    """A row of the file: what was scored on the held-out episodes of a task."""

    task: str  # its id
    scene_digest: str
    # The mean over the episodes of the energy that changing the stretch put in [J]; None where it
    # is not actuated.
    injected: float | None
    episodes: Costs

    @property
    def penalties(self) -> Array:
        """(episodes,) as in `Evaluation`."""
        return np.square(self.episodes)


class Reference(Scored):
    """The best controller of a task or variant: that of the least cost in the committed scores."""

    controller: str  # its name
    validation: Cost  # on the validation episodes
    # On a variant, its cost over the more episodes of the file of scores, if it is known
    listed: Cost | None = None

    @property
    def cost(self) -> float:
        """The cost over all episodes [-]."""
        return float(np.sqrt(self.penalties.mean()))


class Training(Scored):
    """A training: a seed of an algorithm on a task."""

    algorithm: Learner
    seed: int
    settings: str  # a digest of all but the seed and the name
    commit: str  # of the code that trained
    machine: str
    cost: Cost  # over all episodes, with all digits
    steps: int  # control steps of all lanes
    # (validations,) cost on the validation episodes of each, and when it was made [s]
    validation: Annotated[list[Cost], Field(min_length=1)]
    seconds: list[float]

    @model_validator(mode="after")
    def _has_times(self) -> Self:
        if len(self.seconds) != len(self.validation):
            allowed = f"{len(self.validation)}, as of costs"
            refuse("seconds", f"{len(self.seconds)}", allowed, ValueError)
        return self


class Results(BaseModel, extra="forbid", strict=True):
    """What the file holds."""

    controllers: list[Reference]
    trainings: list[Training]
    # Those on tasks, scored on the task's variant with an observer; each is a row of the variant.
    observed: list[Training] = []

    @model_validator(mode="before")
    @classmethod
    def _without_earlier(cls, data: Any) -> Any:  # noqa: ANN401 - whatever a file holds
        """Leave out a table that older files have."""
        if not isinstance(data, dict):
            return data
        return {name: rows for name, rows in data.items() if name != "earlier"}


NOTHING = Results(controllers=[], trainings=[])
"""What is known before the first training."""


@dataclass(frozen=True, eq=False)
class Cell:
    """The trainings of one algorithm on a task."""

    task: str
    algorithm: str
    trainings: Sequence[Training]  # of each seed

    @property
    def penalties(self) -> Array:
        """(seeds, episodes) as in `Evaluation`."""
        return np.array([one.penalties for one in self.trainings])

    @property
    def costs(self) -> Array:
        """(seeds,) cost of each training [-]."""
        return np.array([one.cost for one in self.trainings])

    @property
    def median(self) -> Training:
        """That whose cost is in the middle; of two, the better."""
        return self.trainings[int(np.argsort(self.costs)[(len(self.costs) - 1) // 2])]

    @property
    def validation(self) -> float:
        """The interquartile mean of the seeds' least costs on the validation episodes [-]."""
        least = np.array([min(one.validation) for one in self.trainings])
        return float(interquartile_mean(least[None]))

    def cost(self, other: Reference | Self | None = None) -> Estimate:
        """Return the interquartile mean of the seeds' costs, or its ratio to that of another.

        The interval is for other seeds and other episodes; one seed has none.
        """
        return shared_episodes(self.penalties, None if other is None else other.penalties)

    def cheaper(self, other: Reference) -> int:
        """Return how many seeds cost less than a controller in the same episodes."""
        return int((self.costs < other.cost).sum())

    def improvement(self, other: Reference) -> Estimate:
        """Return the probability that a seed's cost is below a controller's in these episodes.

        The interval is for other seeds in the same episodes.
        """
        return proportion(self.cheaper(other), len(self.trainings))

    def episodes_won(self, other: Reference) -> float:
        """Return which fraction of all episodes of all seeds costs less than with a controller."""
        return float((self.penalties < other.penalties).mean())

    def middle_curve(self) -> tuple[Array, Array]:
        """Return what the seeds have in common, up to the shortest: time and least cost so far.

        Returns
        -------
        seconds
            (validations,) median over the seeds [s].
        costs
            (3, validations) least, median and most of the seeds [-].
        """
        count = min(len(one.validation) for one in self.trainings)
        seconds = np.median([one.seconds[:count] for one in self.trainings], axis=0)
        least = [np.minimum.accumulate(one.validation[:count]) for one in self.trainings]
        return seconds, np.percentile(least, (0.0, 50.0, 100.0), axis=0)


@dataclass(frozen=True, eq=False)
class OnTask:
    """What is known on a task."""

    task: str  # its id
    reference: Reference
    cells: Sequence[Cell]  # of each algorithm that has data, at least one
    known: Mapping[str, float]  # role -> the least cost of `docs/task_scores.json` [-]
    plans: Array  # (episodes,) costs of the clairvoyant optima [-]

    @property
    def name(self) -> str:
        """The short name of the task."""
        return short_name(self.task)

    @property
    def best(self) -> Cell:
        """That of the least cost on the validation episodes, of those with the most seeds.

        Held-out episodes have no say in it.
        """
        most = max(len(cell.trainings) for cell in self.cells)
        whole = (cell for cell in self.cells if len(cell.trainings) == most)
        return min(whole, key=lambda cell: cell.validation)

    @property
    def ties(self) -> list[str]:
        """Algorithms whose cost differs from the best one's by less than the interval."""
        ratios = {cell.algorithm: cell.cost(self.best) for cell in self.cells if cell != self.best}
        return [name for name, ratio in ratios.items() if ratio.low <= 1.0 <= ratio.high]

    def scores(self, costs: Array) -> Array:
        """Return s = (J_constant - J) / (J_constant - J_best found) of costs J."""
        constant = self.known["constant"]
        return (constant - costs) / (constant - self.known["planner"])


def read_results(path: Path = FILE) -> Results:
    """Return what is in the file; raise `SceneError` if it cannot be read, or is damaged."""
    return read_checked(Results, path, "a file of results", MOST_BYTES)


def save(results: Results, path: Path = FILE) -> None:
    """Write the file, a line a row."""
    tables = [
        f'"{name}": [\n' + ",\n".join(json.dumps(row) for row in rows) + "\n]"
        for name, rows in results.model_dump(exclude_unset=True).items()
    ]
    write_text(path, "{\n" + ",\n".join(tables) + "\n}\n")


def training_of(trial: RunSettings, folder: Path) -> Training:
    """Return the row of a finished training.

    Raise `RunError` if it has other settings, or its files are damaged.
    """
    run = Run(trial.name, folder)
    check_settings(trial, run)
    record, score = run.read(), read_score(run)
    steps, costs, seconds = run.validations()
    return Training(
        task=trial.task,
        scene_digest=record["scene_digest"],
        injected=score.injected,
        episodes=_short(score.episodes),
        algorithm=algorithm_of(trial),  # pyright: ignore[reportArgumentType] - the sweep's
        seed=trial.seed,
        settings=_digest(trial),
        commit=record.get("commit", "unknown"),
        machine=f"{record.get('machine', 'unknown')}, Python {record.get('python', 'unknown')}",
        cost=score.cost,
        steps=int(steps[-1]),
        validation=_short(costs),
        seconds=_short(seconds),
    )


def with_observed(results: Results, trials: Iterable[RunSettings], folder: Path) -> Results:
    """Return results with finished trainings on tasks scored on rigs, each with an observer.

    What was scored is not scored again. What no training is left of goes.
    """
    kept = {_key(one): one for one in results.observed}
    here = {(one.task, algorithm_of(one), one.seed): Run(one.name, folder) for one in trials}
    found: list[Training] = []
    for one in results.trainings:
        variant = variant_of(one.task)
        if variant is None:
            continue
        scene, run = load_scene(variant), here.get((one.task, one.algorithm, one.seed))
        placed = one.model_copy(update={"task": variant, "scene_digest": scene.digest})
        if _key(placed) in kept:
            found.append(kept[_key(placed)])
        elif run is not None:
            found.append(_observed(placed, scene, run))
    return results.model_copy(update={"observed": found})


def _key(one: Training) -> tuple[object, ...]:
    return one.task, one.scene_digest, one.algorithm, one.seed, one.settings, one.commit


def _observed(placed: Training, scene: Scene, run: Run) -> Training:
    """Return the row of a run's agent on another scene, with an observer."""
    record = run.read()
    parts = recorded_parts(load_scene(task_of(placed.task)), record, run.record, trust=True)
    agent = WithObserver(scene, agent_of(run, parts))
    result = evaluate(scene, agent, episodes=EPISODES)
    update = _held_out(result) | {"cost": result.cost, "seconds": placed.seconds[-1:]}
    update["validation"] = _short([validation_cost(scene, agent)])
    return placed.model_copy(update=update)


def _digest(trial: RunSettings) -> str:
    """Return a digest of a training's settings.

    It leaves out settings that are off or have no effect. A setting that is added to the project
    later, and is off by default, therefore does not change the digests of older trainings.
    """
    apart = {"seed", "name", *trial.unused}
    settings = by_dotted_name(json.loads(trial.model_dump_json(exclude=apart)))
    kept = {name: one for name, one in settings.items() if one is not None and one is not False}
    text = json.dumps(kept, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def known_names(results: Results, trials: Iterable[RunSettings]) -> set[str]:
    """Return the names of the trainings that have a row of the same settings and scene."""
    rows = {
        (one.task, one.algorithm, one.seed, one.settings, one.scene_digest)
        for one in results.trainings
    }
    scenes = {task: load_scene(task).digest for task in {row[0] for row in rows}}
    return {
        one.name
        for one in trials
        if (one.task, algorithm_of(one), one.seed, _digest(one), scenes.get(one.task)) in rows
    }


def _held_out(result: Evaluation) -> dict[str, Any]:
    """Return what `Scored` keeps of an evaluation."""
    return {"injected": result.mean_injected, "episodes": _short(result.episode_costs)}


def _short(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]


def merged(results: Results, rows: Iterable[Training]) -> Results:
    """Return results with other rows: each replaces that of its task, algorithm and seed.

    What its task and algorithm have of other settings or another scene goes.
    """
    kept = {(one.task, one.algorithm, one.seed): one for one in results.trainings}
    for row in rows:
        for key, one in list(kept.items()):
            same = (one.settings, one.scene_digest) == (row.settings, row.scene_digest)
            if key[:2] == (row.task, row.algorithm) and not same:
                del kept[key]
        kept[row.task, row.algorithm, row.seed] = row
    tasks = (*ids(), *robust_ids())
    trainings = sorted(
        kept.values(),
        key=lambda one: (tasks.index(one.task), LEARNERS.index(one.algorithm), one.seed),
    )
    return results.model_copy(update={"trainings": trainings})


def with_references(results: Results) -> Results:
    """Return results with the best controller of each task that has a training.

    One is scored where there is none, or it or its cost is another now. Raise `SceneError` or
    `RunError` if the scores of tasks cannot be read, or are of another scene.
    """
    found: list[Reference] = []
    known = {one.task: one for one in results.controllers}
    for task in dict.fromkeys(one.task for one in results.trainings):
        scene = load_scene(task)
        name, cost = _best_controller(task, scene)
        listed = {} if task in ids() else {"listed": cost}
        one = known.get(task)
        if one is not None and (one.controller, one.scene_digest) == (name, scene.digest):
            before = one.cost if task in ids() else one.listed
            if before is None or np.isclose(before, cost, rtol=SAME, atol=0.0):
                found.append(one.model_copy(update=listed))
                continue
        controller = reference_controller(scene, name)
        result = evaluate(scene, controller, episodes=EPISODES)
        found.append(
            Reference(
                task=task,
                scene_digest=scene.digest,
                controller=result.name,
                validation=_short([validation_cost(scene, controller)])[0],
                **_held_out(result),
                **listed,
            )
        )
    return results.model_copy(update={"controllers": found})


def reference_controller(scene: Scene, name: str) -> Controller:
    """Return the controller of a name on the page of tasks; raise `RunError` if none has it now."""
    found = [one for one in entries(scene) if one.role != "informed" and not one.refuses(scene)]
    # First those whose title the name begins with, then what is quick to design, of known numbers.
    words = _words(name)
    found.sort(key=lambda one: (not words.startswith(_words(one.title)), not one.tunable))
    for entry in found:
        made, _ = designed(scene, {entry.name: entry.make})
        if made and made[0].name == name:
            return made[0]
    msg = f"{SCORES.name}: got {name!r}, as no controller is called now: python -m agents headroom"
    raise RunError(msg)


def _words(text: str) -> str:
    return text.lower().replace("-", " ")


def _best_controller(task: str, scene: Scene) -> tuple[str, float]:
    """Return the name and cost of the controller with the least among the scores of a task."""
    own = task in ids()
    scores = read_scores(tasks=[task])[task] if own else read_robustness().get(task, {})
    if scores.get("scene_digest") != scene.digest:
        wanted = "headroom" if own else "robustness"
        msg = f"{task}: no scores of this scene: python -m agents {wanted} {short_name(task)}"
        raise RunError(msg)
    roles, cost = (CLASSICAL, "cost") if own else (CONTROLLERS, "rigs")
    rows = [row for row in scores["rows"] if row["role"] in roles]
    best = min(rows, key=lambda row: row[cost])
    return best["controller"], best[cost]


def cells_of(trainings: Iterable[Training]) -> list[Cell]:
    """Return the trainings of each task and algorithm; those of one must follow each other."""
    groups = groupby(trainings, key=lambda one: (one.task, one.algorithm))
    return [Cell(*key, list(rows)) for key, rows in groups]


def on_tasks(results: Results) -> list[OnTask]:
    """Return what is known on each task that has a training, with the committed scores.

    Variants on rigs that differ are left out.
    """
    scores = read_scores(tasks=[one.task for one in results.controllers if one.task in ids()])
    cells = cells_of(results.trainings)
    found: list[OnTask] = []
    for one in [one for one in results.controllers if one.task in scores]:
        known: dict[str, float] = {}
        for row in scores[one.task]["rows"]:
            known[row["role"]] = min(row["cost"], known.get(row["role"], np.inf))
        plans = next(row for row in scores[one.task]["rows"] if row["role"] == "planner")["plans"]
        own = [cell for cell in cells if cell.task == one.task]
        costs = np.array([plan["cost"] for plan in plans])
        found.append(OnTask(one.task, one, own, known, costs))
    return found
