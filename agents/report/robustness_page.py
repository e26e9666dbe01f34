"""The page of rigs that differ, ``docs/robustness.md``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from operator import itemgetter
from typing import Any

from agents.evaluation.rigs import DELAYS, EPISODES, task_of
from agents.evaluation.scores import SCORES
from agents.report.pages import percent, render
from mm_gym import load_scene, over_rigs
from mm_gym.tasks import robust_ids, short_name

Row = Mapping[str, Any]

PAGE = SCORES.with_name("robustness.md")

SHOWN = "mm_gym/PreStretchNoiseRobust-v0"  # variant whose ranges are shown


def page(scores: Mapping[str, Any]) -> str:
    """Return the page of the scores, as of ``docs/robustness_scores.json``."""
    widths = {name: one.default for name, one in signature(over_rigs).parameters.items()}
    return render(
        "robustness",
        episodes=EPISODES,
        variants=[[f"`{name}`", f"`{task_of(name)}`"] for name in robust_ids()],
        shown=short_name(SHOWN),
        task=short_name(task_of(SHOWN)),
        example=_ranges(SHOWN),
        spread=percent(widths["spread"]),
        noise=percent(widths["noise"]),
        lag=f"{widths['lag']:g}",
        delay=widths["delay"],
        delays=[f"task, {n} late" for n in DELAYS],
        sections=[(name, [_cells(row) for row in scores[name]["rows"]]) for name in scores],
        compared=[cells for name in scores if (cells := _compared(name, scores[name]["rows"]))],
    )


def _ranges(variant: str) -> list[list[str]]:
    """Return dotted name, least and largest value of what a variant draws."""
    drawn = load_scene(variant).randomization.items()
    return [[f"`{name}`", *(f"{end:g}" for end in ends)] for name, ends in drawn]


def _cells(row: Row) -> list[str]:
    costs = [f"{row[name]:.3g}" for name in ("worst", *(f"late {n}" for n in DELAYS))]
    over = f"{row['rigs']:.3g} [{row['low']:.3g}, {row['high']:.3g}]"
    return [row["controller"], row["role"], over, *costs]


def _compared(variant: str, rows: Sequence[Row]) -> list[str]:
    """Return the best controller and agents of a variant, and what the rigs cost; else nothing."""
    best, own = _least(rows, "controller", "rigs"), _least(rows, "over the rigs", "rigs")
    special = _least(rows, "specialist", "late 0")
    if best is None or own is None or special is None:
        return []
    latest = f"late {DELAYS[-1]}"
    return [
        f"`{short_name(variant)}`",
        *(f"{row['rigs']:.3g}" for row in (best, special, own)),
        percent(own["late 0"] / special["late 0"] - 1.0),
        *(f"{row[latest] / row['late 0']:.3g}" for row in (best, special, own)),
    ]


def _least(rows: Sequence[Row], role: str, where: str) -> Row | None:
    """Return the row of a role that costs least somewhere, if there is one."""
    return min((row for row in rows if row["role"] == role), key=itemgetter(where), default=None)
