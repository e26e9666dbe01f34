"""Is nothing lost and nothing mixed up, whatever happens to a run?"""

import json
import os
import platform
import re
import shlex
import signal
import subprocess
import time
from shutil import which

import kills
import numpy as np
import pytest

from agents.commands import demo
from agents.commands import train as command
from agents.evolution.search import EvolveSettings, evolve
from agents.policies import load_policy
from agents.scoring import HELD_OUT_SEED, VALIDATION_SEED
from agents.training import runs
from agents.training.arrays import load_checkpoint
from agents.training.config import TrainSettings, training_seeds
from agents.training.lanes import TrainingLanes, make_lanes
from agents.training.parts import Parts
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError, numbered
from mm_gym import MovingMassVectorEnv, SceneError

TINY = TrainSettings(
    task="mm_gym/CarriageForce-v0",
    name="tiny",
    lanes=4,
    steps=1600,
    evaluations=4,
    normalise_observations=True,
    ppo={"rollout": 50, "batch_size": 100, "epochs": 2, "reward_scale": 10.0, "hidden": (8,)},
)


def changed(**fields):
    return TrainSettings(**(TINY.model_dump() | fields))


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    run = Run("tiny", tmp_path_factory.mktemp("runs"))
    train(TINY, run)
    return run


def outcome(run):
    """Return all that a run found out: validations without their times, and the policy."""
    metrics = np.loadtxt(run.metrics, delimiter=",", skiprows=1, usecols=(0, 1))
    policy = load_policy(run.policy)
    return [metrics, *policy.arrays.values()]


def assert_same_outcome(run, other):
    for own, others in zip(outcome(run), outcome(other), strict=True):
        np.testing.assert_array_equal(own, others)


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def wait_for(path):
    for _ in range(60_000):
        if path.exists():
            return
        time.sleep(0.01)
    message = f"{path} was not written within ten minutes"
    raise TimeoutError(message)


def measured(folder):
    """Return how long a training takes in a process of its own [s]."""
    kills.begin_training(TINY, folder / "imports", touches=0).join()
    begun = time.perf_counter()
    kills.begin_training(TINY, folder / "whole").join()
    return time.perf_counter() - begun


class TestKills:
    @pytest.mark.parametrize("kills_wanted", [2, 100])
    def test_runs_killed_at_random_instants_end_as_if_uninterrupted(
        self, uninterrupted, tmp_path, kills_wanted
    ):
        draw, killed, finished = np.random.default_rng(kills_wanted), 0, 0
        seconds = measured(tmp_path)
        while killed < kills_wanted:
            root = tmp_path / str(finished)
            # Half of them die just before they touch a file, where most could go wrong.
            touches = int(draw.integers(50)) if killed % 2 else None
            process = kills.begin_training(TINY, root, touches)
            process.join(None if touches is not None else draw.uniform(0.0, seconds))
            process.kill()
            process.join()
            if process.exitcode == -signal.SIGKILL:
                killed += 1
            else:
                assert process.exitcode == 0
                assert_same_outcome(Run("tiny", root), uninterrupted)
                finished += 1
        train(TINY, Run("tiny", root))
        assert_same_outcome(Run("tiny", root), uninterrupted)
        left = {path.name for path in (root / "tiny").iterdir()}
        assert left == {".lock", "tensorboard", *(p.name for p in written(uninterrupted))}

    def test_run_killed_before_each_touch_of_a_file_ends_as_if_uninterrupted(
        self, uninterrupted, tmp_path
    ):
        for touches in range(200):
            root = tmp_path / str(touches)
            process = kills.begin_training(TINY, root, touches)
            process.join()
            if process.exitcode == 0:
                break
            train(TINY, Run("tiny", root))
            assert_same_outcome(Run("tiny", root), uninterrupted)
        assert 20 < touches < 199


def test_evolution_killed_ten_times_at_random_instants_ends_as_if_uninterrupted(tmp_path):
    settings = EvolveSettings(
        task=TINY.task,
        name="tiny",
        candidates=8,
        episodes=4,
        hidden=4,
        generations=20_000,
        threads=1,
    )
    whole = Run("tiny", tmp_path / "whole")
    evolve(settings, whole)
    broken = kills.kill_ten_times(kills.begin_evolution, settings, tmp_path / "broken")
    evolve(settings, broken)
    assert broken.metrics.read_bytes() == whole.metrics.read_bytes()
    assert broken.policy.read_bytes() == whole.policy.read_bytes()


def written(run):
    return run.record, run.checkpoint, run.metrics, run.times, run.ending, run.policy


class TestInterrupts:
    def test_run_interrupted_within_any_rollout_ends_as_if_uninterrupted(
        self, uninterrupted, tmp_path, monkeypatch
    ):
        run, step = Run("tiny", tmp_path), TrainingLanes.step_wait
        left = 0

        def interrupt(lanes):
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            return step(lanes)

        monkeypatch.setattr(TrainingLanes, "step_wait", interrupt)
        reached = []
        for left in (3, 120, 60, 170, 0):
            if left == 0:
                train(TINY, run)
                break
            with pytest.raises(KeyboardInterrupt):
                train(TINY, run)
            reached.append(int(load_checkpoint(run.checkpoint)["model/steps"]))
        # A rollout is 200 steps of all lanes, 50 of each; what is interrupted begins again.
        assert reached == [0, 400, 600, 1200]
        assert_same_outcome(run, uninterrupted)

    def test_ctrl_c_saves_and_says_in_one_line_how_to_continue(self, tmp_path):
        file = tmp_path / "tiny.toml"
        file.write_text(
            'task = "mm_gym/CarriageForce-v0"\nname = "tiny"\nlanes = 4\nevaluations = 1000\n'
            "[ppo]\nrollout = 50\nbatch_size = 100\nhidden = [8]\n"
        )
        process = kills.begin_command([str(file)], tmp_path)
        run = Run("tiny", tmp_path / "runs")
        wait_for(run.checkpoint)
        os.kill(process.pid, signal.SIGINT)
        process.join()
        assert process.exitcode == 130
        *_, line = (tmp_path / "errors").read_text().splitlines()
        assert re.fullmatch(
            r"interrupted after [\d,]+ of 1,000,000 control steps: runs/tiny: "
            "give the same command again to continue",
            line,
        )
        assert "Traceback" not in (tmp_path / "errors").read_text()
        assert load_checkpoint(run.checkpoint)["model/steps"] > 0

    def test_ctrl_c_after_training_says_how_to_score(self, uninterrupted, monkeypatch):
        def interrupt(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr(command, "report_run", interrupt)
        monkeypatch.chdir(uninterrupted.folder.parent)
        monkeypatch.setattr(command, "Run", lambda name: Run(name, "."))
        with pytest.raises(KeyboardInterrupt) as caught:
            command.train_and_report(TINY)
        advice = "tiny: trained; score it: python -m agents evaluate tiny"
        assert caught.value.args == ("", advice)

    def test_command_that_scores_a_run_can_be_given_as_it_is_printed(self, tmp_path):
        assert shlex.split(Run("my run", tmp_path).scoring)[4:] == [str(tmp_path / "my run")]

    def test_time_of_a_continued_run_counts_on(self, tmp_path):
        run, settings = Run("tiny", tmp_path), changed(steps=10**8, time_budget=1.0)
        train(settings, run)
        run.policy.rename(
            tmp_path / "policy.safetensors"
        )  # as if killed just before it was written
        before = run.metrics.read_text()
        train(settings, run)
        assert run.metrics.read_text() == before


class TestTwoTrainingsOfOneName:
    def test_second_training_is_refused_and_touches_nothing(self, uninterrupted, tmp_path):
        process = kills.begin_training(TINY, tmp_path)
        run = Run("tiny", tmp_path)
        wait_for(run.record)
        os.kill(process.pid, signal.SIGSTOP)
        before = contents(run.folder)
        try:
            holder = f"tiny: process {process.pid} on {platform.node()} is training this run"
            with pytest.raises(RunError, match=holder):
                train(TINY, run)
            with pytest.raises(RunError, match="choose another name with --name"):
                train(changed(seed=1), run)
            assert contents(run.folder) == before
        finally:
            os.kill(process.pid, signal.SIGCONT)
        process.join()
        assert_same_outcome(run, uninterrupted)

    def test_file_in_the_place_of_the_folder_is_refused_and_kept(self, tmp_path):
        (tmp_path / "tiny").write_text("mine")
        with pytest.raises(RunError, match="tiny: cannot be the folder of a run"):
            train(TINY, Run("tiny", tmp_path))
        assert (tmp_path / "tiny").read_text() == "mine"

    def test_broken_checkpoint_is_named_and_kept(self, tmp_path):
        run = Run("tiny", tmp_path)
        run.folder.mkdir()
        run.checkpoint.write_text("nonsense")
        with pytest.raises(RunError, match=r"checkpoint\.npz: not a checkpoint"):
            train(TINY, run)
        assert run.checkpoint.read_text() == "nonsense"


class TestNames:
    def test_each_policy_of_a_run_that_goes_on_is_kept(self, tmp_path):
        run = Run("tiny", tmp_path)
        for budget in (1.0, 2.0, 3.0, 4.0):
            run.open(changed(time_budget=budget))
            run.policy.write_text(f"after {budget} s")
        names = [f"policy-1600{end}.safetensors" for end in ("", "-2", "-3")]
        told = [(run.folder / name).read_text() for name in names]
        assert told == ["after 1.0 s", "after 2.0 s", "after 3.0 s"]

    def test_demo_keeps_finished_runs_and_numbers_new_ones(self, tmp_path, monkeypatch):
        file = tmp_path / "demo.toml"
        file.write_text('name = "show"\nsteps = 200\n')
        monkeypatch.setattr(demo, "SETTINGS", file)
        shown = []
        monkeypatch.setattr("sys.argv", ["demo"])
        monkeypatch.setattr(command, "report_run", lambda *_, others, **__: shown.extend(others))
        monkeypatch.setattr(demo, "GENERATIONS", 1)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(
            demo, "read_settings", lambda *_: changed(name="show", steps=200, evaluations=1)
        )
        demo.main()
        before = contents(tmp_path / "runs" / "show")
        demo.main()
        demo.main()
        runs = sorted(path.name for path in (tmp_path / "runs").iterdir())
        names = ["show", "show-2", "show-2-evolved", "show-3", "show-3-evolved", "show-evolved"]
        assert runs == names
        plan = "clairvoyant optimum (best found)"
        assert [controller.name for controller in shown] == [plan, "evolved network"] * 3
        assert contents(tmp_path / "runs" / "show") == before
        record = json.loads((tmp_path / "runs" / "show-2" / "run.json").read_text())
        assert record["settings"]["name"] == "show-2"
        assert record["settings"]["time_budget"] == demo.LONGEST["PPO"]

    def test_interrupted_run_keeps_its_name_and_other_settings_get_another(self, tmp_path):
        Run("tiny", tmp_path).folder.mkdir()
        Run("tiny", tmp_path).open(TINY)
        assert numbered(TINY, tmp_path) == TINY
        assert numbered(changed(seed=4), tmp_path).name == "tiny-2"


class TestStreams:
    SEEDS = (0, 1, 2, 999_999, 1_000_000, 2_000_000, 2**31, 2**32 - 1)

    def test_no_two_trainings_and_no_evaluation_have_a_seed_in_common(self):
        drawn = [seed for key in self.SEEDS for seed in training_seeds(key, 4096)]
        assert len(set(drawn)) == len(drawn)
        # An evaluation's seeds count up from its first, and lack the bit of all training seeds.
        assert min(drawn) >= 2**63 > VALIDATION_SEED + 10**9
        assert max(drawn) < 2**64

    def test_no_lane_of_a_training_draws_the_episodes_of_another_or_of_an_evaluation(self):
        scene = changed(task="mm_gym/PreStretch-v0").load_scene()
        keys = []
        for seed in self.SEEDS:
            lanes = make_lanes(changed(task="mm_gym/PreStretch-v0", lanes=128), Parts(scene))
            lanes.seed(seed)
            lanes.reset()
            keys += list(lanes.get_state()["streams"][0])
        for seed in (HELD_OUT_SEED, VALIDATION_SEED):
            env = MovingMassVectorEnv(scene, 1000)
            env.reset(seed=seed)
            keys += list(env.get_state()["streams"][0])
        assert len(set(keys)) == len(keys)

    def test_largest_seed_trains(self, tmp_path):
        run = Run("tiny", tmp_path)
        train(changed(seed=2**32 - 1, steps=200, evaluations=1), run)
        assert run.finished


class TestRefusals:
    def test_scene_without_an_actuator_is_refused_before_a_folder_is_made(self, tmp_path):
        scene = tmp_path / "scene.toml"
        scene.write_text("[carriage]\nmass = 0.1\nstiffness = 400.0\n")
        with pytest.raises(SceneError, match="needs an actuator"):
            train(changed(scene=str(scene)), Run("tiny", tmp_path / "runs"))
        assert not (tmp_path / "runs").exists()


def test_commit_of_a_run_is_of_changed_code_where_a_training_reads_what_changed(
    tmp_path, monkeypatch
):
    for name in ("agents/training/runs.py", "docs/page.md", "configs/a.toml"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("before\n")
    monkeypatch.setattr(runs, "__file__", str(tmp_path / "agents" / "training" / "runs.py"))
    assert runs.commit() == "unknown: not a checkout"
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for words in (["init", "-q"], ["add", "."], [*who, "commit", "-qm", "First"]):
        subprocess.run([which("git"), "-C", str(tmp_path), *words], check=True)
    (tmp_path / "docs" / "page.md").write_text("after\n")
    clean = runs.commit()
    assert re.fullmatch("[0-9a-f]{40}", clean)
    (tmp_path / "configs" / "a.toml").write_text("after\n")
    assert runs.commit() == f"{clean}-dirty"
