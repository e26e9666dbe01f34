"""Does the README state the costs that the pages have?"""

import re
from pathlib import Path

import pytest

from agents.evaluation.headroom import CLASSICAL, read_scores
from agents.evaluation.sealed import read_sealed
from agents.report.score_pages import of_sealed
from agents.sweeps.results import cells_of, on_tasks, read_results
from mm_gym.tasks import short_name

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
WORDS = " ".join(README.split())
STATED = re.findall(r"(\w+)\s\((0\.\d+),\s(?:controller\s)?(0\.\d+)\)", README)
"""Task, cost of the agents, cost of the best controller."""


def best_controller(task):
    """Return the cost of the best controller that reads the observation."""
    return min(
        row["cost"]
        for row in read_scores()[f"mm_gym/{task}-v0"]["rows"]
        if row["role"] in CLASSICAL and row["reads"] == "observation"
    )


def test_readme_states_four_tasks():
    assert len(STATED) == 4


@pytest.mark.parametrize(("task", "agents", "controllers"), STATED)
def test_costs_of_the_readme_are_those_of_the_pages(task, agents, controllers):
    assert controllers == f"{best_controller(task):.{len(controllers) - 2}f}"
    cells = [cell for cell in cells_of(read_results().trainings) if short_name(cell.task) == task]
    (stated,) = [cell for cell in cells if f"{cell.cost().value:.{len(agents) - 2}f}" == agents]
    _, _, behind = WORDS.partition(f"{task} ({agents}")
    seeds = re.search("with (all ten|eight)", behind)
    cheaper = (stated.costs < best_controller(task)).sum()
    assert (cheaper, len(stated.costs)) == ({"all ten": 10, "eight": 8}[seeds[1]], 10)


def test_costs_on_the_three_other_tasks_are_those_of_the_pages():
    (stated,) = re.findall(r"On the three others it costs at most (0\.\d) % more", WORDS)
    named = {task for task, *_ in STATED}
    others = [one for one in on_tasks(read_results()) if one.name not in named]
    assert len(others) == 3
    most = max(one.best.cost(one.reference).value for one in others)
    assert f"{100.0 * (most - 1.0):.1f}" == stated


def test_tasks_on_sealed_episodes_are_those_of_the_page():
    (stated,) = re.findall(r"On \[sealed episodes\]\S* this holds on (\w+) of them", WORDS)
    standing = of_sealed(read_sealed())
    found = set(standing["surely"]) - set(standing["hardly"])
    assert found <= {task for task, *_ in STATED}
    assert {"three": 3, "four": 4}[stated] == len(found)


def test_passive_damper_of_the_readme_is_that_of_the_scores():
    (stated,) = re.findall(r"passive damper that no actuator can imitate costs (0\.\d+)", WORDS)
    rows = read_scores()["mm_gym/PreStretchShock-v0"]["rows"]
    (passive,) = (row["cost"] for row in rows if row["role"] == "passive")
    assert stated == f"{passive:.{len(stated) - 2}f}"


def test_readme_is_at_most_120_lines():
    assert len(README.splitlines()) <= 120
