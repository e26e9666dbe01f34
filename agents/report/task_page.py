"""The page on the tasks, ``docs/tasks.md``, made from scenes and committed scores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agents.evaluation.scores import SCORES
from agents.report.description import describe
from agents.report.tables import markdown, percent
from mm_gym import load_scene
from mm_gym.files import read_text
from mm_gym.tasks import ids, path_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    Row = Mapping[str, str | float]

PAGE = SCORES.with_name("tasks.md")

OBSERVING = ("law", "predictive", "learned")
"""Roles of what reads no more than an agent does."""

HEAD = """# Tasks

<!-- Written by `make tasks`; do not edit. -->

`gymnasium.make("mm_gym/PreStretch-v0")` after `import mm_gym`, or
`gymnasium.make("mm_gym:mm_gym/PreStretch-v0")` without it. Each task is also a scene file in
`configs/scenes/`, to be changed and given as `scene=`; single fields change with `changes=`.

## What there is to gain

**Cost** is the root of the mean of -reward over all steps of 100 held-out episodes; where only the
displacement is rewarded, it is the rms of x1 over its scale. The 95 % intervals are the bootstrap's
percentiles over episodes. The best constant is the best in hindsight, on these very episodes;
classical controllers are tuned on others. Controllers read what an agent observes; those marked
otherwise also read the true state, or all of the episode. The best passive damper is another plant
(`docs/ranking.md`). Predictive control tries plans on a model that does not know the disturbance to
come. The **clairvoyant optimum (best found)**, in tables "best known plan", knows the whole
episode, its disturbance included: see [how it is found](controllers.md#the-clairvoyant-optimum). A
better plan can exist. Where there is no excitation, or only a harmonic that shows after a few
steps, an agent can come close. Under noise, impulses and earthquakes a share of the distance is
[the cost of not knowing what comes](#what-preview-is-worth). **Headroom** is 1 - cost / cost of the
best constant. A **price** is a control weight.

**Energy injected**: the work of changing the stretch, added up from the start of an episode, at its
highest, on average over the episodes. Zero means that the controller never returned more energy
than it had absorbed.

An episode that terminates early, in a scene with `objective.displacement_limit` or
`objective.rail_half_length`, pays a **terminal cost**. With N the steps of the horizon, n those
before the end, and L the larger of -reward at the limits (full action; a term without a limit at
its scale) and the largest -reward of the n steps, its mean of -reward is
(sum over the n steps + (N - n) L) / N + L. So an early end is worse than every episode that lasts
with a -reward of L at most, and of two ends of equal L the later is the better. Tuning, validation
and evaluation use this one definition. {limited}
"""


FORESIGHT = """## What preview is worth

An estimate of how much of the distance to the clairvoyant optimum (best found) no agent can gain,
because it does not know what is to come. One controller runs in two forms. In every step it plans
40 steps ahead, by the steps of Gauss and Newton that find the clairvoyant optima, from the true
state and that of the filters that shape the noise. One form knows the disturbance of these steps,
the other expects its mean: no impulse, and noise that decays as its filters do. They differ in
nothing else, so the difference of their costs is the worth of preview; the last column is that over
the distance of the second form to the clairvoyant optimum. What is left is for longer plans and
better local optima. It is no bound: where the problem is not linear and quadratic, to prepare for
what can come is better than to plan for the mean.

Tasks without random excitation are not listed. [Value iteration](training.md#value-iteration)
finds the optimum without preview, but for its grid, where it applies: what is between it and the
clairvoyant optimum is preview.
"""


def page(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page of all tasks with these scores, as of ``docs/task_scores.json``."""
    names = ids()
    summary = markdown(
        [
            "task",
            "best constant",
            "best controller",
            "its headroom",
            "best found",
            "its headroom",
        ],
        [_summary(name, scores[name]["rows"]) for name in names],
    )
    foresight = markdown(
        [
            *("task", "best found", "knows the next 40 steps", "expects their mean"),
            *("best that observes", "share of preview"),
        ],
        [_foresight(name, scores[name]) for name in names if "foresight" in scores[name]],
    )
    sections = [_section(name, scores[name]["rows"]) for name in names]
    head = HEAD.format(limited=_limited(names))
    return "\n\n".join([head + "\n" + summary, FORESIGHT + "\n" + foresight, *sections]) + "\n"


def _limited(names: Sequence[str]) -> str:
    """Return which tasks have episodes that can terminate early, as a sentence."""
    goals = {name: load_scene(name).objective for name in names}
    found = [
        f"`{name}`"
        for name, goal in goals.items()
        if goal.displacement_limit is not None or goal.rail_half_length is not None
    ]
    return f"Tasks with a limit: {', '.join(found)}." if found else "No task below has a limit."


def _summary(name: str, rows: Sequence[Row]) -> list[str]:
    constant, law, planner = (_least(rows, role) for role in ("constant", "law", "planner"))
    return [
        f"[`{name}`](#{_anchor(name)})",
        f"{constant:.3g}",
        f"{law:.3g}",
        percent(1 - law / constant),
        f"{planner:.3g}",
        percent(1 - planner / constant),
    ]


def _foresight(name: str, scores: Mapping[str, Any]) -> list[str]:
    expected, foreseen = (scores["foresight"][key] for key in ("expected", "foreseen"))
    known = _least(scores["rows"], "planner")
    observing = min(row["cost"] for row in scores["rows"] if row["role"] in OBSERVING)
    part = percent((expected - foreseen) / (expected - known))
    return [f"`{name}`", *(f"{cost:.3g}" for cost in (known, foreseen, expected, observing)), part]


def _least(rows: Sequence[Row], role: str) -> float:
    return min(float(row["cost"]) for row in rows if row["role"] == role)


def _anchor(name: str) -> str:
    """Return what GitHub makes of the heading."""
    return name.replace("/", "").lower()


def _about(file: Path) -> str:
    """Return what the scene file's comment says after the task's id, and a space; else nothing."""
    lines = [line for line in read_text(file).splitlines() if line.startswith("# ")]
    text = lines[0].partition(": ")[2] if lines else ""
    return text and f"{text[0].upper()}{text[1:]} "


def _section(name: str, rows: Sequence[Row]) -> str:
    file = path_of(name)
    constant = _least(rows, "constant")
    springs = "injected" in rows[0]
    scores = markdown(
        [
            *("controller", "reads", "cost", "95 % interval", "headroom", "rms of x1 / scale"),
            *(["energy injected [mJ]"] if springs else []),
        ],
        [
            [
                str(row["controller"]),
                str(row["reads"]),
                f"{row['cost']:.4g}",
                f"{row['low']:.4g} to {row['high']:.4g}",
                percent(1 - float(row["cost"]) / constant),
                f"{row['displacement']:.4g}",
                *([f"{1e3 * float(row['injected']):.3g}"] if springs else []),
            ]
            for row in rows
        ],
    )
    intro = f"{_about(file)}File: `configs/scenes/{file.name}`."
    return f"## {name}\n\n{intro}\n\n{describe(load_scene(file))}\n\n**Scores.**\n\n{scores}"
