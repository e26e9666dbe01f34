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

from agents.commands import evaluate as command
from agents.control.feedback import Feedback
from agents.controllers.constant import no_control
from agents.controllers.lqr import LQR
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.aggregates import Sample
from agents.evaluation.conclusions import CHOSEN, best_known, conclude, scores_of
from agents.evaluation.contestants import Contestant, Episodes, Field, law_of, read_field
from agents.evaluation.measurement import TaskResult, measure
from agents.policies import Policy, PolicyError, network
from agents.report.comparison import (
    _delete_earlier,
    _file_name,
    as_data,
    draw_aggregates,
    draw_intervals,
    page,
    print_comparison,
    write_comparison,
)
from agents.scoring import HELD_OUT_SEED, evaluate
from agents.training.runs import RunError
from mm_gym import SceneError, load_scene, rewarded

if TYPE_CHECKING:
    from pathlib import Path

FORCE, DUFFING = "mm_gym/CarriageForce-v0", "mm_gym/CarriageForceDuffing-v0"
EPISODES = Episodes(3, 8)


def policy(gain: float) -> Policy:
    """A policy that pushes against v1."""
    weight = np.array([[0.0, 0.0, -gain, 0.0]], np.float32)
    ends = np.array([1.0], np.float32)
    return network((weight,), (np.zeros(1, np.float32),), "tanh", -ends, ends)


def run(folder: Path, task: str = FORCE, gain: float = 1.0, **changes: object) -> Path:
    """A finished run of such a policy."""
    folder.mkdir(parents=True)
    scene = TASKS[task]
    content = json.loads(scene.model_dump_json())
    record = {"settings": {"task": task}, "scene": content, "scene_digest": scene.digest} | changes
    (folder / "run.json").write_text(json.dumps(record))
    policy(gain).save(folder / "policy.safetensors")
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
    assert [row.controller for row in CONCLUDED.tables[FORCE]] == ["good", "best constant", "bad"]
    assert [row.controller for row in CONCLUDED.tables[DUFFING]][:2] == ["good", "own"]


def test_score_is_zero_for_the_best_constant_and_one_for_the_best_known() -> None:
    ratio = best_known(FORCE, CARRIAGE_FORCE)
    assert ratio is not None
    assert 0.3 < ratio < 0.6
    constant = np.array([0.04, 0.09])
    np.testing.assert_array_equal(scores_of(constant, constant, ratio), 0.0)
    best = scores_of(ratio**2 * constant, constant, ratio)
    np.testing.assert_allclose(best, 1.0, rtol=1e-14)
    good = next(row for row in CONCLUDED.tables[FORCE] if row.controller == "good")
    assert good.score is not None
    assert good.score.value == pytest.approx((0.2 - 0.1) / (0.2 - ratio * 0.2), rel=1e-12)


def square(carriage_velocity: float) -> float:
    return carriage_velocity**2


def test_a_scene_without_committed_scores_has_none(tmp_path, capsys) -> None:
    assert best_known(FORCE, CARRIAGE_FORCE.replace(**{"control.steps": 7})) is None
    assert best_known("mine.toml", CARRIAGE_FORCE) is None
    assert best_known(FORCE, rewarded(CARRIAGE_FORCE, square)) is None
    changed = {FORCE: CARRIAGE_FORCE.replace(**{"control.steps": 7})}
    found = conclude(RESULTS[:1], changed, EPISODES)
    assert all(row.score is None for row in found.tables[FORCE])
    write_comparison(found, tmp_path)
    with (tmp_path / "comparison.csv").open(newline="") as lines:
        assert {row["score [-]"] for row in csv.DictReader(lines)} == {"nan"}
    print_comparison(found)
    for text in (page(found), capsys.readouterr().out):
        assert "95 % interval" in text
        assert "score" not in text
    print_comparison(CONCLUDED)
    for text in (page(CONCLUDED), capsys.readouterr().out):
        assert "score: 0 for the best constant" in " ".join(text.split())


def test_only_controllers_of_all_tasks_are_aggregated() -> None:
    labels = [one.controller for one in CONCLUDED.overall]
    assert set(labels) == {"good", "bad", "best constant", CHOSEN}
    assert labels[0] == "good"
    first = CONCLUDED.overall[0]
    assert first.probability_of_improvement["bad"] == 1.0
    assert (
        first.interquartile_mean.low
        < first.interquartile_mean.value
        < first.interquartile_mean.high
    )
    assert np.all(np.diff(first.profile[:, 0]) <= 0.0)


def test_change_is_of_the_same_episodes_so_what_all_find_expensive_widens_no_interval() -> None:
    episodes = np.random.default_rng(3).uniform(0.1, 9.0, (EPISODES.seeds, EPISODES.each))
    penalties = np.stack([2.0 * episodes, episodes, 0.81 * episodes])
    labels, reads = ("best constant", "law", "agent"), ("observation",) * 3
    sample = Sample(penalties, np.array([False, False, True]))
    alone = TaskResult(FORCE, labels, reads, sample, 0, 1)
    rows = {row.controller: row for row in conclude([alone], TASKS, EPISODES).tables[FORCE]}
    assert rows["law"].change is None
    assert rows["law"].episodes_won == rows["best constant"].episodes_won == 0.0
    assert rows["best constant"].change == pytest.approx((2**0.5 - 1.0,) * 3, rel=1e-12)
    value, low, high = rows["agent"].change
    assert value == pytest.approx(-0.1, rel=1e-12)
    assert low <= value <= high
    assert rows["agent"].episodes_won == 1.0
    cost = rows["agent"].cost
    assert high - low < 0.1 * (cost.high - cost.low) / cost.value


def test_worst_episode_and_tenth_are_of_the_costs() -> None:
    row = CONCLUDED.tables[FORCE][-1]
    penalties = RESULTS[0].sample.penalties[2].ravel()
    assert row.worst_episode == pytest.approx(penalties.max() ** 0.5, rel=1e-14)
    # Two of 24 episodes are nearest to a tenth.
    assert row.worst_tenth == pytest.approx(np.sort(penalties)[-2:].mean() ** 0.5, rel=1e-14)


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


def test_comparison_leaves_no_file_of_an_earlier_one_in_its_folder(tmp_path) -> None:
    (tmp_path / "effort.csv").write_text("one's own")
    write_comparison(CONCLUDED, tmp_path)
    assert (tmp_path / "effort.csv").exists()
    names = ("effort.csv", "scores.png", f"frequency_{_file_name(FORCE, [FORCE])}.png")
    for name in (*names, "frequency_mine.png", "notes.csv"):
        (tmp_path / name).write_text("earlier")
    write_comparison(CONCLUDED, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("comparison.csv", "comparison.json", "comparison.md"),
        *("episodes.csv", "frequency_mine.png", "notes.csv"),
    ]
    (tmp_path / "comparison.json").write_text("{}")
    write_comparison(CONCLUDED, tmp_path)


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
    (tmp_path / "free.toml").write_text("actuation.force.limit = 4.0\n")
    assert "got 'lqr', which cannot be designed: objective.effort_weight: got 0" in refused(
        SceneError, ["lqr"], ("free.toml",)
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
    (tmp_path / "tables").mkdir()
    assert "tables: no finished run here; train first" in refused(RunError, ["./tables"])
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
    unfinished = run(tmp_path / "e")
    (unfinished / "policy.safetensors").unlink()
    assert f"{first}: got runs of {FORCE}; allowed: of each of {FORCE}, {DUFFING}" in refused(
        RunError, [first, other]
    )
    run(tmp_path / "f-1")
    run(tmp_path / "f-2", DUFFING)
    assert f"f-*: got runs of {FORCE}, {DUFFING}; allowed: of each of {FORCE}" in refused(
        RunError, ["./f-*"], (FORCE,)
    )
    assert "training is not finished" in refused(RunError, [str(unfinished)])
    for name in ("a-1", "a-2", "a-3"):  # in another folder, of the same label
        run(tmp_path / "again" / name)
    for other in ("./b-*", "again/a-*"):
        assert f"different numbers of runs (./a-* has 2, {other} has 3); allowed: the same" in (
            refused(RunError, ["./a-*", other])
        )


OWN = "carriage.mass = 2.0\nactuation.force.limit = 4.0\ncontrol.steps = 20\n"


def own_run(folder: Path, scene: str, task: str = FORCE, gain: float = 1.0) -> str:
    """A finished run that was trained on a scene file."""
    found = load_scene(scene)
    content = json.loads(found.model_dump_json())
    settings = {"task": task, "scene": scene, "changes": {}}
    return str(run(folder, task, gain, settings=settings, scene=content, scene_digest=found.digest))


def test_runs_of_an_own_scene_are_compared_with_and_without_naming_it(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heavy.toml").write_text(OWN)
    runs = [own_run(tmp_path / name, "heavy.toml", gain=len(name)) for name in ("a", "bb")]
    texts = [*runs, "no-control"]
    costs = []
    for tasks in ((), ("heavy.toml",)):
        compared = read_field(texts, tasks)
        assert compared.scenes == {"heavy.toml": load_scene("heavy.toml")}
        (found,) = measure(compared, EPISODES)
        assert found.labels == ("best constant", "a", "bb", "no-control")
        costs.append(found.sample.penalties)
    assert np.array_equal(*costs)
    (tmp_path / "heavy.toml").unlink()
    assert list(read_field(runs).scenes) == ["heavy.toml"]


def test_runs_of_other_scenes_are_compared_where_it_is_said_and_named_so(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heavy.toml").write_text(OWN)
    (tmp_path / "light.toml").write_text(OWN.replace("2.0", "0.5"))
    heavy, light = (own_run(tmp_path / name, f"{name}.toml") for name in ("heavy", "light"))
    told = refused(RunError, [heavy, light])
    assert f"{heavy}: got runs of heavy.toml; allowed: of each of heavy.toml, light.toml" in told
    assert "or --tasks that says on which to compare them" in told
    task = str(run(tmp_path / "task"))
    compared = read_field([heavy, light, task], ["heavy.toml"])
    labels = ["heavy", "light, trained on light.toml", f"task, trained on {FORCE}"]
    assert [one.label for one in compared.contestants] == labels
    (found,) = measure(compared, EPISODES)
    assert found.labels[1:] == tuple(labels)
    same = str(run(tmp_path / "other" / "task"))
    labels = [f"{one}, trained on {FORCE}" for one in (task, same)]
    assert [one.label for one in read_field([task, same], ["heavy.toml"]).contestants] == labels
    (tmp_path / "heavy.toml").write_text(OWN.replace("2.0", "3.0"))
    (label,) = (one.label for one in read_field([heavy], ["heavy.toml"]).contestants)
    assert label == "heavy, trained on heavy.toml, as it was"
    assert list(read_field([heavy]).scenes) == ["heavy.toml, as it was"]


def test_two_scenes_of_one_name_are_not_mixed_up(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    runs = []
    for mass in ("2.0", "3.0"):
        (tmp_path / "own.toml").write_text(OWN.replace("2.0", mass))
        runs.append(own_run(tmp_path / f"m{mass[0]}", "own.toml"))
    (tmp_path / "own.toml").unlink()
    told = refused(RunError, runs)
    assert "m2: trained on another own.toml than other runs" in told


def test_agent_around_a_controller_keeps_the_one_of_its_own_scene(tmp_path) -> None:
    heavy = CARRIAGE_FORCE.replace(**{"carriage.mass": 3.0})
    folder = tmp_path / "residual"
    settings = {"task": FORCE, "base": "lqr", "authority": 0.5}
    scene = json.loads(heavy.model_dump_json())
    run(folder, settings=settings, scene=scene, scene_digest=heavy.digest)
    agent = law_of(str(folder), CARRIAGE_FORCE, np.random.default_rng(0))
    np.testing.assert_array_equal(agent.base.law.design.gain, LQR(heavy).design.gain)


def test_policy_files_of_one_name_have_rows_of_their_own(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a/policy.safetensors", "b/policy.safetensors", "c.npz"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        policy(1.0).save(tmp_path / name)
    compared = read_field(["a/policy.safetensors", "b/policy.safetensors", "c.npz"], [FORCE])
    assert [one.label for one in compared.contestants] == [
        "a/policy.safetensors",
        "b/policy.safetensors",
        "c.npz",
    ]
    (alone,) = read_field(["a/policy.safetensors"], [FORCE]).contestants
    assert alone.label == "policy.safetensors"


UNSEEN = """
control.steps = 20
initial.carriage_displacement = 0.01
objective.effort_weight = 0.01
sensors.channels = ["carriage_displacement", "carriage_acceleration"]
"""
"""Sensors that do not show where the sphere is."""


def test_controllers_that_do_not_apply_say_why_and_the_others_are_scored(
    tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "force.toml").write_text(
        f"{UNSEEN}actuation.force = {{ limit = 4.0, between = 'masses' }}\n"
        "objective.stroke_weight = 1.0\n"
    )
    policy(1.0).save(tmp_path / "four.npz")
    compared = read_field(["baselines", "lqr", "no-control", "four.npz"], ["force.toml"])
    (found,) = measure(compared, EPISODES)
    assert found.labels == ("best constant", "no control", "no-control")
    assert np.array_equal(found.sample.penalties[1], found.sample.penalties[2])
    unseen = {"LQR", "velocity feedback", "LQG", "detuned LQG", "lqr", "energy shaping"}
    assert set(found.not_scored) == unseen | {"four.npz"}
    for name in unseen:
        assert found.not_scored[name].startswith("sensors.channels: ")
    assert "got 4 observed numbers" in found.not_scored["four.npz"]
    assert found.labels[found.chosen or 0] == "no control"
    concluded = conclude([found], compared.scenes, EPISODES)
    (line,) = (line for line in page(concluded).splitlines() if line.startswith("| LQG"))
    assert line.startswith("| LQG: not scored: sensors.channels: they do not show the mode")
    assert line.count("|") == page(concluded).splitlines()[6].count("|")
    write_comparison(concluded, tmp_path / "out")
    with (tmp_path / "out" / "comparison.csv").open(newline="") as lines:
        rows = {row["controller"]: row for row in csv.DictReader(lines)}
    assert rows["LQG"]["cost [-]"] == "nan"
    assert rows["LQG"]["not scored"] == found.not_scored["LQG"]
    assert rows["no control"]["not scored"] == ""
    words = ["evaluate", "baselines", "--tasks", "force.toml", "--episodes", "2", "--seeds", "1"]
    monkeypatch.setattr(sys, "argv", words)
    assert command.main() is None
    assert "LQG: not scored:" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["evaluate", "lqr", *words[2:]])
    assert str(command.main()).startswith("error: force.toml: lqr: not scored: sensors.channels")


def test_no_stretch_is_tuned_by_sensors_that_do_not_show_the_sphere(tmp_path) -> None:
    file = tmp_path / "stretch.toml"
    file.write_text(
        f"{UNSEEN}springs.kind = 'small_on_large'\nactuation.stretch.rate_limit = 4.0\n"
        "interface.kind = 'none'\n"
    )
    (found,) = measure(read_field(["baselines"], [str(file)]), EPISODES)
    assert {"best constant", "no control"} <= set(found.labels)
    assert len(found.labels) + len(found.not_scored) == 8


def test_report_of_a_run_says_why_baselines_have_no_score(capsys) -> None:
    scene = CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0, "control.steps": 10})
    command.report([], scene, 4, None)
    printed = " ".join(capsys.readouterr().out.split())
    assert "LQR: not scored:" in printed
    assert "velocity feedback, " in printed


def test_figures_of_two_scenes_have_names_of_their_own() -> None:
    assert _file_name(FORCE, [FORCE, DUFFING]) == "carriageforce-v0"
    scenes = ["a/own.toml", "b/own.toml", "own.toml, control.steps = 3"]
    assert len({_file_name(scene, scenes) for scene in scenes}) == 3


def test_wrong_counts_are_refused() -> None:
    lqr = Contestant("lqr", "lqr", {FORCE: ("lqr",)})
    two = Contestant("ppo", "ppo-*", {FORCE: ("a", "b")})
    one, several = (Field(TASKS, (who,), baselines=False) for who in (lqr, two))
    for field, seeds, each, first, text in (
        (one, 0, 8, HELD_OUT_SEED, "--seeds: got 0; allowed: at least 1"),
        (several, 5, 8, HELD_OUT_SEED, "--seeds: got 5; allowed: 2, as many as there are runs"),
        (one, 5, 1, HELD_OUT_SEED, "--episodes: got 1; allowed: at least 2"),
        (one, 5, 8, 7, "--first-seed: got 7 for 5 x 8 episodes; allowed: 1000000 to 1999960"),
        (one, 5, 8, 1_999_961, "--first-seed: got 1999961"),
        (one, 5, 10**9, HELD_OUT_SEED, "5 x 1000000000 episodes; allowed: at most 1000000"),
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
        "error: --policy: allowed for one run; name the file or FILE.py:NAME among the subjects"
    )
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
        (["runs/first", "--first-seed", "1500000"], True),
        (["runs/first", "--out", "out"], True),
        (["runs/ppo-*"], True),
        (["lqr"], True),
        (["baselines"], True),
        (["baselines", "--policy", "x.npz"], False),
        (["mm_gym/CarriageForce-v0", "--controller", "mine.py:Law"], False),
        (["CarriageForce", "--controller", "mine.py:Law", "--out", "out"], False),
    ],
)
def test_one_run_is_reported_and_all_else_compared(words, compares) -> None:
    assert tyro.cli(command.Arguments, args=words).compares == compares


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ["--policy", "p.npz", "--controller", "mine.py:Law"],
            "--policy: got p.npz and --controller; allowed: one of them",
        ),
        (["--first-seed", "7"], "--first-seed: got 7 for 5 x 64 episodes; allowed: 1000000 to"),
    ],
)
def test_no_flag_of_one_run_is_ignored(words, told, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate", str(run(tmp_path / "first")), *words])
    assert str(command.main()).startswith(f"error: {told}")


@pytest.mark.parametrize("flag", ["--episodes", "--processes"])
def test_numbers_below_1_are_refused(flag, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate", "runs/first", flag, "0"])
    with pytest.raises(SystemExit, match="2"):
        command.main()
    assert f"{flag[2:]}: got 0; allowed: greater than or" in capsys.readouterr().err


def test_nothing_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate"])
    assert command.main() == (
        "error: got nothing to evaluate; allowed: the folder of a run, or baselines"
    )


def test_files_of_an_earlier_large_comparison_do_not_stay(tmp_path) -> None:
    rows = [{"controller": f"controller {k}", "cost": 0.1} for k in range(2000)]
    (tmp_path / "comparison.json").write_text(json.dumps({"tasks": {"Hybrid": rows}}))
    (tmp_path / "robustness.csv").write_text("earlier")
    _delete_earlier(tmp_path)
    assert not (tmp_path / "robustness.csv").exists()
