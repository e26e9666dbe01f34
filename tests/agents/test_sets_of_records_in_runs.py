"""Do trainings and comparisons draw from sets of records, wherever they are called and moved to?

One folder has a scene, its records and its runs; the commands are called as a user calls them.
"""

import json
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from agents.training.parts import base_controller
from agents.training.runs import Run
from mm_gym import MovingMassVectorEnv, load_scene

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
    before = {file: file.read_bytes() for file in Path("runs/a").iterdir()}
    more = [*EVOLVE, "2"]
    motion = folder / "motions" / "m1.csv"
    content = motion.read_bytes()
    motion.unlink()
    missing = f"error: excitation.0.files: {motion}: no such file"
    assert call(*more).startswith(missing)
    assert call("evaluate", "runs/a").startswith(missing)
    motion.write_bytes(content.replace(b"0.01", b"0.011", 1))
    assert "the scene is another" in call(*more)
    assert before == {file: file.read_bytes() for file in Path("runs/a").iterdir()}
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
