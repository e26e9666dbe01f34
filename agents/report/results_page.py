"""The page of what agents reach, ``docs/results.md``."""

from collections.abc import Iterator, Sequence

import numpy as np

from agents.evaluation.headroom import CLASSICAL
from agents.evaluation.scores import read_scores
from agents.evaluation.sealed import read_sealed
from agents.report.pages import cost_range, percent, printed, render, span
from agents.report.score_pages import of_sealed, standing
from agents.scoring import tail_mean
from agents.sweeps.results import Cell, Earlier, OnTask, Results, on_tasks
from agents.sweeps.trials import LEARNERS
from mm_gym.arrays import Array
from mm_gym.tasks import ids, short_name

COMPARED = {
    "best controller": CLASSICAL,
    "predictive control": ("predictive",),
    "clairvoyant optimum (best found)": ("planner",),
}
"""Row of the costs -> roles in `docs/task_scores.json`."""

FIGURES = ("curves", "profile", "episodes")
"""Names of the figures, which are in a folder next to the page."""


def page(results: Results, folder: str) -> str:
    """Return the page, with the figures of a folder next to it."""
    known = on_tasks(results)
    of_best = {one.name: one.best.cost(one.reference) for one in known}
    counts = {(cell.task, cell.algorithm): len(cell.trainings) for _, cell in _each(known)}
    counts |= {(one.task, one.algorithm): one.seeds for one in results.earlier}
    tasks = sorted({task for task, _ in counts}, key=ids().index)
    algorithms = sorted({name for _, name in counts}, key=LEARNERS.index)
    return render(
        "results",
        names=[short_name(task) for task in tasks],
        left_out=[short_name(task) for task in ids() if task not in tasks],
        unknown=[short_name(task) for task in tasks if short_name(task) not in of_best],
        of_held_out=standing(of_best, len(tasks)),
        of_sealed=of_sealed(read_sealed()),
        machines=sorted({one.machine for one in results.trainings}),
        algorithms=algorithms,
        best=[_best(one) for one in known],
        costs=_costs(known, results.earlier, tasks, algorithms),
        details=_details(known),
        earlier=[
            [
                *(short_name(one.task), one.algorithm, str(one.seeds)),
                *(printed(one.cost), cost_range(one.least, one.most)),
            ]
            for one in results.earlier
        ],
        most=max(counts.values(), default=0),
        fewer=_fewer(tasks, algorithms, counts),
        energy=_energy(known),
        failures=[_failures(one) for one in known],
        **{name: f"{folder}/{name}.png" for name in FIGURES},
    )


def _each(known: Sequence[OnTask]) -> Iterator[tuple[OnTask, Cell]]:
    for one in known:
        for cell in one.cells:
            yield one, cell


def _best(one: OnTask) -> list[str]:
    best = one.best
    return [
        one.name,
        best.algorithm,
        str(len(best.trainings)),
        printed(best.validation),
        span(best.cost()),
        one.reference.controller,
        printed(one.reference.validation),
        printed(one.reference.cost),
        span(best.cost(one.reference), 3),
    ]


def _costs(
    known: Sequence[OnTask],
    earlier: Sequence[Earlier],
    tasks: Sequence[str],
    algorithms: Sequence[str],
) -> list[list[str]]:
    """Return the rows of costs: a row for each algorithm and what it is compared with."""
    told = {(one.task, one.algorithm): f"{printed(one.cost)} ({one.seeds})" for one in earlier}
    told |= {(cell.task, cell.algorithm): span(cell.cost()) for _, cell in _each(known)}
    rows = [[name, *(told.get((task, name), "-") for task in tasks)] for name in algorithms]
    scores = read_scores(tasks=tasks)
    for label, roles in COMPARED.items():
        own = [
            [row["cost"] for row in scores[task]["rows"] if row["role"] in roles] for task in tasks
        ]
        rows.append([label, *(printed(min(costs)) if costs else "-" for costs in own)])
    return rows


def _details(known: Sequence[OnTask]) -> list[list[str]]:
    return [
        [
            one.name,
            cell.algorithm,
            str(len(cell.trainings)),
            cost_range(cell.costs.min(), cell.costs.max()),
            printed(cell.validation),
            str(cell.cheaper(one.reference)),
            span(cell.improvement(one.reference), 2),
            percent(cell.episodes_won(one.reference)),
        ]
        for one, cell in _each(known)
    ]


def _fewer(
    tasks: Sequence[str], algorithms: Sequence[str], counts: dict[tuple[str, str], int]
) -> list[tuple[str, str]]:
    """Return which tasks an algorithm has fewer seeds on than others have, or none."""
    most = max(counts.values(), default=0)
    fewer: list[tuple[str, str]] = []
    for name in algorithms:
        own = {short_name(task): counts.get((task, name), 0) for task in tasks}
        told = [f"{task} {count}" for task, count in own.items() if count < most]
        if told:
            fewer.append((name, ", ".join(told)))
    return fewer


def _energy(known: Sequence[OnTask]) -> list[list[str]]:
    rows: list[list[str]] = []
    for one, cell in _each(known):
        of_seeds = [seed.injected for seed in cell.trainings if seed.injected is not None]
        if of_seeds and one.reference.injected is not None:
            values = np.median(of_seeds), one.reference.injected
            rows.append([one.name, cell.algorithm, *(f"{1e3 * v:.2f}" for v in values)])
    return rows


def _failures(one: OnTask) -> list[str]:
    penalties = one.best.median.penalties
    ratios = np.sqrt(penalties) / one.plans
    worst = int(ratios.argmax())
    return [
        one.name,
        f"{np.median(ratios):.2f}",
        f"{ratios[worst]:.2f} (episode {worst})",
        printed(_tail(penalties)),
        printed(_tail(one.reference.penalties)),
    ]


def _tail(penalties: Array) -> float:
    return float(np.sqrt(tail_mean(penalties)))
