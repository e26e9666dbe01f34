"""Do trainings and comparisons draw from sets of records, wherever they are called and moved to?

One folder has a scene, its records and its runs; the commands are called as a user calls them.
"""

import json
import shutil
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from agents.training.parts import base_controller
from agents.training.runs import Run
from mm_gym import MovingMassEnv, MovingMassVectorEnv, load_scene

pytestmark = pytest.mark.usefixtures("untuned")

SCENE = """
[interface]
kind = "viscous"
damping = 0.03

[springs]
kind = "linear"
stiffness = 33.0

[[excitation]]
kind = "record"
target = "ground"
files = {files}
scale_to = {scale}

[actuation.force]
limit = 2.0

[objective]
effort_weight = 0.05

[control]
time_step = 0.01
steps = 60
"""
PEAK = "{ peak = [1.0, 3.0] }"
ORDINATE = "{ spectral_acceleration = [2.0, 5.0], period = 0.1 }"
LIST, PATTERN = '["motions/m0.csv", "motions/m1.csv", "motions/m2.csv"]', '"motions/m*.csv"'
SMALL = "--evaluations 1 --candidates 4 --episodes 4 --threads 1"
EVOLVE = f"evolve --scene scene.toml --name a {SMALL} --generations".split()
FLAGS = {
    "evolve": f"--generations 2 {SMALL}",
    "descend": "--iterations 2 --evaluations 1 --episodes 4 --hidden 4",
    "train": "--lanes 8 --steps 160 --evaluations 2 --ppo.rollout 10 --ppo.batch-size 40",
}
SWEPT = {
    "scene": "scene.toml",
    "evolution.generations": 2,
    "evolution.evaluations": 1,
    "evolution.candidates": 4,
    "evolution.episodes": 4,
    "evolution.threads": 1,
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "lab [1]"
    (place / "motions").mkdir(parents=True)
    rng = np.random.default_rng(1)
    for k in range(3):
        rows = np.column_stack([0.01 * np.arange(70), rng.normal(size=70)])
        np.savetxt(place / "motions" / f"m{k}.csv", rows, "%.17g", delimiter=",")
    write(place)
    monkeypatch.chdir(place)
    return place


def write(place, files=LIST, scale=PEAK):
    (place / "scene.toml").write_text(SCENE.format(files=files, scale=scale))


@pytest.fixture
def call(monkeypatch):
    def run(*words):
        monkeypatch.setattr("sys.argv", list(words))
        return import_module(f"agents.commands.{words[0]}").main()

    return run


@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
@pytest.mark.parametrize("command", FLAGS)
@pytest.mark.parametrize("motions", [(LIST, ORDINATE), (PATTERN, PEAK)])
def test_trainings_draw_from_a_set(folder, call, monkeypatch, command, motions):
    still = "no-control"  # nothing is tuned for the ranking of a training
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda s: ([base_controller(s, still)], {})
    )
    write(folder, *motions)
    flags = ["--scene", "scene.toml", "--name", "a", *FLAGS[command].split()]
    assert call(command, *flags) in {None, 0}
    run = Run("a")
    assert run.finished
    assert run.scene().excitation[0].paths == load_scene("scene.toml").excitation[0].paths
    assert run.read()["scene_digest"] == load_scene("scene.toml").digest


@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
def test_comparison_of_a_set_is_the_same_from_everywhere(folder, call, monkeypatch, tmp_path):
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    call(*EVOLVE, "1")
    few = ["--episodes", "4", "--seeds", "2", "--processes", "1"]
    here = ["evaluate", "no-control", "runs/a", "--tasks", "scene.toml", "--out", "here"]
    assert call(*here, *few) in {None, 0}
    moved = tmp_path / "moved"
    shutil.copytree(folder, moved)
    shutil.rmtree(folder / "motions")
    monkeypatch.chdir(tmp_path)
    there = ["evaluate", "no-control", "moved/runs/a", "--tasks", "moved/scene.toml"]
    assert call(*there, "--out", "there", *few) in {None, 0}
    rows = [
        (place / "comparison.csv").read_text().replace("moved/", "")
        for place in (folder / "here", tmp_path / "there")
    ]
    assert rows[0] == rows[1]
    assert "trained on" not in rows[0]


@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
def test_run_is_not_continued_with_other_records_and_loses_nothing(folder, call):
    call(*EVOLVE, "1")
    before = {file: file.read_bytes() for file in Path("runs/a").iterdir() if file.is_file()}
    more = [*EVOLVE, "2"]
    motion = folder / "motions" / "m1.csv"
    content = motion.read_bytes()
    motion.unlink()
    missing = f"error: excitation.0.files: {motion}: no such file"
    assert call(*more).startswith(missing)
    assert call("evaluate", "runs/a").startswith(missing)
    motion.write_bytes(content.replace(b"0.01", b"0.011", 1))
    assert "the scene is another" in call(*more)
    assert before == {
        file: file.read_bytes() for file in Path("runs/a").iterdir() if file.is_file()
    }
    motion.write_bytes(content)
    assert call(*more) in {None, 0}
    assert len(json.loads(Path("runs/a/run.json").read_text())["earlier"]) == 1


@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
def test_scene_of_a_file_is_the_same_in_another_folder(folder, monkeypatch, tmp_path):
    scene = load_scene("scene.toml")
    monkeypatch.chdir(tmp_path)
    env = MovingMassVectorEnv(scene, num_envs=4)
    env.reset(seed=1)
    assert scene == load_scene(folder / "scene.toml")
    content = (folder / "motions" / "m0.csv").read_bytes()
    shutil.copytree(folder, tmp_path / "other")
    assert load_scene("other/scene.toml").digest == scene.digest
    (tmp_path / "other" / "motions" / "m0.csv").write_bytes(content + b"9,1\n")
    assert load_scene("other/scene.toml").digest != scene.digest


@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
def test_sweep_and_search_of_settings_draw_from_a_set(folder, call):
    pytest.importorskip("optuna")
    write(folder, PATTERN)
    flags = ["--name", "all", "--algorithms", "evolution", "--processes", "1", "--settings"]
    assert call("sweep", *flags, json.dumps(SWEPT)) in {None, 0}
    searched = ["--scene", "scene.toml", "--name", "best", "--trials", "1", "--lanes", "8"]
    assert call("tune", *searched, "--steps", "160", "--evaluations", "1") in {None, 0}
    for name in ("all/PreStretch-evolution-plain-0", "best/trial-0"):
        run = Run(name)
        assert run.finished, name
        assert run.read()["scene_digest"] == load_scene("scene.toml").digest


@pytest.mark.usefixtures("folder")
@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
def test_recorded_episodes_are_played_again_in_another_folder(call, monkeypatch, tmp_path):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    few = ["--controller", "no-control", "--episodes", "5", "--lanes", "2", "--seed", "7"]
    assert call("record", "scene.toml", *few, "--out", "own/motions-v0") in {None, 0}
    monkeypatch.chdir(tmp_path)
    data = minari.load_dataset("own/motions-v0")
    env = data.recover_environment()
    for k, episode in enumerate(data):
        seen = [env.reset(seed=7 + k)[0]]
        seen += [env.step(action)[0] for action in episode.actions]
        assert np.array_equal(seen, episode.observations)


@pytest.mark.usefixtures("folder")
@pytest.mark.filterwarnings("ignore:.*records? lasts?.*")
@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_processes_in_another_folder_draw_the_same_records(monkeypatch, tmp_path, method):
    vectors = pytest.importorskip("stable_baselines3.common.vec_env")
    scene = load_scene("scene.toml")
    monkeypatch.chdir(tmp_path)
    makers = [partial(MovingMassEnv, scene)] * 2
    found = []
    for vector in (
        vectors.SubprocVecEnv(makers, start_method=method),
        vectors.DummyVecEnv(makers),
    ):
        vector.seed(3)
        seen = [vector.reset()]
        seen += [vector.step(np.full((2, 1), 0.3, np.float32))[0] for _ in range(130)]
        found.append(np.array(seen))
        vector.close()
    assert np.array_equal(*found)
    assert not np.array_equal(found[0][:, 0], found[0][:, 1])
