"""A comparison: every contestant of a task in the same episodes, and the studies asked for."""

import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from agents.control.controller import Reads
from agents.controllers.constant import best_constant
from agents.controllers.tuned import NOT_SCORED, Baselines, baselines
from agents.evaluation.aggregates import Sample
from agents.evaluation.changed_scenes import NO_RECORDS, Outcome, Records, outcomes
from agents.evaluation.closed_loop import ClosedLoop, closed_loop
from agents.evaluation.contestants import Entry, Episodes, Field
from agents.evaluation.effort import efforts
from agents.evaluation.motions import Motions, motions
from agents.scoring import validation_cost
from mm_gym import CompileError, DesignError


@dataclass(frozen=True)
class Studies:
    """What is measured in addition to the cost."""

    robustness: bool = False  # whether the controllers are tried on changed scenes
    records: Records = NO_RECORDS  # recorded motions among the changes
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

    @property
    def against(self) -> str:
        """Label of what others are compared with."""
        return self.labels[self.compared]


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
    changes = studies.robustness or studies.records.files
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
