"""The page of what agents reach, ``docs/results.md``."""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING

import numpy as np

from agents.comparison.trainings import algorithms_of, episodes_won, improvement, middle_cost
from agents.evaluation.aggregates import tail_mean
from agents.report.tables import markdown, percent
from mm_gym import compile_scene, load_scene

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from agents.comparison.trainings import OnTask, Trainings
    from agents.evaluation.aggregates import Estimate

HEAD = """# Results

<!-- Written by `python -m agents.results`; do not edit. -->

    python -m agents.results configs/results.toml

trains on all tasks, goes on where it was stopped, and writes this page; `--no-train` writes it of
what is trained already. `python -m agents.sweep configs/results.toml` trains alone, also on a Ray
cluster. Generations or steps, and not time, end a training, so each cost can be repeated. This page
was made on {machine}, one processor a training.

Costs are those of `docs/tasks.md` on the same 100 held-out episodes, which no training and no
tuning has seen. Intervals of 95 % are a bootstrap over seeds and episodes. The best law is the best
of the classical laws in these very episodes; predictive control and the best known plan, which
knows the episode, are those of `docs/ranking.md`.
"""

KINDS = {
    "evolution": "a small network around a law, by evolution: `agents.evolve`",
    "gradient": "the same with a wider network and its memory, by exact gradients: "
    "`agents.descend`",
    "value_iteration": "the best law without foresight, on a grid: `agents.iterate`",
    "ppo": "a network that begins with nothing, by PPO",
    "residual": "a network by PPO, added to the law that `configs/results.toml` names",
    "sac": "a network that begins with nothing, by SAC",
}
"""What the algorithms of `configs/results.toml` are."""

COSTS = """## Costs

The interquartile mean over the seeds.
"""

READING = """Searches around a law are better than the law on every task: by evolution within
minutes, by gradients through the physics where evolution stalls. PPO from nothing, with 5.12 M
control steps, is better than the best law on CarriageForceFriction, PreStretchNoise and
PreStretchShock. SAC, with a twentieth of the steps in the same time, is better on
CarriageForceFriction alone. Added to a law, with a quarter of the steps, PPO gains 5 % on
CarriageForceFriction, where it does not find what it finds from nothing, 3 % on PreStretchNoise and
PreStretchShock and half a per cent on CarriageForceDuffing; on PreStretch it loses half a per cent,
and on Hybrid and on CarriageForce, where the law is optimal, it gains nothing.
"""

DETAILS = """## Seeds

Improvement is the probability that a training costs less than the best law, with its interval;
episodes won is the part of single episodes that cost less. The time is the median of the trainings
on one processor, on a machine that did other work besides.
"""

MISSING = """Where there are fewer than {most} seeds, the clock ended the work, not the costs that
were found; an algorithm that is in no table was not run at all. The same command trains the rest.
Seeds that there are:
"""

CURVES = """## Learning curves

The least cost so far on the 100 validation episodes, on which the best law's cost is drawn too: the
median of the seeds, and from the best to the worst of them. Costs above twice that of the law are
left out. The time is that of the trainings as they were, on a machine that did other work besides,
the median of the seeds.

![Cost over time of training]({curves})
"""

PROFILE = """## Performance profile

Which part of all trainings, over the tasks, has more than a score, of the algorithms that were run
on all tasks, and of each task's best.

![Part of all trainings above a score]({profile})
"""

ENERGY = """## Energy that the stretch puts in

The most that stretching has put in by any time, less what it has taken out: the mean over the
episodes. On PreStretch agents by gradients put in ten times what the law does: they never stop
moving the springs.
"""

ROBUSTNESS = """## Robustness

Law and agents as they are, on scenes that neither was made for; of the trainings, the one in the
middle. Agents around a law bear other stiffnesses as well as laws or better, and Hybrid's law loses
most there. A delay of one step takes away what agents gain on Friction and PreStretchNoise, and
noise on all sensors what they gain on PreStretch and Duffing. PPO and SAC from nothing lose little
under noise on the tasks with a stretch. On PreStretchNoise and Hybrid agents by gradients bear a
delay of two steps, with which they were not trained, worst.

![Costs on changed scenes]({robustness})
"""

STRETCHES = """The first held-out episode of each task with a stretch, around its largest
displacement. The plan knows what is to come, but is improved for some seconds only, from what law
and agent applied: it is not that of the tables, and where it lies on the agent's line the search
found nothing better.

![Displacement and stretch by law, agent and plan]({episodes})
"""

SLOPES = """The slope of the force's action over each observed number, as the environment scales
it: of the LQR, and of the agent in the middle of the seeds, at rest (from -0.01 to 0.01) and over
half of the scale (from -0.5 to 0.5).
"""

GAINS = """Gains: on CarriageForce the agent is the LQR again, within 5 % of its large gains. On
Duffing it has a higher gain at rest than the LQR of the linear spring, and saturates earlier. On
Friction it feeds back the sphere's velocity and offset, to which the LQR is nearly blind: it
makes the sphere slip to centre it.
"""

FARTHEST = """Hybrid and PreStretchNoise are the farthest from their plans, which know the noise
to come. On Friction a few episodes cost several times the plan, where the sphere stays off its
centre. PreStretch gains least on the law in its worst episodes.
"""

FAILURES = """## Where agents fail

The cost of each held-out episode over that of its best known plan, for the training in the middle;
and the mean of the ten dearest episodes.
"""


def page(known: Sequence[OnTask], figures: Sequence[Path]) -> str:
    """Return the page, with figures that stand in a folder beside it."""
    curves, profile, robustness, episodes = (f"{path.parent.name}/{path.name}" for path in figures)
    parts = [
        HEAD.format(machine=_machine()),
        _kinds(known),
        COSTS,
        _costs(known),
        READING,
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
        GAINS,
        FAILURES,
        _failures(known),
        FARTHEST,
    ]
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _machine() -> str:
    return f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"


def _span(found: Estimate, digits: int = 4) -> str:
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def _each(known: Sequence[OnTask]) -> Iterator[tuple[OnTask, Trainings]]:
    for one in known:
        for trainings in one.trainings:
            yield one, trainings


def _kinds(known: Sequence[OnTask]) -> str:
    """Return the table of what the algorithms that were run are."""
    return markdown(["algorithm", "is"], [[k, KINDS.get(k, k)] for k in algorithms_of(known)])


def _costs(known: Sequence[OnTask]) -> str:
    """Return the table of costs: a row for each algorithm and what it is compared with."""
    rows: list[list[str]] = [["best law", *(f"{one.law.cost:.4f}" for one in known)]]
    for name in algorithms_of(known):
        found = [next((t for t in one.trainings if t.algorithm == name), None) for one in known]
        rows.append([name, *("-" if t is None else _span(middle_cost(t)) for t in found)])
    for label, role in (("predictive control", "predictive"), ("best known plan", "planner")):
        rows.append([label, *(f"{one.known[role]:.4f}" for one in known)])
    return markdown(["", *(one.name for one in known)], rows)


def _details(known: Sequence[OnTask]) -> str:
    header = [
        *("task", "best law", "algorithm", "seeds", "least and most", "improvement"),
        *("episodes won", "time [s]"),
    ]
    rows = [
        [
            one.name,
            one.law.name,
            trainings.algorithm,
            str(len(trainings.costs)),
            f"{trainings.costs.min():.4f} to {trainings.costs.max():.4f}",
            _span(improvement(trainings, one.law), 2),
            percent(episodes_won(trainings, one.law)),
            f"{np.median([curve.seconds[-1] for curve in trainings.curves]):.0f}",
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
    return markdown(["task", "algorithm", "median of the seeds [mJ]", "best law [mJ]"], rows)


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
    header = ["task", "median over plan", "most over plan", "worst tenth", "worst tenth of the law"]
    return markdown(header, rows)


def _tail(penalties: NDArray[np.float64]) -> float:
    return float(np.sqrt(tail_mean(penalties)))
