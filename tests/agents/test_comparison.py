"""Are several controllers compared fairly, in full, and told of in plain words?"""

from __future__ import annotations

import csv
import json
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tyro
from tasks import CARRIAGE_FORCE, PRE_STRETCH, TASKS

from agents import evaluate as command
from agents.comparison.conclusions import CHOSEN, best_known, conclude, scores_of
from agents.comparison.contestants import Contestant, Field, read_field
from agents.comparison.entries import Episodes
from agents.comparison.measure import TaskResult, measure
from agents.controllers.constant import no_control
from agents.controllers.feedback import Feedback
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.aggregates import Sample
from agents.evaluation.episodes import HELD_OUT_SEED, evaluate
from agents.policies import Policy, PolicyError
from agents.report.comparison import as_data, page, write_comparison
from agents.report.comparison_figures import draw_aggregates, draw_intervals
from agents.training.runs import RunError
from mm_gym import SceneError

if TYPE_CHECKING:
    from pathlib import Path

FORCE, DUFFING = "mm_gym/CarriageForce-v0", "mm_gym/CarriageForceDuffing-v0"
EPISODES = Episodes(3, 8)


def policy(gain: float) -> Policy:
    """A policy that pushes against v1."""
    weight = np.array([[0.0, 0.0, -gain, 0.0]], np.float32)
    ends = np.array([1.0], np.float32)
    return Policy((weight,), (np.zeros(1, np.float32),), "tanh", -ends, ends)


def run(folder: Path, task: str = FORCE, gain: float = 1.0, **changes: object) -> Path:
    """A finished run of such a policy."""
    folder.mkdir(parents=True)
    record = {"settings": {"task": task}, "scene_digest": TASKS[task].digest} | changes
    (folder / "run.json").write_text(json.dumps(record))
    policy(gain).save(folder / "policy.npz")
    return folder


def result(task: str, costs: dict[str, float], *, chosen: int | None = None) -> TaskResult:
    """Made-up measurements: a cost of each controller, and episodes about it."""
    generator = np.random.default_rng(5)
    noise = generator.uniform(0.5, 1.5, size=(len(costs), EPISODES.seeds, EPISODES.each))
    means = np.array(list(costs.values()))[:, None, None] ** 2
    penalties = means * noise / noise.mean(axis=(1, 2), keepdims=True)
    count = len(costs)
    sample = Sample(penalties, np.zeros(count, np.bool_))
    return TaskResult(task, tuple(costs), ("observation",) * count, sample, 0, chosen)


COSTS = {"best constant": 0.2, "good": 0.1, "bad": 0.3}
RESULTS = [result(FORCE, COSTS, chosen=1), result(DUFFING, COSTS | {"own": 0.15}, chosen=3)]
CONCLUDED = conclude(RESULTS, TASKS, EPISODES)


def test_controllers_are_ranked_by_the_cost_of_the_task() -> None:
    assert [row.label for row in CONCLUDED.tables[FORCE]] == ["good", "best constant", "bad"]
    assert [row.label for row in CONCLUDED.tables[DUFFING]][:2] == ["good", "own"]


def test_score_is_zero_for_the_best_constant_and_one_for_the_best_known() -> None:
    ratio = best_known(FORCE, CARRIAGE_FORCE)
    assert ratio is not None
    assert 0.3 < ratio < 0.6
    constant = np.array([0.04, 0.09])
    np.testing.assert_array_equal(scores_of(constant, constant, ratio), 0.0)
    best = scores_of(ratio**2 * constant, constant, ratio)
    np.testing.assert_allclose(best, 1.0, rtol=1e-14)
    good = next(row for row in CONCLUDED.tables[FORCE] if row.label == "good")
    assert good.score is not None
    assert good.score.value == pytest.approx((0.2 - 0.1) / (0.2 - ratio * 0.2), rel=1e-12)


def test_a_scene_without_committed_scores_has_none(tmp_path) -> None:
    assert best_known(FORCE, CARRIAGE_FORCE.replace(**{"control.steps": 7})) is None
    assert best_known("mine.toml", CARRIAGE_FORCE) is None
    changed = {FORCE: CARRIAGE_FORCE.replace(**{"control.steps": 7})}
    found = conclude(RESULTS[:1], changed, EPISODES)
    assert all(row.score is None for row in found.tables[FORCE])
    write_comparison(found, tmp_path)
    with (tmp_path / "comparison.csv").open(newline="") as lines:
        assert {row["score [-]"] for row in csv.DictReader(lines)} == {"nan"}


def test_only_controllers_of_all_tasks_are_aggregated() -> None:
    labels = [one.label for one in CONCLUDED.overall]
    assert set(labels) == {"good", "bad", "best constant", CHOSEN}
    assert labels[0] == "good"
    first = CONCLUDED.overall[0]
    assert first.improvement["bad"] == 1.0
    assert first.mean.low < first.mean.value < first.mean.high
    assert np.all(np.diff(first.profile[:, 0]) <= 0.0)


def test_worst_episode_and_tenth_are_of_the_costs() -> None:
    row = CONCLUDED.tables[FORCE][-1]
    penalties = RESULTS[0].sample.penalties[2].ravel()
    assert row.worst == pytest.approx(penalties.max() ** 0.5, rel=1e-14)
    # Two of 24 episodes are nearest to a tenth.
    assert row.tail == pytest.approx(np.sort(penalties)[-2:].mean() ** 0.5, rel=1e-14)


def test_files_hold_every_number_and_come_out_again_byte_for_byte(tmp_path) -> None:
    for name in ("first", "second"):
        again = conclude(RESULTS, TASKS, EPISODES)
        write_comparison(again, tmp_path / name)
        draw_intervals(again, tmp_path / name / "costs.png")
        draw_aggregates(again, tmp_path / name / "scores.png")
    files = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert files == [
        *("comparison.csv", "comparison.json", "comparison.md"),
        *("costs.png", "episodes.csv", "scores.png"),
    ]
    for name in files:
        first, second = (tmp_path / folder / name for folder in ("first", "second"))
        assert first.read_bytes() == second.read_bytes()
    with (tmp_path / "first" / "episodes.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == (3 + 4) * EPISODES.seeds * EPISODES.each
    written = float(rows[-1]["mean of -reward per step [-]"])
    assert written == RESULTS[1].sample.penalties[-1, -1, -1]
    assert json.loads((tmp_path / "first" / "comparison.json").read_text()) == json.loads(
        json.dumps(as_data(CONCLUDED))
    )


def test_page_has_a_table_for_each_task_and_one_for_all() -> None:
    text = page(CONCLUDED)
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        f"## {FORCE}",
        f"## {DUFFING}",
        "## All tasks",
    ]
    assert "| good | observation |" in text
    assert "of seeds 1000000 to 1000023" in text


def test_all_controllers_have_the_same_episodes_whatever_the_processes() -> None:
    compared = read_field(["lqr", "no-control", "velocity-feedback"], [FORCE])
    (found,) = measure(compared, EPISODES)
    assert found.labels == ("best constant", "lqr", "no-control", "velocity-feedback")
    scene = TASKS[FORCE]
    still = evaluate(scene, Feedback(scene, no_control(scene)), episodes=24)
    np.testing.assert_array_equal(found.sample.penalties[2].ravel(), still.penalties)


def test_each_seed_of_a_training_has_episodes_of_its_own(tmp_path) -> None:
    for seed, gain in enumerate((0.5, 1.0, 2.0)):
        run(tmp_path / f"ppo-{seed}", gain=gain)
    compared = read_field([str(tmp_path / "ppo-*")])
    assert list(compared.scenes) == [FORCE]
    assert compared.trainings == 3
    (found,) = measure(compared, Episodes.of_field(compared, None, 8))
    assert found.labels[1] == "ppo"
    assert found.sample.trained.tolist() == [False, True]
    scene = TASKS[FORCE]
    for seed, gain in enumerate((0.5, 1.0, 2.0)):
        law = Feedback(scene, VelocityFeedback(scene, gain * 4.0 / 0.5))
        own = evaluate(scene, law, seed=HELD_OUT_SEED + 8 * seed, episodes=8)
        # The policy sees v1 in single precision.
        np.testing.assert_allclose(found.sample.penalties[1, seed], own.penalties, rtol=1e-5)


def test_frequencies_are_spread_over_the_band_for_each_seed() -> None:
    scene = PRE_STRETCH.replace(**{"control.steps": 3})
    law = Feedback(scene, no_control(scene))
    found = evaluate(scene, law, episodes=12, blocks=3)
    assert found.frequency is not None
    np.testing.assert_array_equal(found.frequency[:4], np.linspace(44.0, 71.0, 4))
    np.testing.assert_array_equal(found.frequency[4:8], found.frequency[:4])
    second = evaluate(scene, law, seed=HELD_OUT_SEED + 4, episodes=4)
    np.testing.assert_array_equal(found.penalties[4:8], second.penalties)


def refused(error: type[Exception], texts: list[str], tasks: tuple[str, ...] = ()) -> str:
    with pytest.raises(error) as caught:
        read_field(texts, tasks)
    return str(caught.value)


def test_unknown_names_and_files_are_refused_with_the_nearest(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "got 'lqx'; did you mean 'lqr'?; allowed for these tasks: baselines" in refused(
        SceneError, ["lqx"], (FORCE,)
    )
    assert "phase-law" not in refused(SceneError, ["lqx"], (FORCE,))
    assert "is not a task of mm_gym; did you mean" in refused(SceneError, ["lqr"], (FORCE + "0",))
    assert "task or scene file: got 'Hybrit'; did you mean 'Hybrid'" in refused(
        SceneError, ["lqr"], ("Hybrit",)
    )
    run(tmp_path / "runs" / "first")
    assert "runs/fist: no finished run here; did you mean 'first'?" in refused(
        RunError, ["runs/fist"]
    )
    assert "runs/none*: no finished run here" in refused(RunError, ["runs/none*"])
    assert "no such file" in refused(PolicyError, ["missing.npz"], (FORCE,))
    assert "lqr: given twice" in refused(SceneError, ["lqr", "lqr"], (FORCE,))


def test_tasks_have_short_names_beside_paths_of_scenes(tmp_path) -> None:
    scene = tmp_path / "own.toml"
    scene.write_text("[control]\nsteps = 7\n")
    assert list(read_field(["lqr"], ["CarriageForce"]).scenes) == [FORCE]
    assert read_field(["baselines"], ["CarriageForce", str(scene)]).scenes[str(scene)]


def test_runs_that_cannot_stand_in_one_table_are_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = str(run(tmp_path / "a-1"))
    run(tmp_path / "a-2")
    run(tmp_path / "b-1")
    run(tmp_path / "b-2")
    run(tmp_path / "b-3")
    other = str(run(tmp_path / "c", DUFFING))
    changed = str(run(tmp_path / "d", scene_digest="0"))
    unfinished = run(tmp_path / "e")
    (unfinished / "policy.npz").unlink()
    assert f"{first}: got runs of {FORCE}; allowed: of each of {FORCE}, {DUFFING}" in refused(
        RunError, [first, other]
    )
    assert f"allowed: of each of {FORCE}" in refused(RunError, [other], (FORCE,))
    assert "trained on another scene than that of" in refused(RunError, [changed])
    assert "training is not over" in refused(RunError, [str(unfinished)])
    assert "different numbers of runs (a has 2, b has 3); allowed: the same" in refused(
        RunError, ["./a-*", "./b-*"]
    )


def test_wrong_counts_are_refused() -> None:
    lqr = Contestant("lqr", {FORCE: ("lqr",)})
    two = Contestant("ppo", {FORCE: ("a", "b")})
    one, several = (Field(TASKS, (who,), baselines=False) for who in (lqr, two))
    for field, seeds, each, first, text in (
        (one, 0, 8, HELD_OUT_SEED, "--seeds: got 0; allowed: at least 1"),
        (several, 5, 8, HELD_OUT_SEED, "--seeds: got 5; allowed: 2, as many as there are runs"),
        (one, 5, 1, HELD_OUT_SEED, "--episodes: got 1; allowed: at least 2"),
        (one, 5, 8, 7, "--first-seed: got 7 for 5 x 8 episodes; allowed: 1000000 to 1999960"),
        (one, 5, 8, 1_999_961, "--first-seed: got 1999961"),
    ):
        with pytest.raises(SceneError) as caught:
            Episodes.of_field(field, seeds, each, first=first)
        assert text in str(caught.value)
    assert Episodes.of_field(several, None, None) == Episodes(2, 64)
    assert Episodes.of_field(one, None, None) == Episodes(5, 64)


def test_command_compares_and_refuses(tmp_path, monkeypatch, capsys) -> None:
    out = str(tmp_path / "out")
    words = ["evaluate", "lqr", "no-control", "--tasks", FORCE, "--episodes", "4", "--seeds", "2"]
    monkeypatch.setattr(sys, "argv", [*words, "--out", out])
    assert command.main() is None
    printed = capsys.readouterr().out
    assert "no-control" in printed
    assert f"written: {out}/" in printed
    monkeypatch.setattr(sys, "argv", [*words, "--policy", "x.npz"])
    assert command.main() == (
        "error: --policy: has no effect on several; name it among them: FILE.npz or FILE.py:NAME"
    )
    monkeypatch.setattr(sys, "argv", [*words, "--processes", "0"])
    assert command.main() == "error: --processes: got 0; allowed: at least 1"
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(sys, "argv", [*words, "--out", str(tmp_path / "file")])
    assert "cannot be written: Not a directory" in str(command.main())
    monkeypatch.setattr(sys, "argv", ["evaluate", "lqr", "lgr", "--tasks", FORCE])
    assert "did you mean 'lqr'" in str(command.main())


@pytest.mark.parametrize(
    ("words", "compares"),
    [
        (["runs/first"], False),
        (["runs/first", "lqr"], True),
        (["runs/first", "--robustness"], True),
        (["runs/first", "--seeds", "0"], True),
        (["runs/ppo-*"], True),
        (["lqr"], True),
        (["baselines"], True),
        (["baselines", "--policy", "x.npz"], False),
        (["mm_gym/CarriageForce-v0", "--controller", "mine.py:Law"], False),
    ],
)
def test_one_run_is_reported_and_all_else_compared(words, compares) -> None:
    assert tyro.cli(command.Arguments, args=words).compares == compares


def test_nothing_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate"])
    assert command.main() == (
        "error: got nothing to evaluate; allowed: the folder of a run, or baselines"
    )
