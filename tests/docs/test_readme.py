"""Does the README state the costs that the pages have?"""

import re
from pathlib import Path

import pytest

from agents.evaluation.headroom import CLASSICAL
from agents.evaluation.scores import read_scores

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
STATED = re.findall(r"(\w+)\s\((0\.\d+),\s(?:they\s)?(0\.\d+)\)", README)
"""Task, cost of the agents, cost of the best controller."""


def gradient_costs():
    """Return the costs of the row `gradient` of docs/results.md by task."""
    lines = (ROOT / "docs/results.md").read_text("utf-8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    heads = next(row for row in rows if "PreStretchNoise" in row)
    (costs,) = (row for row in rows if row[0] == "gradient" and len(row) == len(heads))
    return dict(zip(heads, costs, strict=True))


def test_readme_states_three_tasks():
    assert len(STATED) == 3


@pytest.mark.parametrize(("task", "agents", "controllers"), STATED)
def test_costs_of_the_readme_are_those_of_the_pages(task, agents, controllers):
    best = min(
        row["cost"]
        for row in read_scores()[f"mm_gym/{task}-v0"]["rows"]
        if row["role"] in CLASSICAL and row["reads"] == "observation"
    )
    digits = len(controllers) - 2
    assert controllers == f"{best:.{digits}f}"
    assert agents == f"{float(gradient_costs()[task]):.{len(agents) - 2}f}"
    assert float(agents) < float(controllers)


def test_passive_damper_of_the_readme_is_that_of_the_scores():
    (stated,) = re.findall(r"a passive damper costs (0\.\d+)", README)
    rows = read_scores()["mm_gym/PreStretchShock-v0"]["rows"]
    (passive,) = (row["cost"] for row in rows if row["role"] == "passive")
    assert stated == f"{passive:.{len(stated) - 2}f}"


def test_readme_is_at_most_120_lines():
    assert len(README.splitlines()) <= 120
