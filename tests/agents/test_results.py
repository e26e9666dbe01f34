"""Does the page of results say what the trainings did, and are its statistics what they claim?"""

import json
import sys

import numpy as np
import pytest

from agents.commands import results as command
from agents.control.feedback import Feedback
from agents.controllers.lqr import LQR
from agents.evaluation.aggregates import proportion
from agents.evolution.search import EvolveSettings
from agents.report.published import page as published_page
from agents.report.published import read_published, scored_again
from agents.scoring import Evaluation
from agents.sweeps.on_task import (
    Curve,
    Trainings,
    best_of,
    episodes_won,
    improvement,
    middle_cost,
    slopes,
)
from agents.training.network import Network
from agents.training.starts import start_of
from mm_gym import load_scene

SWEEP = """
name = "small"
tasks = ["CarriageForce"]
algorithms = ["evolution"]
seeds = 2

[settings]
"evolution.generations" = 2
"evolution.candidates" = 4
"evolution.episodes" = 2
"evolution.evaluations" = 2
"""


def evaluation(penalties):
    penalties, none = np.asarray(penalties, float), np.empty(0)
    return Evaluation("law", "observation", penalties, none, None, none, none, none, None)


def trainings(penalties):
    curve = Curve(np.array([1.0]), np.array([1.0]), np.array([1.0]))
    return Trainings("evolution", [evaluation(own) for own in penalties], [curve] * len(penalties))


class TestStatistics:
    rng = np.random.default_rng(0)
    episodes = rng.uniform(0.5, 1.5, 100)

    def test_interquartile_mean_is_of_the_middle_half_of_the_seeds(self):
        factors = np.array([0.5, 0.9, 1.0, 1.0, 1.0, 1.1, 1.2, 9.0])
        found = middle_cost(trainings(factors[:, None] * self.episodes))
        want = np.sqrt(factors[2:6] * self.episodes.mean()).mean()
        assert found.value == pytest.approx(want, rel=1e-12)
        assert found.low < found.value < found.high

    def test_improvement_is_the_fraction_of_the_trainings_that_cost_less(self):
        # Three of four are better, by far more than episodes differ.
        own = trainings(np.array([0.1, 0.2, 0.3, 7.0])[:, None] * self.episodes)
        found = improvement(own, evaluation(self.episodes))
        assert found == proportion(3, 4)
        assert episodes_won(own, evaluation(self.episodes)) == 0.75

    def test_one_seed_that_costs_less_says_little_of_others(self):
        assert improvement(trainings([0.5 * self.episodes]), evaluation(self.episodes)).low < 0.1

    @pytest.mark.parametrize(("factors", "want"), [([3, 1, 2], 2), ([4, 1, 3, 2], 3), ([1], 0)])
    def test_middle_training_is_the_median_or_the_better_of_two(self, factors, want):
        assert trainings(np.array(factors)[:, None] * self.episodes).median == want

    def test_slopes_of_a_regulator_are_its_gain(self):
        scene, rng = load_scene("mm_gym/CarriageForce-v0"), np.random.default_rng(0)
        start = start_of(scene, EvolveSettings(), rng)
        network = Network(start, 3, odd=True)
        found = slopes(network.policy(network.first(rng)), 0.01)
        # Weights are of single precision.
        np.testing.assert_allclose(found, start.direct[0, 1:], rtol=1e-5, atol=1e-6)

    def test_curve_is_the_least_cost_so_far_up_to_the_shortest_seed(self):
        steps = np.arange(3.0)
        curves = [
            Curve(steps, np.array([3.0, 1.0, 2.0]), 1.0 + steps),
            Curve(steps[:2], np.array([5.0, 4.0]), 3.0 + steps[:2]),
        ]
        seconds, costs = Trainings("ppo", [], curves).middle_curve()
        np.testing.assert_array_equal(seconds, [2.0, 3.0])
        np.testing.assert_array_equal(costs, [[3.0, 1.0], [4.0, 2.5], [5.0, 4.0]])

    def test_best_algorithm_is_that_of_the_least_interquartile_mean(self):
        steady = trainings(np.full((4, 1), 0.9) * self.episodes)
        lucky = trainings(np.array([[0.1], [1.0], [1.1], [1.2]]) * self.episodes)
        assert best_of([lucky, steady]) is steady


class TestCommand:
    @pytest.fixture
    def call(self, tmp_path, monkeypatch):
        (tmp_path / "small.toml").write_text(SWEEP)
        monkeypatch.chdir(tmp_path)
        law = lambda scene: [Feedback(scene, LQR(scene))]  # noqa: E731 - tuning takes longer
        monkeypatch.setattr("agents.sweeps.on_task.classical_laws", law)

        def call(*flags):
            monkeypatch.setattr(sys, "argv", ["results", "small.toml", "--out", "page.md", *flags])
            return command.main()

        return call

    def test_page_has_the_costs_of_the_trainings(self, call, tmp_path, monkeypatch):
        assert call("--processes", "1") is None
        text = (tmp_path / "page.md").read_text()
        files = sorted((tmp_path / "runs" / "small").glob("*/result.json"))
        costs = [json.loads(path.read_text())["cost"] for path in files]
        assert len(costs) == 2
        rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
        cost = next(cells for cells in rows if cells[1:2] == ["evolution"] and "[" in cells[2])
        assert cost[2].startswith(f"{np.mean(costs):.4f} [")
        details = next(cells for cells in rows if cells[1:2] == ["CarriageForce"])
        assert details[3:6] == ["evolution", "2", f"{min(costs):.4f} to {max(costs):.4f}"]
        figures = [line for line in text.splitlines() if line.startswith("![")]
        names = [line.partition("(")[2].rstrip(")") for line in figures]
        assert names == ["page/curves.png", "page/profile.png", "page/robustness.png"]
        assert all((tmp_path / name).exists() for name in names)

        record = read_published(tmp_path / "policies")
        (row,) = record.rows
        assert row.with_results
        assert (row.seeds, row.cost) == (2, min(costs))  # of two, the better is the median
        assert (row.least, row.most) == (min(costs), max(costs))
        ((again, cost),) = scored_again(record, tmp_path / "policies")
        assert (again.file, cost) == ("CarriageForce-evolution.safetensors", row.cost)
        assert (tmp_path / "published.md").read_text() == published_page(record)

        def refuse(*_):
            pytest.fail("trained again")

        monkeypatch.setattr("agents.commands.sweep.work_here", refuse)
        assert call("--no-train") is None
        assert (tmp_path / "page.md").read_text() == text
        monkeypatch.setattr("agents.report.published.LARGEST", 10)
        assert call("--no-train", "--no-page") is None
        told, _, others = (tmp_path / "page.md").read_text().partition("\n## Other trainings\n")
        assert told == text
        assert f"| CarriageForce | evolution | 2 | {min(costs):.4f} | {details[5]} |" in others
        assert "left out: too large" in (tmp_path / "published.md").read_text()
        assert not list((tmp_path / "policies").glob("*.safetensors"))

    def test_nothing_trained_is_named(self, call, tmp_path):
        assert "no finished training here" in call("--no-train")
        assert not (tmp_path / "page.md").exists()

    def test_unknown_setting_is_named(self, call):
        with pytest.raises(SystemExit):
            call("--seds", "3")
