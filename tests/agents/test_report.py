"""Does the report rank controllers by what the task asks for, in plain words?"""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH

from agents.control.feedback import Feedback
from agents.controllers.constant import ConstantAction, no_control
from agents.report.charts import draw_costs, draw_response, look
from agents.report.pages import decimals, percent, print_ranking, write_episodes, write_scores
from agents.scoring import Evaluation, evaluate

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

STEPS, EPISODES = 50, 30


def evaluation(name: str, cost: float, rms: float, *, columns: int = 1) -> Evaluation:
    penalties = cost**2 * np.linspace(0.5, 1.5, EPISODES)
    return Evaluation(
        name=name,
        reads="observation",
        penalties=penalties,
        returns=-STEPS * penalties,
        frequency=None,
        time=0.01 * np.arange(1, STEPS + 1),
        displacement=np.full((STEPS, EPISODES), rms),
        applied=np.zeros((STEPS, EPISODES, columns)),
        injected=None,
    )


STILL = evaluation("still", 0.2, 0.1)
"""The reference: moves more than the next, and costs less, as where force has a weight."""
RESTLESS = evaluation("restless", 0.4, 0.05)
BEST = evaluation("best", 0.1, 0.08)


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines, strict=True))


def test_lines_of_the_figure_of_costs_differ_in_style_or_colour() -> None:
    assert len({tuple(look(k).values()) for k in range(28)}) == 28


def test_ranking_is_by_the_cost_of_the_task(capsys) -> None:
    print_ranking([STILL, RESTLESS, BEST], CARRIAGE_FORCE, {})
    lines = capsys.readouterr().out.splitlines()
    rows = [line.replace("\u2502", " ").split() for line in lines]
    found = [row for row in rows if row and row[0] in {"still", "restless", "best"}]
    assert found == [
        ["best", "observation", "0.100", "0.50", "0.080", "-0.50"],
        ["still", "observation", "0.200", "1.00", "0.100", "-2.00"],
        ["restless", "observation", "0.400", "2.00", "0.050", "-8.00"],
    ]
    assert "ratio: cost / cost of still" in lines
    assert "rms x1: over 10 mm" in lines


def test_small_costs_of_an_own_scene_are_told_apart(capsys) -> None:
    few = [evaluation("still", 5e-4, 2e-3), evaluation("best", 3.984e-4, 1e-3)]
    print_ranking(few, CARRIAGE_FORCE, {})
    said = capsys.readouterr().out
    assert " 0.000398 " in said
    assert " 0.000500 " in said
    assert [decimals(costs) for costs in ([0.0, 0.01], [3.0, 9.9e-3], [], [0.0])] == [3, 5, 3, 3]
    assert decimals([0.5, 1e-17]) == 3  # round-off


def test_files_state_costs_first_and_ratios_of_costs(tmp_path) -> None:
    write_scores([STILL, RESTLESS], tmp_path / "scores.csv")
    rows = rows_of(tmp_path / "scores.csv")
    assert list(rows[0])[:3] == ["controller", "reads", "cost [-]"]
    assert float(rows[1]["cost [-]"]) == pytest.approx(0.4, rel=1e-14)
    assert float(rows[1]["ratio to reference [-]"]) == pytest.approx(2.0, rel=1e-14)
    assert float(rows[1]["rms of x1 / scale [-]"]) == pytest.approx(0.05, rel=1e-14)
    write_episodes([STILL, RESTLESS], tmp_path / "episodes.csv")
    rows = rows_of(tmp_path / "episodes.csv")
    assert list(rows[0])[:3] == ["episode", "cost of still [-]", "cost of restless [-]"]
    assert len(rows) == EPISODES
    assert float(rows[-1]["cost of restless [-]"]) == pytest.approx(0.4 * 1.5**0.5, rel=1e-14)


def test_a_comma_in_a_name_does_not_split_it(tmp_path) -> None:
    law = evaluation("clipped LQR about 1.50, weight 0.69", 0.2, 0.1)
    write_scores([law], tmp_path / "scores.csv")
    assert rows_of(tmp_path / "scores.csv")[0]["controller"] == law.name
    write_episodes([law], tmp_path / "episodes.csv")
    assert f"cost of {law.name} [-]" in rows_of(tmp_path / "episodes.csv")[0]


def test_figures_are_drawn_without_a_frequency_and_with_two_actuators(tmp_path) -> None:
    still, best = (evaluation(name, 0.2, 0.1, columns=2) for name in ("still", "best"))
    draw_costs([still, best], HYBRID, tmp_path / "costs.png")
    draw_response(still, best, HYBRID, tmp_path / "response.png")
    for name in ("costs.png", "response.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


HARMONIC = {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}
SWEEP = {"amplitude": 1.0, "start_frequency": 40.0, "end_frequency": 80.0, "duration": 0.5}
DRAWN = {"excitation.0.frequency": (44.0, 71.0)}
SCENES = {
    "sweep": ([SWEEP | {"kind": "sweep"}], {}),
    "sweep of a drawn end": (
        [SWEEP | {"kind": "sweep"}],
        {"excitation.0.end_frequency": (70.0, 80.0)},
    ),
    "noise": ([{"kind": "noise", "rms": 1.0, "high_frequency": 100.0}], {}),
    "earthquake": (
        [
            {
                "kind": "kanai_tajimi",
                "target": "ground",
                "rms": 1.0,
                "ground_frequency": 15.0,
                "ground_damping": 0.6,
            }
        ],
        {"excitation.0.ground_frequency": (10.0, 20.0)},
    ),
    "nothing": ([], {}),
    "known harmonic": ([HARMONIC], {}),
    "noise before a drawn harmonic": (
        [{"kind": "noise", "rms": 1.0, "high_frequency": 100.0}, HARMONIC],
        {"excitation.1.frequency": (44.0, 71.0)},
    ),
    "drawn harmonic": ([HARMONIC], DRAWN),
    "drawn harmonic of the ground": ([HARMONIC | {"target": "ground"}], DRAWN),
}
"""Excitation and randomisation."""

OF = {
    "drawn harmonic": "harmonic force",
    "drawn harmonic of the ground": "harmonic ground motion",
}
"""What the frequency is of, where one is drawn for each episode."""


@pytest.mark.parametrize("name", SCENES)
def test_figures_and_files_name_a_frequency_only_where_one_is_drawn(
    name, tmp_path, monkeypatch
) -> None:
    excitation, randomization = SCENES[name]
    scene = PRE_STRETCH.replace(
        excitation=excitation, randomization=randomization, **{"control.steps": 20}
    )
    drawn: list[Figure] = []
    monkeypatch.setattr("agents.report.charts.save", lambda figure, _: drawn.append(figure))
    results = [
        evaluate(scene, law, episodes=30)
        for law in (Feedback(scene, no_control(scene)), ConstantAction(scene, 0.5))
    ]
    draw_costs(results, scene, tmp_path / "costs.png")
    draw_response(*results, scene, tmp_path / "response.png")
    write_episodes(results, tmp_path / "episodes.csv")
    label, title = drawn[0].axes[0].get_xlabel(), drawn[1].axes[0].get_title()
    rows = rows_of(tmp_path / "episodes.csv")
    first = [float(next(iter(row.values()))) for row in rows]
    median = int(np.argsort(results[0].penalties)[15])
    assert title.startswith(f"Held-out episode {median}, of median cost for no control")
    if name in OF:
        assert label == f"frequency of the {OF[name]} [rad/s]"
        frequency = np.linspace(44.0, 71.0, 30)
        assert title.endswith(f": {OF[name]} at {frequency[median]:.1f} rad/s")
        assert next(iter(rows[0])) == "frequency [rad/s]"
        assert first == pytest.approx(list(frequency), rel=1e-15)
    else:
        assert label == "rank of the episode by the cost of no control"
        assert "rad/s" not in title
        assert next(iter(rows[0])) == "episode"
        assert first == list(range(30))


@pytest.mark.parametrize(
    ("value", "text"), [(-0.004, "0 %"), (0.0, "0 %"), (0.543, "54 %"), (-5.18, "-518 %")]
)
def test_nothing_gained_is_never_a_negative_zero(value, text) -> None:
    assert percent(value) == text


def test_ranking_shows_all_numbers_in_a_narrow_terminal(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    long = evaluation("frequency tracking, linear prediction of the force", 0.3456, 0.3)
    print_ranking([STILL, long], CARRIAGE_FORCE, {})
    printed = capsys.readouterr().out
    assert "0.346" in printed
    assert "observation" in printed
    assert "\u2026" not in printed
