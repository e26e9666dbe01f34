"""The page on training runs as it is printed, and what it promises of own files holds."""

import json
import re
import shlex
import subprocess
from contextlib import nullcontext
from importlib import import_module

import pytest
from pages import ROOT, blocks

from agents.commands import evaluate, record, report
from agents.commands.evaluate import report_run
from agents.controllers.registry import laws
from agents.evaluation.contestants import read_field
from agents.evaluation.measurement import entries
from agents.policies import PolicyError
from agents.sweeps.trials import do_trial
from agents.training.config import TrainSettings, read_settings
from agents.training.parts import base_controller
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError
from mm_gym import SceneError, load_scene
from mm_gym.tasks import ids

LAW = """
import numpy as np

class Law:
    def __init__(self, scene):
        pass
    def action(self, memory, state, applied):
        return -0.25 * np.sign(state[:, 2:3]), memory
"""


COMMAND = re.compile(r"python -m agents[. ](\w+) (.*)")


def run_here(page, folder):
    """Run the blocks of a page in order, its commands in this process: they import torch."""
    for text in (text for language, text in blocks(page) if language == "sh"):
        shown = "\n".join(line for line in text.splitlines() if not COMMAND.fullmatch(line))
        subprocess.run(["sh", "-ec", shown], cwd=folder, check=True)  # noqa: S607 - as pages.py
        for module, words in COMMAND.findall(text):
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                patch.setattr("sys.argv", [module, *shlex.split(words)])
                assert import_module(f"agents.commands.{module}").main() is None


def here(trials, _, report):
    """Do the trainings of a sweep in this process, which has imported torch."""
    for number, (text, folder) in enumerate(trials):
        do_trial(text, folder)
        report(number, None)


@pytest.mark.usefixtures("untuned")
def test_blocks_of_the_page_do_what_it_says(tmp_path, monkeypatch):
    # The laws are tuned for a report too, which takes longer than all else here.
    still = "no-control"
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda s: ([base_controller(s, still)], {})
    )
    monkeypatch.setattr("agents.commands.sweep.work_here", here)  # test_sweep.py has its processes
    run_here("../training", tmp_path)
    runs = tmp_path / "runs"
    assert json.loads((runs / "heavy" / "run.json").read_text())["scene"]["carriage"]["mass"] == 0.2
    code = json.loads((runs / "comfort" / "run.json").read_text())["code"]
    assert code == {"comfort.py": (tmp_path / "comfort.py").read_text()}
    assert "Law" in json.loads((runs / "bang" / "run.json").read_text())["code"]["bang.py"]
    assert read_settings(runs / "quick" / "best.toml", TrainSettings).steps == 1600
    rows = (runs / "first_sweep" / "results.csv").read_text().splitlines()
    assert [row.split(",")[2] for row in rows[1:]] == ["plain", "small"]


def test_page_names_every_base_and_algorithm():
    page = (ROOT / "docs" / "training.md").read_text()
    assert all(name in page for task in ids() for name in laws(load_scene(task)))
    assert all(f"`{name}`" in page for name in ("ppo", "sac", "td3", "tqc", "crossq"))


def test_every_task_has_a_file_of_settings():
    files = (ROOT / "configs" / "agents").glob("*.toml")
    assert sorted(read_settings(file, TrainSettings).task for file in files) == sorted(ids())


def settings_of(**fields):
    data = {"task": "mm_gym/CarriageForce-v0", "name": "own", "steps": 160, "evaluations": 1}
    small = {"rollout": 10, "batch_size": 40, "hidden": (8,)}
    return TrainSettings(**(data | {"lanes": 8, "ppo": small} | fields))


def written(folder, text, name="own.py"):
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize(
    ("reward", "text", "words"),
    [
        ("own.py", "", "reward: got 'own.py'; allowed: FILE.py:NAME"),
        ("absent.py:cost", "", "reward: absent.py: no such file"),
        (
            "own.py:cst",
            "def cost(stretch): pass",
            "no class or function 'cst'; did you mean 'cost'",
        ),
        ("own.py:cost", "cost = 3", "own.py: it has no class or function 'cost'"),
        ("own.py:cost", "def cost(", "reward: own.py: SyntaxError"),
        (
            "own.py:cost",
            "def cost(carriage_velocty): return 0.0",
            "did you mean 'carriage_velocity'",
        ),
        ("own.py:cost", "def cost(): return 0.0", "got the argument ''"),
        (
            "own.py:cost",
            "def cost(stretch): return 0.0",
            "needs springs with a stretch; springs.kind: got",
        ),
        (
            "own.py:cost",
            "def cost(slip_velocity): return 0.0 * slip_velocity / 0.0",
            "returned nan for slip_velocity = 0; allowed: a finite number",
        ),
        ("own.py:cost", "def cost(slip_velocity): return float('nan')", "returned nan"),
    ],
)
def test_wrong_cost_is_named(tmp_path, monkeypatch, reward, text, words):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, text)
    with pytest.raises(SceneError, match=words):
        train(settings_of(reward=reward), Run("own", tmp_path), bar=False)


@pytest.mark.parametrize(
    ("base", "text", "words"),
    [
        ("absent.py:Law", "", "base: absent.py: no such file"),
        ("own.py:Law", "class Law: pass", r"base: own.py: TypeError: Law\(\) takes no arg"),
        ("own.py:Law", "def Law(scene): return 3", "own.py:Law makes a int; allowed: a law"),
        ("own.py:Law", "def Law(scene): raise KeyError(3)", "base: own.py, line 1: KeyError: 3"),
        ("lqr_", "", "base: got 'lqr_'; did you mean 'lqr'"),
    ],
)
def test_wrong_base_is_named_before_a_folder_is_made(tmp_path, monkeypatch, base, text, words):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, text)
    with pytest.raises(SceneError, match=words):
        train(settings_of(base=base), Run("own", tmp_path), bar=False)
    assert not (tmp_path / "own").exists()


@pytest.mark.parametrize(
    ("module", "name"), [(evaluate, "read_field"), (report, "read_field"), (record, "law_of")]
)
def test_flag_trusts_what_is_named(module, name, monkeypatch):
    asked = []

    def note(*_, trust):
        asked.append(trust)
        raise SceneError

    words = ["--controller", "runs/a"] if module is record else ["runs/a", "runs/b"]
    monkeypatch.setattr(module, name, note)
    for more in ([], ["--trust"]):
        monkeypatch.setattr("sys.argv", ["command", *words, *more])
        module.main()
    assert asked == [False, True]


def test_run_with_own_code_is_scored_if_trusted_and_not_continued_with_other_code(tmp_path):
    base = f"{written(tmp_path, LAW)}:Law"
    run, settings = Run("own", tmp_path), settings_of(base=base)
    train(settings, run, bar=False)
    assert run.scoring.endswith("/own --trust")
    with pytest.raises(
        PolicyError,
        match=r"own.py:Law: scoring executes .*allow it with --trust",
    ):
        report_run(run, episodes=2)
    assert report_run(run, episodes=2, trust=True)[-1].name == "learned"
    names = [str(run.folder), "no-control"]
    for trust in (False, True):
        compared = read_field(names, trust=trust)
        (task,) = compared.scenes
        with nullcontext() if trust else pytest.raises(PolicyError, match="with --trust"):
            rows, _ = entries(compared, task)
    assert [row.label for row in rows] == ["best constant", "own", "no-control"]
    written(tmp_path, LAW.replace("0.25", "0.5"))
    with pytest.raises(RunError, match="other settings"):
        train(settings, run, bar=False)
