"""Does the README state the costs that the pages have?"""

import re
from pathlib import Path

import pytest

from agents.evaluation.headroom import CLASSICAL
from agents.evaluation.scores import read_scores
from agents.sweeps.results import cells_of, read_results
from mm_gym.tasks import short_name

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
STATED = re.findall(r"(\w+)\s\((0\.\d+),\s(?:they\s)?(0\.\d+)\)", README)
"""Task, cost of the agents, cost of the best controller."""


def best_controller(task):
    """Return the cost of the best controller that reads the observation."""
    return min(
        row["cost"]
        for row in read_scores()[f"mm_gym/{task}-v0"]["rows"]
        if row["role"] in CLASSICAL and row["reads"] == "observation"
    )


def costs(*algorithms):
    """Return the costs of algorithms on docs/results.md by task, those of earlier code too."""
    found = read_results()
    own = [(cell.task, cell.algorithm, cell.cost().value) for cell in cells_of(found.trainings)]
    own += [(one.task, one.algorithm, one.cost) for one in found.earlier]
    tasks = dict.fromkeys(short_name(task) for task, *_ in own)
    return {
        name: [c for task, kind, c in own if short_name(task) == name and kind in algorithms]
        for name in tasks
    }


def test_readme_states_five_tasks():
    assert len(STATED) == 5


@pytest.mark.parametrize(("task", "agents", "controllers"), STATED)
def test_costs_of_the_readme_are_those_of_the_pages(task, agents, controllers):
    assert controllers == f"{best_controller(task):.{len(controllers) - 2}f}"
    cells = [cell for cell in cells_of(read_results().trainings) if short_name(cell.task) == task]
    (stated,) = [cell for cell in cells if f"{cell.cost().value:.{len(agents) - 2}f}" == agents]
    _, _, behind = " ".join(README.split()).partition(f"{task} ({agents}")
    seeds = re.search("in (each|nine) of ten", behind)
    cheaper = (stated.costs < best_controller(task)).sum()
    assert (cheaper, len(stated.costs)) == ({"each": 10, "nine": 9}[seeds[1]], 10)


def test_on_the_two_other_tasks_a_controller_costs_at_most_one_per_cent_more():
    assert "On the two others a [controller]" in " ".join(README.split())
    known = costs("evolution", "gradient")
    others = set(known) - {task for task, *_ in STATED}
    assert len(others) == 2
    for task in others:
        assert best_controller(task) <= 1.01 * min(known[task]), task


def test_passive_damper_of_the_readme_is_that_of_the_scores():
    (stated,) = re.findall(r"passive damper that no controller can change costs (0\.\d+)", README)
    rows = read_scores()["mm_gym/PreStretchShock-v0"]["rows"]
    (passive,) = (row["cost"] for row in rows if row["role"] == "passive")
    assert stated == f"{passive:.{len(stated) - 2}f}"


def test_readme_is_at_most_120_lines():
    assert len(README.splitlines()) <= 120
