"""The page of what agents reach, ``docs/results.md``."""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING

import numpy as np

from agents.comparison.trainings import (
    algorithms_of,
    cheaper,
    episodes_won,
    improvement,
    middle_cost,
)
from agents.evaluation.aggregates import tail_mean
from agents.report.tables import markdown, percent
from mm_gym import compile_scene, load_scene
from mm_gym.tasks import ids, short_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from agents.comparison.trainings import OnTask, Trainings
    from agents.evaluation.aggregates import Estimate

HEAD = """# Results

<!-- Written by `python -m agents.results`; do not edit. -->

    python -m agents.results configs/results.toml

trains on its tasks, continues where it was stopped, and writes this page; `--no-train` writes it
from what is trained already. `python -m agents.sweep configs/results.toml` only trains, also on a
Ray cluster. Generations, iterations or steps end a training, and no clock does. So each cost can be
repeated with the same code on the same kind of processor; another kind can round differently, and a
search then ends elsewhere. This page was made on {machine}, one processor a training.
{covered}

Costs are those of `docs/tasks.md`, on the same 100 held-out episodes. No training runs on them
([what they have served for](evaluation.md#the-held-out-episodes)). The **reference controller** is
the best, in these very episodes, of the LQR, velocity feedback, the controllers of the stretch and
their combinations; figures call it "best law", and names of controllers a control weight "price".
The best controller of all classical ones, predictive control and the clairvoyant optimum (best
found), which knows the episode, are those of `docs/ranking.md`;
[controllers](controllers.md#known-but-not-in-the-tables) has what is known of others.
"""

KINDS = {
    "evolution": "a small network around a controller, by evolution: `agents.evolve`",
    "gradient": "the same with a wider network and its memory, by exact gradients: "
    "`agents.descend`",
    "value_iteration": "the optimum without preview, on a grid: `agents.iterate`",
    "ppo": "a network that begins with nothing, by PPO",
    "residual": "a network by PPO, added to the controller that `configs/results.toml` names",
    "sac": "a network that begins with nothing, by SAC",
}
"""What the algorithms of `configs/results.toml` are."""

COSTS = """## Costs

The interquartile mean over the seeds. In brackets stands its 95 % interval for other seeds and
other episodes of the task ([how](evaluation.md#cost-score-intervals)); a single seed has none.
"""

DETAILS = """## Seeds

A seed is a training of its own. Cheaper are the seeds that cost less than the reference controller
in these episodes. Improvement is the probability of that, with the 95 % interval of Clopper and
Pearson: for other seeds in the same episodes. Episodes won is the fraction of single episodes that
cost less. How long a search takes is measured in [benchmarks](benchmarks.md#evolution).
"""

MISSING = """Trainings with fewer than {most} seeds, which the same command trains:
"""

CURVES = """## Learning curves

The lowest cost so far on the 100 validation episodes: the median of the seeds, and the range from
the best to the worst of them. The line of the reference controller is its cost there. Costs above
twice that are left out. The time is that of each training when it was made, the median of the
seeds, on a machine that did other work too; a later version of the code can be faster.

![Cost over time of training]({curves})
"""

PROFILE = """## Performance profile

The fraction of all trainings, over the tasks, above a score: of the algorithms that were run on all
tasks, and of the best algorithm of each task.

![Fraction of all trainings above a score]({profile})
"""

ENERGY = """## Energy that the stretch puts in

The most that stretching has put in by any time, less what it has taken out: the mean over the
episodes.
"""

ROBUSTNESS = """## Robustness

The reference controller and the agents as they are, on scenes for which neither was made; of each
algorithm, the training of median cost.

![Costs on changed scenes]({robustness})
"""

STRETCHES = """The first held-out episode of each task with a stretch, around its largest
displacement. The plan knows what is to come. It is improved for some seconds only, from what the
reference controller and the agent applied, so it is not that of the tables; where it lies on the
agent's line, the search found nothing better.

![Displacement and stretch by reference controller, agent and plan]({episodes})
"""

SLOPES = """The slope of the force's action over each observed number, as the environment scales
it: of the LQR, and of the agent of median cost, at rest (from -0.01 to 0.01) and over half of the
scale (from -0.5 to 0.5).
"""

FAILURES = """## Where agents fail

The cost of each held-out episode over that of its clairvoyant optimum (best found), for the
training of median cost; and the cost of the costliest tenth of the episodes.
"""


COMPARED = {
    "best controller": "law",
    "predictive control": "predictive",
    "clairvoyant optimum (best found)": "planner",
}
"""Row of the costs -> role in `docs/task_scores.json`."""


def page(known: Sequence[OnTask], figures: Sequence[Path]) -> str:
    """Return the page, with figures that are in a folder next to it."""
    curves, profile, robustness, episodes = (f"{path.parent.name}/{path.name}" for path in figures)
    parts = [
        HEAD.format(machine=_machine(), covered=_covered(known)),
        _kinds(known),
        COSTS,
        _costs(known),
        DETAILS,
        _details(known),
        *_missing(known),
        CURVES.format(curves=curves),
        PROFILE.format(profile=profile),
        ENERGY,
        _energy(known),
        ROBUSTNESS.format(robustness=robustness),
        "## What was learned",
        *([STRETCHES.format(episodes=episodes)] if any(one.examples for one in known) else []),
        *([SLOPES, _slopes(known)] if any(one.slopes is not None for one in known) else []),
        FAILURES,
        _failures(known),
    ]
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _covered(known: Sequence[OnTask]) -> str:
    """Return which tasks the page is on, and which it is not, as sentences."""
    trained = {one.task for one in known}
    names = [short_name(task) for task in ids() if task not in trained]
    told = f"It covers {', '.join(one.name for one in known)}."
    return f"{told} Not trained for it: {', '.join(names)}." if names else told


def _machine() -> str:
    return f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"


def _span(found: Estimate, digits: int = 4) -> str:
    value = f"{found.value:.{digits}f}"
    ends = f" [{found.low:.{digits}f}, {found.high:.{digits}f}]"
    return value if np.isnan(found.low) else value + ends


def _each(known: Sequence[OnTask]) -> Iterator[tuple[OnTask, Trainings]]:
    for one in known:
        for trainings in one.trainings:
            yield one, trainings


def _kinds(known: Sequence[OnTask]) -> str:
    """Return the table of what the algorithms that were run are."""
    return markdown(["algorithm", "is"], [[k, KINDS.get(k, k)] for k in algorithms_of(known)])


def _costs(known: Sequence[OnTask]) -> str:
    """Return the table of costs: a row for each algorithm and what it is compared with."""
    rows: list[list[str]] = [["reference controller", *(f"{one.law.cost:.4f}" for one in known)]]
    for name in algorithms_of(known):
        found = [next((t for t in one.trainings if t.algorithm == name), None) for one in known]
        rows.append([name, *("-" if t is None else _span(middle_cost(t)) for t in found)])
    for label, role in COMPARED.items():
        rows.append([label, *(f"{one.known[role]:.4f}" for one in known)])
    return markdown(["", *(one.name for one in known)], rows)


def _details(known: Sequence[OnTask]) -> str:
    header = [
        *("task", "reference controller", "algorithm", "seeds", "least and most", "cheaper"),
        *("improvement", "episodes won"),
    ]
    rows = [
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
    return markdown(header, rows)


def _missing(known: Sequence[OnTask]) -> Iterator[str]:
    """Yield what has not been trained: algorithms with fewer seeds than others, or none."""
    counts = {(one.name, t.algorithm): len(t.costs) for one, t in _each(known)}
    most = max(counts.values())
    fewer: list[str] = []
    for name in algorithms_of(known):
        own = {one.name: counts.get((one.name, name), 0) for one in known}
        told = ", ".join(f"{task} {count}" for task, count in own.items() if count < most)
        if told:
            fewer.append(f"- {name}: {told}.")
    if fewer:
        yield f"{MISSING.format(most=most)}\n" + "\n".join(fewer)


def _energy(known: Sequence[OnTask]) -> str:
    rows: list[list[str]] = []
    for one, trainings in _each(known):
        of_seeds = [r.injected.mean() for r in trainings.results if r.injected is not None]
        if one.law.injected is not None:
            values = np.median(of_seeds), one.law.injected.mean()
            rows.append([one.name, trainings.algorithm, *(f"{1e3 * v:.2f}" for v in values)])
    return markdown(
        ["task", "algorithm", "median of the seeds [mJ]", "reference controller [mJ]"], rows
    )


def _slopes(known: Sequence[OnTask]) -> str:
    rows: list[list[str]] = []
    channels: list[str] = []
    for one in known:
        if one.slopes is not None:
            channels = [c.name for c in compile_scene(load_scene(one.task)).observed]
            labels = "LQR", "agent, at rest", "agent, half the scale"
            pairs = zip(labels, one.slopes, strict=True)
            rows += [[one.name, label, *(f"{v:.2f}" for v in own)] for label, own in pairs]
    return markdown(["task", "slope of", *channels], rows)


def _failures(known: Sequence[OnTask]) -> str:
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
    header = [
        *("task", "median over optimum", "most over optimum", "costliest tenth"),
        "costliest tenth of the reference controller",
    ]
    return markdown(header, rows)


def _tail(penalties: NDArray[np.float64]) -> float:
    return float(np.sqrt(tail_mean(penalties)))
