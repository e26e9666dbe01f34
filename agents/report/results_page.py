"""The page of what agents reach, ``docs/results.md``, and its figures."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.aggregates import performance_profile
from agents.evaluation.headroom import CLASSICAL, read_scores
from agents.evaluation.plans import Effort, Planner
from agents.evaluation.sealed import AGENT, read_sealed
from agents.report.charts import logarithmic
from agents.report.pages import printed, render, span
from agents.report.published import controller_of, read_published
from agents.report.score_pages import algorithm_named, least, of_sealed, standing
from agents.scoring import Evaluation, evaluate, tail_mean
from agents.sweeps.results import Cell, OnTask, Results, on_tasks, reference_controller
from agents.sweeps.trials import LEARNERS
from mm_gym import load_scene
from mm_gym.drawing import COLOURS, STYLES, legend_below, panels, save, style
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
    known, sealed = on_tasks(results), read_sealed()
    of_best = {one.name: one.best.cost(one.reference) for one in known}
    counts = {(cell.task, cell.algorithm): len(cell.trainings) for _, cell in _each(known)}
    costs = {(cell.task, cell.algorithm): span(cell.cost()) for _, cell in _each(known)}
    tasks = sorted({task for task, _ in counts}, key=ids().index)
    algorithms = sorted({name for _, name in counts}, key=LEARNERS.index)
    return render(
        "results",
        names=[short_name(task) for task in tasks],
        left_out=[short_name(task) for task in ids() if task not in tasks],
        of_held_out=standing(of_best, len(tasks)),
        of_sealed=of_sealed(sealed),
        unsealed=[one.name for one in known if one.best.algorithm not in _sealed(sealed, one.task)],
        machines=sorted({one.machine for one in results.trainings}),
        algorithms=algorithms,
        known=known,
        tasks=tasks,
        costs=costs,
        compared=COMPARED,
        scores=read_scores(tasks=tasks),
        least=least,
        most=max(counts.values(), default=0),
        fewer=_fewer(tasks, algorithms, counts),
        energy=_energy(known),
        failures=[_failures(one) for one in known],
        **{name: f"{folder}/{name}.png" for name in FIGURES},
    )


def _sealed(sealed: Mapping[str, Any], task: str) -> list[str]:
    """Return the algorithms that have sealed scores on a task."""
    rows = sealed["tasks"].get(task, {}).get("rows", [])
    return [algorithm_named(task, row["controller"]) for row in rows if row["role"] == AGENT]


def _each(known: Sequence[OnTask]) -> Iterator[tuple[OnTask, Cell]]:
    for one in known:
        for cell in one.cells:
            yield one, cell


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
        *(printed(np.sqrt(tail_mean(own))) for own in (penalties, one.reference.penalties)),
    ]


THRESHOLDS = np.linspace(-0.2, 1.05, 126)  # scores at which the performance profile is taken
WINDOW = 60  # control steps of an episode that are shown

MOST, MARGIN = 2.0, 1.01
"""Most cost on a learning curve, over the reference's; and the margin around all costs."""

BEST = "best agent of each task"  # label of the line that has its trainings

LAW = {"color": "0.4", "linestyle": (0, (6, 2, 1, 2, 1, 2)), "label": "best controller"}
"""How the best controller's line looks."""

EFFORT = Effort(random=1, kept=1, first=5, second=12, rounds=0, searches=0, last=8)
"""Of the plan of the episode that is shown."""


def draw_results(results: Results, folder: Path, policies: Path) -> None:
    """Draw all figures into a folder, which is made if need be.

    The episodes are those of the best agents whose policies are published in a folder.
    """
    known = on_tasks(results)
    folder.mkdir(parents=True, exist_ok=True)
    curves, profile, episodes = (folder / f"{name}.png" for name in FIGURES)
    with style():
        _curves(known, curves)
        _profile(known, profile)
        shown = {one.name: _examples(one, policies) for one in known}
        if any(shown.values()):
            with_strips({name: own for name, own in shown.items() if own}, episodes)


def _examples(one: OnTask, policies: Path) -> list[Evaluation]:
    """Return the first held-out episode by the best controller, the agent and the planner."""
    best = one.best.task, one.best.algorithm
    found = [row for row in read_published(policies).rows if (row.task, row.algorithm) == best]
    scene = load_scene(one.task)
    if scene.actuation.stretch is None or not found or found[0].file is None:
        return []
    controllers = (
        reference_controller(scene, one.reference.controller),
        controller_of(found[0], scene, policies),
    )
    done = [evaluate(scene, controller, episodes=2) for controller in controllers]
    starts = {result.name: result.applied for result in done}
    return [*done, evaluate(scene, Planner(scene, starts, EFFORT), episodes=2)]


def _curves(known: Sequence[OnTask], path: Path) -> None:
    """Draw the least cost so far over time, a panel a task: the median of the seeds, and all."""
    rows = -(-len(known) // 2)
    figure, axes = panels(1.7 * rows + 0.4, rows, 2)
    for algorithm in _algorithms(known):  # the legend has all, and some tasks lack some
        axes[0].plot([], [], **_look(known, algorithm))
    for panel in axes[len(known) :]:
        panel.set_visible(False)
    for one, panel in zip(known, axes, strict=False):
        panel.axhline(one.reference.validation, **LAW)
        for cell in one.cells:
            seconds, (least, median, most) = cell.middle_curve()
            look = _look(known, cell.algorithm)
            panel.fill_between(seconds, least, most, color=look["color"], alpha=0.2, linewidth=0)
            panel.plot(seconds, median, **look | {"label": None})
        panel.set(title=one.name, ylabel="cost [-]")
        costs = (min(seed.validation) for cell in one.cells for seed in cell.trainings)
        low = min(one.reference.validation, *costs)
        high = min(MARGIN * panel.get_ylim()[1], MOST * one.reference.validation)
        panel.set_ylim(low / MARGIN, high)
        logarithmic(panel)
        logarithmic(panel, "x")
    for panel in axes[max(len(known) - 2, 0) : len(known)]:
        panel.set_xlabel("time [s]")
    legend_below(figure, axes[0], len(STYLES) + 1)
    save(figure, path)


def _look(known: Sequence[OnTask], algorithm: str) -> dict[str, Any]:
    """Return how the line of an algorithm or of the controller looks, the same on all figures."""
    if algorithm == LAW["label"]:
        return LAW
    number = [*_algorithms(known), BEST].index(algorithm)
    style = STYLES[number % len(STYLES)]
    colour = COLOURS[number % len(COLOURS)]
    return {"color": colour, "linestyle": style, "label": algorithm}


def _algorithms(known: Sequence[OnTask]) -> list[str]:
    return sorted({cell.algorithm for one in known for cell in one.cells}, key=LEARNERS.index)


def _profile(known: Sequence[OnTask], path: Path) -> None:
    """Draw which fraction of all trainings and tasks has more than a score."""
    figure, (panel,) = panels(2.6, 1, 1)
    of_tasks = [{cell.algorithm: cell for cell in one.cells} for one in known]
    shown = {
        name: [of_task[name] for of_task in of_tasks]
        for name in _algorithms(known)
        if all(name in of_task for of_task in of_tasks)
    }
    shown[BEST] = [one.best for one in known]
    costs = {name: [cell.costs for cell in cells] for name, cells in shown.items()}
    costs[LAW["label"]] = [np.array([one.reference.cost]) for one in known]
    for name, rows in costs.items():
        scores = [one.scores(own) for one, own in zip(known, rows, strict=True)]
        parts = np.mean([performance_profile(own[None], THRESHOLDS) for own in scores], axis=0)
        panel.plot(THRESHOLDS, parts, **_look(known, name))
    panel.set(
        xlabel="score s (0: best constant, 1: clairvoyant optimum)",
        ylabel="fraction of trainings above s",
    )
    panel.set_ylim(-0.02, 1.02)
    legend_below(figure, panel, len(costs))
    save(figure, path)


def with_strips(shown: Mapping[str, Sequence[Evaluation]], path: Path) -> None:
    """Draw the displacements of an episode in one panel, and each stretch in a strip of its own.

    Each task has the episode under the best controller, the best agent and the plan.
    """
    labels = ("best controller", "best agent", "plan")
    figure, axes = panels(
        4.4, 1 + len(labels), len(shown), sharex="col", heights=(2.2, *(1.0 for _ in labels))
    )
    for column, (name, examples) in enumerate(shown.items()):
        upper, *strips = axes[column :: len(shown)]
        peak = int(np.abs(examples[1].displacement[:, 0]).argmax())
        first = min(max(peak - WINDOW // 3, 0), len(examples[1].time) - WINDOW)
        part = slice(first, first + WINDOW)
        for k, (label, result) in enumerate(zip(labels, examples, strict=True)):
            look = {"color": COLOURS[k], "label": label, "linewidth": 0.9}
            upper.plot(result.time[part], result.displacement[part, 0], STYLES[k], **look)
            # An actuator holds still over the control step that ends at each instant.
            stretch = result.applied[part, 0, -1]
            strips[k].plot(result.time[part], stretch, STYLES[k], drawstyle="steps-pre", **look)
        limits = np.array([strip.get_ylim() for strip in strips])
        for strip in strips:
            strip.set_ylim(limits.min(), limits.max())
        upper.set_title(name)
        strips[-1].set_xlabel("time [s]")
    axes[0].set_ylabel("x1 / scale [-]")
    for strip in axes[len(shown) :: len(shown)]:
        strip.set_ylabel("λ [-]")
    legend_below(figure, axes[0], 3)
    save(figure, path)
