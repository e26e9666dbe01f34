"""The page that ranks all that is known on each task, ``docs/ranking.md``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.evaluation.headroom import least_cost
from agents.evaluation.scores import SCORES
from agents.report.surprises import surprises
from agents.report.tables import markdown

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from agents.report.surprises import Row

PAGE = SCORES.with_name("ranking.md")

HEAD = """# Ranking

<!-- Written by `python -m agents.ranking`; do not edit. -->

Costs on the same 100 held-out episodes of each task, as `docs/tasks.md` defines them. The 95 %
intervals are for other episodes; a learned controller is one training, and other trainings of the
same algorithm differ (`docs/results.md`). The **score** is s = (J_constant - J) / (J_constant -
J_best found): 0 for the best constant action, 1 for the clairvoyant optimum (best found), which
knows the episode. Tables call it "best known plan", and a control weight "price".

- **zero**: no action. **Best constant**: the best in hindsight of what never moves.
- **Passive optimum**: the damping of the interface, and the stretch or stiffness of the springs,
  of the best passive damper (`mm_gym.tuning`). It is another plant: no actuator of the task changes
  all of them. Dry friction has no damping to tune.
- **Best controller**: the best of the classical controllers here, see
  [what is known of others](controllers.md#known-but-not-in-the-tables). **Predictive**: predictive
  control. **Learned**: the best of the trained agents here: `python -m agents.ranking runs/NAME`
  adds one.
- **Best found**: the least cost of all that runs on the task's own plant.

Under a table stand the orders that a reader would not expect; the
[reasons](controllers.md#unexpected-orders) are with the controllers.
"""

COLUMNS = {
    "zero": "zero",
    "best constant": "constant",
    "passive optimum": "passive",
    "best controller": "law",
    "predictive": "predictive",
    "learned": "learned",
}
"""Heading -> role."""


def page(scores: Mapping[str, Mapping[str, Sequence[Row]]]) -> str:
    """Return the page with these scores, as of ``docs/task_scores.json``."""
    rows = {task: of_task["rows"] for task, of_task in scores.items()}
    summary = markdown(
        ["task", *COLUMNS, "best found"],
        [_summary(task, of_task) for task, of_task in rows.items()],
    )
    sections = [part for task, of_task in rows.items() for part in _section(task, of_task)]
    return "\n\n".join([HEAD + "\n" + summary, *sections]) + "\n"


def _summary(task: str, rows: Sequence[Row]) -> list[str]:
    cells = [f"`{task}`"]
    for role in COLUMNS.values():
        costs = [float(row["cost"]) for row in rows if row["role"] == role]
        cells.append(f"{min(costs):.3g}" if costs else "-")
    return [*cells, f"{least_cost(rows):.3g}"]


def _section(task: str, rows: Sequence[Row]) -> Iterator[str]:
    constant = next(float(row["cost"]) for row in rows if row["role"] == "constant")
    span = constant - least_cost(rows)
    yield f"## {task}"
    yield markdown(
        ["controller", "reads", "cost", "95 % interval", "score"],
        [
            [
                str(row["controller"]),
                str(row["reads"]),
                f"{row['cost']:.4g}",
                f"{row['low']:.4g} to {row['high']:.4g}",
                f"{(constant - float(row['cost'])) / span:.2f}",
            ]
            for row in sorted(rows, key=lambda row: float(row["cost"]))
        ],
    )
    found = surprises(rows)
    if found:
        yield "\n".join(f"- {sentence}" for sentence in found)
