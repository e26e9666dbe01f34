"""Does the page of results say what the trainings did, and are its statistics what they claim?"""

import json
import shutil
import sys

import numpy as np
import pytest
from trainings import TASK, controller, training

from agents.commands import results as command
from agents.control.feedback import Feedback
from agents.controllers.learned import Learned
from agents.controllers.lqr import LQR
from agents.controllers.with_observer import WithObserver
from agents.evaluation.aggregates import proportion
from agents.evaluation.headroom import CLASSICAL, read_scores
from agents.evaluation.rigs import CONTROLLERS, read_robustness, variant_of
from agents.evaluation.sealed import read_sealed
from agents.gradient.settings import GradientSettings
from agents.policies import load_policy
from agents.report import results_page
from agents.report.published import page as published_page
from agents.report.published import read_published, scored_again
from agents.report.results_page import BEST, _look, page
from agents.scoring import evaluate
from agents.sweeps.results import (
    FILE,
    Cell,
    OnTask,
    _digest,
    cells_of,
    known_names,
    merged,
    read_results,
    save,
    with_references,
)
from agents.sweeps.trials import EPISODES, LEARNERS
from agents.training.config import CONFIGS, TrainSettings, read_settings
from mm_gym import SceneError, load_scene
from mm_gym.tasks import ids

COMMITTED = read_results()

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


def cell(rows, **fields):
    return Cell(TASK, "evolution", [training(own, k, **fields) for k, own in enumerate(rows)])


class TestStatistics:
    rng = np.random.default_rng(0)
    episodes = rng.uniform(0.5, 1.5, 100)

    def test_interquartile_mean_is_of_the_middle_half_of_the_seeds(self):
        factors = np.array([0.5, 0.9, 1.0, 1.0, 1.0, 1.1, 1.2, 9.0])
        found = cell(factors[:, None] * self.episodes).cost()
        want = np.sqrt(factors[2:6] * self.episodes.mean()).mean()
        assert found.value == pytest.approx(want, rel=1e-12)
        assert found.low < found.value < found.high

    def test_ratio_is_of_differences_in_the_same_episodes(self):
        own = cell(np.array([0.97, 0.98, 0.99])[:, None] * self.episodes)
        ratio, cost = own.cost(controller(self.episodes)), own.cost()
        assert ratio.value == pytest.approx(cost.value / np.sqrt(self.episodes.mean()), rel=1e-12)
        # What makes an episode expensive for both is in the cost's interval alone.
        assert ratio.high / ratio.value < cost.high / cost.value

    def test_improvement_is_the_fraction_of_the_trainings_that_cost_less(self):
        # Three of four are better, by far more than episodes differ.
        own = cell(np.array([0.1, 0.2, 0.3, 7.0])[:, None] * self.episodes)
        assert own.improvement(controller(self.episodes)) == proportion(3, 4)
        assert own.episodes_won(controller(self.episodes)) == 0.75

    def test_one_seed_that_costs_less_says_little_of_others(self):
        own = cell([0.5 * self.episodes])
        assert own.improvement(controller(self.episodes)).low < 0.1
        assert np.isnan(own.cost(controller(self.episodes)).high)

    @pytest.mark.parametrize(("factors", "want"), [([3, 1, 2], 2), ([4, 1, 3, 2], 3), ([1], 0)])
    def test_middle_training_is_the_median_or_the_better_of_two(self, factors, want):
        assert cell(np.array(factors)[:, None] * self.episodes).median.seed == want

    def test_curve_is_the_least_cost_so_far_up_to_the_shortest_seed(self):
        first = training(1.0, validation=[3.0, 1.0, 2.0], seconds=[1.0, 2.0, 3.0])
        other = training(1.0, 1, validation=[5.0, 4.0], seconds=[3.0, 4.0])
        seconds, costs = Cell(TASK, "ppo", [first, other]).middle_curve()
        np.testing.assert_array_equal(seconds, [2.0, 3.0])
        np.testing.assert_array_equal(costs, [[3.0, 1.0], [4.0, 2.5], [5.0, 4.0]])

    def test_best_algorithm_is_that_of_the_validation_episodes_among_those_of_most_seeds(self):
        steady = cell(np.full((4, 1), 0.9) * self.episodes)
        lucky = cell(np.array([[0.1], [1.0], [1.1], [1.2]]) * self.episodes)
        few = cell([0.01 * self.episodes])
        held_out = cell(np.full((4, 1), 0.5) * self.episodes, validation=[2.0])
        cells = [lucky, few, held_out, steady]
        assert OnTask(TASK, None, cells, {}, np.empty(0)).best is steady

    def test_ties_differ_from_the_best_by_less_than_their_scatter(self):
        spread = np.linspace(0.97, 1.03, 8)[:, None]
        cells = [
            Cell(TASK, name, [training(row, k) for k, row in enumerate(level * spread * own)])
            for name, level, own in (
                ("gradient", 1.0, self.episodes),
                ("recurrent", 1.005, self.episodes),
                ("ppo", 1.04, self.episodes),
                ("sac", 1.04, np.roll(self.episodes, 1)),  # other episodes are expensive
            )
        ]
        few = Cell(TASK, "residual", [training(self.episodes)])  # says nothing of other seeds
        on_task = OnTask(TASK, None, [*cells, few], {}, np.empty(0))
        assert on_task.best.algorithm == "gradient"
        assert on_task.ties == ["recurrent", "sac"]


def test_page_names_tasks_whose_best_agent_has_no_sealed_score(monkeypatch):
    sealed = read_sealed()
    monkeypatch.setattr(results_page, "read_sealed", lambda: sealed)
    told = "On {} the best agent of this page has no sealed score"
    assert told.format("PreStretch") not in page(COMMITTED, "results")
    rows = sealed["tasks"]["mm_gym/PreStretch-v0"]["rows"]
    rows[:] = [row for row in rows if row["role"] != "agent"]
    assert "PreStretch the best agent of this page has no sealed" in page(COMMITTED, "results")


def test_lines_of_all_algorithms_look_different():
    every = [OnTask(TASK, None, [Cell(TASK, name, []) for name in LEARNERS], {}, np.empty(0))]
    looks = [_look(every, name) for name in (*LEARNERS, BEST)]
    assert len({(look["color"], look["linestyle"]) for look in looks}) == len(LEARNERS) + 1


class TestFile:
    def test_page_is_made_of_the_file(self):
        assert FILE.with_suffix(".md").read_text("utf-8") == page(COMMITTED, "results")

    def test_trainings_are_those_of_the_committed_settings(self):
        trials = read_settings(CONFIGS / "results.toml", command.ResultsSettings).trials()
        of_tasks = [one for one in COMMITTED.trainings if one.task in ids()]
        assert len(known_names(COMMITTED, trials)) == len(of_tasks), "they would be trained again"

    def test_trainings_on_tasks_are_also_on_rigs(self):
        own = [(variant_of(one.task), one.algorithm, one.seed) for one in COMMITTED.trainings]
        found = [(one.task, one.algorithm, one.seed) for one in COMMITTED.observed]
        assert found == [key for key in own if key[0]]

    def test_file_is_written_as_it_is_read(self, tmp_path):
        save(COMMITTED, tmp_path / "results.json")
        assert (tmp_path / "results.json").read_bytes() == FILE.read_bytes()

    def test_controller_is_the_best_of_the_scores(self):
        assert {one.task for one in COMMITTED.controllers} == {
            one.task for one in COMMITTED.trainings
        }
        of_variants = read_robustness()
        for one in COMMITTED.controllers:
            if one.task in of_variants:  # scored there on twice as many episodes
                rows = [r for r in of_variants[one.task]["rows"] if r["role"] in CONTROLLERS]
                assert one.controller == min(rows, key=lambda row: row["rigs"])["controller"]
                continue
            rows = [r for r in read_scores()[one.task]["rows"] if r["role"] in CLASSICAL]
            row = min(rows, key=lambda row: row["cost"])
            # Costs of episodes are rounded to five digits.
            assert one.controller == row["controller"]
            assert one.cost == pytest.approx(row["cost"], rel=1e-5)

    def test_controller_is_scored_again_where_its_cost_is_another_now(self, monkeypatch):
        asked = []

        def made(scene, name):
            asked.append(scene.digest)
            return lqr(scene, name)

        monkeypatch.setattr("agents.sweeps.results.reference_controller", made)
        places = TASK, variant_of(TASK)
        digests = [load_scene(task).digest for task in places]
        rows = [
            training(1.0, task=task, scene_digest=digest)
            for task, digest in zip(places, digests, strict=True)
        ]
        known = [one for one in COMMITTED.controllers if one.task in places]
        found = with_references(
            COMMITTED.model_copy(update={"trainings": rows, "controllers": known})
        )
        assert not asked
        of_task, of_variant = found.controllers
        assert of_task.listed is None
        assert of_variant.listed in {row["rigs"] for row in read_robustness()[places[1]]["rows"]}
        stale = [
            of_task.model_copy(update={"episodes": [1.001 * one for one in of_task.episodes]}),
            of_variant.model_copy(update={"listed": 1.001 * of_variant.listed}),
        ]
        again = with_references(found.model_copy(update={"controllers": stale})).controllers
        assert asked == digests
        assert again[1].listed == of_variant.listed

    def test_published_is_the_median_of_the_seeds(self):
        published = {(row.task, row.algorithm): row for row in read_published().rows}
        for own in cells_of(COMMITTED.trainings):
            row = published[own.task, own.algorithm]
            assert (row.seed, row.seeds) == (own.median.seed, len(own.trainings))
            assert row.cost == own.median.cost
            for one in own.trainings:  # whose episodes are rounded to five digits
                assert one.cost == pytest.approx(np.sqrt(one.penalties.mean()), rel=1e-5)

    def test_training_that_is_done_again_replaces_its_row(self):
        first = [training(1.0, seed) for seed in (1, 0)]
        found = merged(
            merged(COMMITTED.model_copy(update={"trainings": []}), first), [training(4.0, 1)]
        )
        assert [(one.seed, one.cost) for one in found.trainings] == [(0, 1.0), (1, 2.0)]

    @pytest.mark.parametrize("fields", [{"settings": "others"}, {"scene_digest": "another"}])
    def test_trainings_of_other_settings_or_another_scene_go(self, fields):
        before = COMMITTED.model_copy(
            update={"trainings": [training(1.0, 0), training(1.0, 0, algorithm="ppo")]}
        )
        found = merged(before, [training(1.0, 1, **fields)]).trainings
        assert [(one.algorithm, one.seed) for one in found] == [("evolution", 1), ("ppo", 0)]

    @pytest.mark.parametrize(
        ("costs", "words"),
        [
            (np.full(3, 0.5), "On 1 of 1 tasks {}:\non CarriageForce by more than the 95 %"),
            (np.array([0.2, 0.8, 1.7]), "On 1 of 1 tasks {}:\non CarriageForce by less than the"),
            ([0.5], "On 1 of 1 tasks {}:\non CarriageForce with one seed, which has no interval."),
            (np.full(3, 0.9995), "On CarriageForce the difference is less than 0.1 %."),
            (np.full(3, 2.0), "On 0 of 1 tasks {}.\nOn CarriageForce it costs no less."),
        ],
    )
    def test_first_paragraph_follows_from_the_costs(self, costs, words):
        (reference,) = (one for one in COMMITTED.controllers if one.task == TASK)
        rows = [training(f**2 * reference.penalties, k) for k, f in enumerate(costs)]
        update = {"trainings": rows, "controllers": [reference]}
        text = page(COMMITTED.model_copy(update=update), "results")
        told = "the best agent costs less than the best controller, predictive control\nincluded"
        assert words.format(told) in text.split("-->")[1].split("\n\n    python")[0]

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                {"episodes": [0.5]},
                r"trainings\.0\.episodes: got \[0\.5\]; List should have at least",
            ),
            (
                {"algorithm": "magic"},
                r"trainings\.0\.algorithm: got 'magic'; Input should be 'evol",
            ),
            ({"seconds": []}, r"trainings\.0: got .*seconds: got 0; allowed: 1"),
            ({"mood": 1}, r"trainings\.0\.mood: got 1; Extra inputs"),
        ],
    )
    def test_damaged_file_is_named(self, tmp_path, change, words):
        data = COMMITTED.model_dump() | {"trainings": [training(1.0).model_dump() | change]}
        (tmp_path / "results.json").write_text(json.dumps(data))
        with pytest.raises(SceneError, match=rf"results\.json: not a file of results: {words}"):
            read_results(tmp_path / "results.json")

    def test_table_of_older_files_is_left_out_and_any_other_refused(self, tmp_path):
        data = COMMITTED.model_dump() | {"earlier": [{"cost": 1.0}]}
        (tmp_path / "results.json").write_text(json.dumps(data))
        assert read_results(tmp_path / "results.json") == COMMITTED
        (tmp_path / "results.json").write_text(json.dumps(data | {"observd": []}))
        with pytest.raises(
            SceneError, match=r"not a file of results: observd: got .*; Extra inputs"
        ):
            read_results(tmp_path / "results.json")

    def test_foreign_file_is_named(self, tmp_path):
        (tmp_path / "results.json").write_text('{"rows": []}')
        with pytest.raises(SceneError, match="not a file of results: controllers: Field required"):
            read_results(tmp_path / "results.json")


def test_setting_that_is_off_or_without_effect_makes_no_other_training():
    trial = GradientSettings.of({"task": TASK, "seed": 3})
    assert _digest(trial) == _digest(trial.model_copy(update={"seed": 4, "name": "other"}))
    assert _digest(trial) != _digest(trial.model_copy(update={"inwards": True}))
    assert _digest(trial) != _digest(trial.model_copy(update={"extra": 1}))
    recurrent = trial.model_copy(update={"cell": 8})
    assert _digest(recurrent) == _digest(recurrent.model_copy(update={"feedback": 0.5}))
    train = TrainSettings.of({"task": TASK, "algorithm": "sac"})
    assert _digest(train) != _digest(TrainSettings.of({"task": TASK}))


def lqr(scene, name):
    """Return what stands for the best controller: to design that takes longer."""
    found = Feedback(scene, LQR(scene))
    found.name = name
    return found


class TestCommand:
    @pytest.fixture
    def call(self, tmp_path, monkeypatch):
        (tmp_path / "small.toml").write_text(SWEEP)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("agents.sweeps.results.reference_controller", lqr)

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
        span = f"{min(costs):.4f} to {max(costs):.4f}"
        assert ["CarriageForce", "evolution", "2", span] in [cells[1:5] for cells in rows]
        figures = [line for line in text.splitlines() if line.startswith("![")]
        names = [line.partition("(")[2].rstrip(")") for line in figures]
        assert names == ["page/curves.png", "page/profile.png"]
        assert all((tmp_path / name).exists() for name in names)

        record = read_published(tmp_path / "policies")
        (row,) = record.rows
        assert (row.seeds, row.cost) == (2, min(costs))  # of two, the better is the median
        assert (row.least, row.most) == (min(costs), max(costs))
        ((again, cost),) = scored_again(record, tmp_path / "policies")
        assert (again.file, cost) == ("CarriageForce-evolution.safetensors", row.cost)
        assert (tmp_path / "published.md").read_text() == published_page(record)

        variant = variant_of(TASK)
        rigs, observed = load_scene(variant), read_results(tmp_path / "page.json").observed
        assert [(one.task, one.seed) for one in observed] == [(variant, 0), (variant, 1)]
        for one, file in zip(observed, files, strict=True):
            agent = WithObserver(rigs, Learned(load_policy(file.with_name("policy.safetensors"))))
            assert one.cost == evaluate(rigs, agent, episodes=EPISODES).cost

        def refuse(work, *_):
            assert not work, "trained again"

        with monkeypatch.context() as patched:
            patched.setattr("agents.commands.sweep.work_here", refuse)
            patched.setattr("agents.sweeps.results._observed", None)  # nor scored again
            assert call("--no-train") is None
            assert (tmp_path / "page.md").read_text() == text
            (tmp_path / "runs").rename(tmp_path / "elsewhere")
            assert call() is None  # the data have both
        assert (tmp_path / "page.md").read_text() == text
        assert read_published(tmp_path / "policies") == record
        data = read_results(tmp_path / "page.json")
        save(data.model_copy(update={"trainings": data.trainings[:1]}), tmp_path / "page.json")
        assert call("--processes", "1") is None
        (again,) = (tmp_path / "runs" / "small").glob("*/result.json")
        assert (
            again.read_bytes()
            == (tmp_path / "elsewhere" / again.relative_to(tmp_path / "runs")).read_bytes()
        )
        assert again.parent.name.endswith("-1")  # the other is in the data
        shutil.rmtree(tmp_path / "runs")
        (tmp_path / "elsewhere").rename(tmp_path / "runs")
        monkeypatch.setattr("agents.report.published.LARGEST", 10)
        assert call("--no-train") is None
        assert "left out: too large" in (tmp_path / "published.md").read_text()
        assert not list((tmp_path / "policies").glob("*.safetensors"))

    def test_nothing_trained_is_named(self, call, tmp_path):
        assert "no finished training here" in call("--no-train")
        assert not (tmp_path / "page.md").exists()

    def test_several_variants_are_refused(self, call):
        """Their rows would take each other's place."""
        told = call("--no-train", "--variants", '{"one": {}, "two": {}}')
        assert told.startswith("error: variants: got one, two; allowed: one")

    def test_unknown_setting_is_named(self, call):
        with pytest.raises(SystemExit):
            call("--seds", "3")
