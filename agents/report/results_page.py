"""The page of what agents reach, ``docs/results.md``."""

import platform
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from agents.evaluation.aggregates import Estimate
from agents.evaluation.headroom import CLASSICAL
from agents.report.pages import percent, render
from agents.report.published import Published, printed
from agents.scoring import tail_mean
from agents.sweeps.on_task import (
    OnTask,
    Trainings,
    algorithms_of,
    cheaper,
    episodes_won,
    improvement,
    middle_cost,
)
from agents.sweeps.trials import LEARNERS
from mm_gym import compile_scene, load_scene
from mm_gym.arrays import Array
from mm_gym.tasks import ids, short_name

COMPARED = {
    "best controller": CLASSICAL,
    "predictive control": ("predictive",),
    "clairvoyant optimum (best found)": ("planner",),
}
"""Row of the costs -> roles in `docs/task_scores.json`."""


DETAILS = 8  # columns of the table of seeds, of which no other table has so many
OTHERS = "## Other trainings"
"""Heading of the last section, which is that of the published policies of other trainings."""


def page(known: Sequence[OnTask], figures: Sequence[Path], published: Published) -> str:
    """Return the page, with figures that are in a folder next to it."""
    trained = {one.task for one in known}
    counts = {(one.name, t.algorithm): len(t.costs) for one, t in _each(known)}
    details = _details(known)
    with_slopes = [one for one in known if one.slopes is not None]
    channels = [compile_scene(load_scene(one.task)).observed for one in with_slopes[-1:]]
    return render(
        "results",
        machine=f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}",
        covered=[one.name for one in known],
        untrained=[short_name(task) for task in ids() if task not in trained],
        algorithms=algorithms_of(known),
        names=[one.name for one in known],
        costs=_costs(known),
        details=details,
        most=max(counts.values()),
        fewer=_fewer(known, counts),
        energy=_energy(known),
        examples=any(one.examples for one in known),
        channels=[channel.name for found in channels for channel in found],
        slopes=_slopes(with_slopes),
        failures=_failures(known),
        **_others(published, details),
        **{path.stem: f"{path.parent.name}/{path.name}" for path in figures},
    )


def with_others(text: str, published: Published) -> str:
    """Return a written page with its last section anew: what was trained apart from its tables."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    kept, _, _ = text.partition(OTHERS)
    section = render("others", **_others(published, [row for row in rows if len(row) == DETAILS]))
    return kept.rstrip("\n") + "\n\n" + section


def _others(published: Published, details: Sequence[Sequence[str]]) -> dict[str, object]:
    """Return the data of the last section: the published rows, and those of the page's tables."""
    above = {(task, name): (seeds, span) for task, _, name, seeds, span, *_ in details}
    own = ids()  # variants on rigs that differ have a page of their own
    others = [row for row in published.rows if row.task in own and not row.with_results]
    rows: list[list[str]] = []
    outside: list[str] = []
    for row in others:
        seeds, span = above.get((short_name(row.task), row.algorithm), ("0", "-"))
        told = [short_name(row.task), row.algorithm, str(row.seeds), printed(row.cost), row.span]
        rows.append([*told, span, seeds])
        least, _, most = span.partition(" to ")
        if most and not float(least) <= float(printed(row.cost)) <= float(most):
            known = f"the table above has {span} (seeds: {seeds})"
            outside.append(f"{row.name}: {printed(row.cost)}; {known}")
    new = {row.algorithm for row in others} - {name for _, name in above}
    return {"others": rows, "outside": outside, "new": sorted(new, key=LEARNERS.index)}


def _span(found: Estimate, digits: int = 4) -> str:
    value = f"{found.value:.{digits}f}"
    ends = f" [{found.low:.{digits}f}, {found.high:.{digits}f}]"
    return value if np.isnan(found.low) else value + ends


def _each(known: Sequence[OnTask]) -> Iterator[tuple[OnTask, Trainings]]:
    for one in known:
        for trainings in one.trainings:
            yield one, trainings


def _costs(known: Sequence[OnTask]) -> list[list[str]]:
    """Return the rows of costs: a row for each algorithm and what it is compared with."""
    rows: list[list[str]] = [["reference controller", *(f"{one.law.cost:.4f}" for one in known)]]
    for name in algorithms_of(known):
        found = [next((t for t in one.trainings if t.algorithm == name), None) for one in known]
        rows.append([name, *("-" if t is None else _span(middle_cost(t)) for t in found)])
    for label, roles in COMPARED.items():
        costs = [min(one.known.get(role, np.inf) for role in roles) for one in known]
        rows.append([label, *(f"{cost:.4f}" for cost in costs)])
    return rows


def _details(known: Sequence[OnTask]) -> list[list[str]]:
    return [
        [
            one.name,
            one.law.name,
            trainings.algorithm,
            str(len(trainings.costs)),
            f"{trainings.costs.min():.4f} to {trainings.costs.max():.4f}",
            str(cheaper(trainings, one.law)),
            _span(improvement(trainings, one.law), 2),
            percent(episodes_won(trainings, one.law)),
        ]
        for one, trainings in _each(known)
    ]


def _fewer(known: Sequence[OnTask], counts: dict[tuple[str, str], int]) -> list[tuple[str, str]]:
    """Return which tasks an algorithm has fewer seeds on than others have, or none."""
    fewer: list[tuple[str, str]] = []
    for name in algorithms_of(known):
        own = {one.name: counts.get((one.name, name), 0) for one in known}
        told = [f"{task} {count}" for task, count in own.items() if count < max(counts.values())]
        if told:
            fewer.append((name, ", ".join(told)))
    return fewer


def _energy(known: Sequence[OnTask]) -> list[list[str]]:
    rows: list[list[str]] = []
    for one, trainings in _each(known):
        of_seeds = [r.injected.mean() for r in trainings.results if r.injected is not None]
        if one.law.injected is not None:
            values = np.median(of_seeds), one.law.injected.mean()
            rows.append([one.name, trainings.algorithm, *(f"{1e3 * v:.2f}" for v in values)])
    return rows


def _slopes(known: Sequence[OnTask]) -> list[list[str]]:
    labels = "LQR", "agent, near equilibrium", "agent, over half of the scale"
    return [
        [one.name, label, *(f"{round(value, 2) + 0.0:.2f}" for value in own)]
        for one in known
        for label, own in zip(labels, one.slopes, strict=True)  # pyright: ignore[reportArgumentType]
    ]


def _failures(known: Sequence[OnTask]) -> list[list[str]]:
    rows: list[list[str]] = []
    for one in known:
        trainings = one.best
        penalties = trainings.penalties[trainings.median]
        ratios = np.sqrt(penalties) / one.plans
        worst = int(ratios.argmax())
        rows.append(
            [
                one.name,
                f"{np.median(ratios):.2f}",
                f"{ratios[worst]:.2f} (episode {worst})",
                f"{_tail(penalties):.4f}",
                f"{_tail(one.law.penalties):.4f}",
            ]
        )
    return rows


def _tail(penalties: Array) -> float:
    return float(np.sqrt(tail_mean(np.ravel(penalties))))
