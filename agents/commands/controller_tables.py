"""Measure the tables of ``docs/controllers.md``.

For each task: every controller from late and noisy observations, and from the true state; and the
time in which predictive control finds an action, on one core. Rows of other tasks stay as they are.
"""

import re
from pathlib import Path
from typing import Annotated

import tyro

from agents.errors import command
from agents.evaluation.contestants import tasks_called
from agents.evaluation.rigs import compare, time_of_action, tuned
from agents.report.pages import markdown
from mm_gym import SceneError, load_scene
from mm_gym.files import read_text, write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"
LATE = ("task", "controller", "from the observation", "from the true state")
RATES = ("task", "control step [ms]", "time of an action [ms]", "faster than real time by")


class Arguments(Document):
    """What to measure."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """names such as Hybrid; all of mm_gym by default"""


def with_rows(text: str, header: tuple[str, ...], task: str, rows: list[list[str]]) -> str:
    """Return the page with the rows of a task in the table of this header replaced."""
    title = re.escape(markdown(header, []))
    found = re.search(rf"{title}\n((?:\|.*\n)*)", text)
    if found is None:
        msg = f"{PAGE}: the table of {', '.join(header)} is missing"
        raise SceneError(msg)
    kept = [[cell.strip() for cell in line.strip("|").split("|")] for line in found[1].splitlines()]
    rows = [[f"`{task}`", *row] for row in rows]
    every = [row for row in kept if row[0] != f"`{task}`"] + rows
    order = [f"`{name}`" for name in ids()]
    every.sort(key=lambda row: order.index(row[0]))
    return text[: found.start()] + markdown(header, every) + "\n" + text[found.end() :]


@command
def main(arguments: Arguments) -> None:
    """Measure from the command line."""
    for name in tasks_called(arguments.tasks or ids()):
        scene = load_scene(name)
        laws = tuned(scene)
        step, spent = scene.control.time_step, time_of_action(scene, laws[-1])
        rates = [[f"{1e3 * step:.3g}", f"{1e3 * spent:.2g}", f"{step / spent:.2g}"]]
        late = [
            [law, *("-" if cost is None else f"{cost:.3f}" for cost in costs)]
            for law, *costs in compare(scene, laws)
        ]
        page = with_rows(read_text(PAGE), RATES, name, rates)
        write_text(PAGE, with_rows(page, LATE, name, late))
        print(f"{name}: written to {PAGE}")
