"""The page that ranks all that is known on each task, ``docs/ranking.md``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from agents.evaluation.headroom import CLASSICAL, least_cost
from agents.evaluation.scores import SCORES
from agents.report.pages import render

Row = Mapping[str, str | float]

PAGE = SCORES.with_name("ranking.md")

COLUMNS = {
    "zero": ("zero",),
    "best constant": ("constant",),
    "passive optimum": ("passive",),
    "best controller": CLASSICAL,
    "predictive": ("predictive",),
    "learned": ("learned",),
}
"""Heading -> roles."""


MARGIN = 1e-3  # relative differences of costs up to this one count as none

NO_BETTER = "no better than the best constant"


def page(scores: Mapping[str, Mapping[str, Sequence[Row]]]) -> str:
    """Return the page with these scores, as of ``docs/task_scores.json``."""
    rows = {task: of_task["rows"] for task, of_task in scores.items()}
    return render(
        "ranking",
        columns=list(COLUMNS),
        summary=[_summary(task, of_task) for task, of_task in rows.items()],
        sections=[(task, _ranked(of_task), surprises(of_task)) for task, of_task in rows.items()],
    )


def _summary(task: str, rows: Sequence[Row]) -> list[str]:
    cells = [f"`{task}`"]
    for roles in COLUMNS.values():
        costs = [float(row["cost"]) for row in rows if row["role"] in roles]
        cells.append(f"{min(costs):.3g}" if costs else "-")
    return [*cells, f"{least_cost(rows):.3g}"]


def _ranked(rows: Sequence[Row]) -> list[list[str]]:
    constant = next(float(row["cost"]) for row in rows if row["role"] == "constant")
    span = constant - least_cost(rows)
    return [
        [
            str(row["controller"]),
            str(row["reads"]),
            f"{row['cost']:.4g}",
            f"{row['low']:.4g} to {row['high']:.4g}",
            f"{(constant - float(row['cost'])) / span:.2f}",
        ]
        for row in sorted(rows, key=lambda row: float(row["cost"]))
    ]


def surprises(rows: Sequence[Row]) -> list[str]:
    """Return what is unexpected in the order of a task's controllers, as sentences.

    Unexpected is: what does no better than the best constant; a controller of more knowledge that
    costs more than one of less; a passive damper that costs less than all classical controllers; a
    simple controller that costs less than the LQR.
    """
    return [sentence[0].upper() + sentence[1:] for sentence in _unexpected(rows)]


def _unexpected(rows: Sequence[Row]) -> Iterator[str]:
    of: dict[str, list[Row]] = {}
    for row in rows:
        of.setdefault(str(row["role"]), []).append(row)
    (constant,) = of["constant"]
    for role in ("passive", "law", "predictive", "informed", "learned", "planner"):
        for row in of.get(role, []):
            if _beats(constant, row):
                yield f"{_name(row)} is {NO_BETTER}."
    regulators = [row for row in of.get("law", []) if _name(row).startswith("LQR")]
    simple = [row for row in of.get("law", []) if _name(row).startswith("velocity feedback")]
    yield from _pairs(simple, regulators)
    for role, above in (("law", "predictive"), ("predictive", "informed")):
        yield from _pairs(_best(of.get(role, [])), of.get(above, []))
    observing = [row for role in ("law", "predictive", "learned") for row in of.get(role, [])]
    yield from _pairs(observing, of.get("planner", []))
    yield from _pairs(of.get("passive", []), _best(of.get("law", [])))


def _pairs(better: Sequence[Row], worse: Sequence[Row]) -> Iterator[str]:
    for one in better:
        for other in worse:
            if _beats(one, other):
                yield f"{_name(one)} costs less than {_name(other)}."


def _best(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: float(row["cost"]))[:1]


def _beats(one: Row, other: Row) -> bool:
    return float(one["cost"]) < float(other["cost"]) * (1.0 - MARGIN)


def _name(row: Row) -> str:
    return str(row["controller"])
