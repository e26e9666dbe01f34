"""Does the report rank controllers by what the task asks for, in plain words?"""

import csv
from pathlib import Path

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID

from agents.evaluation.episodes import Evaluation
from agents.report.figures import draw_costs, draw_response
from agents.report.tables import percent, print_ranking, write_episodes, write_scores

STEPS, EPISODES = 50, 30


def evaluation(name: str, cost: float, rms: float, *, columns: int = 1) -> Evaluation:
    penalties = cost**2 * np.linspace(0.5, 1.5, EPISODES)
    return Evaluation(
        name=name,
        penalties=penalties,
        returns=-STEPS * penalties,
        frequency=None,
        time=0.01 * np.arange(1, STEPS + 1),
        displacement=np.full((STEPS, EPISODES), rms),
        applied=np.zeros((STEPS, EPISODES, columns)),
    )


STILL = evaluation("still", 0.2, 0.1)
"""The reference: moves more than the next, and costs less, as where force has a price."""
RESTLESS = evaluation("restless", 0.4, 0.05)
BEST = evaluation("best", 0.1, 0.08)


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines, strict=True))


def test_ranking_is_by_the_cost_of_the_task(capsys) -> None:
    print_ranking([STILL, RESTLESS, BEST], CARRIAGE_FORCE)
    lines = capsys.readouterr().out.splitlines()
    rows = [line.replace("\u2502", " ").split() for line in lines]
    found = [row for row in rows if row and row[0] in {"still", "restless", "best"}]
    assert found == [
        ["best", "0.100", "0.50", "0.080", "-0.50"],
        ["still", "0.200", "1.00", "0.100", "-2.00"],
        ["restless", "0.400", "2.00", "0.050", "-8.00"],
    ]
    assert "ratio: cost / cost of still" in lines
    assert "rms x1: over 10 mm" in lines


def test_files_state_costs_first_and_ratios_of_costs(tmp_path) -> None:
    write_scores([STILL, RESTLESS], tmp_path / "scores.csv")
    rows = rows_of(tmp_path / "scores.csv")
    assert list(rows[0])[:2] == ["controller", "cost [-]"]
    assert float(rows[1]["cost [-]"]) == pytest.approx(0.4, rel=1e-14)
    assert float(rows[1]["ratio to reference [-]"]) == pytest.approx(2.0, rel=1e-14)
    assert float(rows[1]["rms of x1 / scale [-]"]) == pytest.approx(0.05, rel=1e-14)
    write_episodes([STILL, RESTLESS], tmp_path / "episodes.csv")
    rows = rows_of(tmp_path / "episodes.csv")
    assert list(rows[0])[:3] == ["episode", "cost of still [-]", "cost of restless [-]"]
    assert len(rows) == EPISODES
    assert float(rows[-1]["cost of restless [-]"]) == pytest.approx(0.4 * 1.5**0.5, rel=1e-14)


def test_a_comma_in_a_name_does_not_split_it(tmp_path) -> None:
    law = evaluation("clipped LQR about 1.50, price 0.69", 0.2, 0.1)
    write_scores([law], tmp_path / "scores.csv")
    assert rows_of(tmp_path / "scores.csv")[0]["controller"] == law.name
    write_episodes([law], tmp_path / "episodes.csv")
    assert f"cost of {law.name} [-]" in rows_of(tmp_path / "episodes.csv")[0]


def test_figures_are_drawn_without_a_frequency_and_with_two_actuators(tmp_path) -> None:
    still, best = (evaluation(name, 0.2, 0.1, columns=2) for name in ("still", "best"))
    draw_costs([still, best], tmp_path / "costs.png")
    draw_response(still, best, HYBRID, tmp_path / "response.png")
    for name in ("costs.png", "response.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("value", "text"), [(-0.004, "0 %"), (0.0, "0 %"), (0.543, "54 %"), (-5.18, "-518 %")]
)
def test_nothing_gained_is_never_a_negative_zero(value, text) -> None:
    assert percent(value) == text
