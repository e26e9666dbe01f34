"""Does every command say what is wrong in a line or two, and leave a folder that can be used?

Each row is a command as a user types it. What goes wrong in the middle of a training is in
test_bad_conditions.py, kills are in test_runs.py.
"""

import io
import json
import os
import re
import resource
import signal
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import numpy as np
import optuna
import pytest
from pages import ROOT

from agents.__main__ import commands
from agents.__main__ import main as top
from agents.policies import network
from agents.sweeps.workers import _done
from agents.training.parts import base_controller
from agents.training.runs import Run
from mm_gym import files

TRAINING = {
    "lanes": 8,
    "steps": 160,
    "evaluations": 2,
    "ppo.rollout": 10,
    "ppo.batch_size": 40,
    "ppo.hidden": [8],
}
FLAGS = "--name a --lanes 8 --steps 160 --evaluations 2 --ppo.rollout 10 --ppo.batch-size 40"
SMALL = (
    "--name a --generations 2 --evaluations 1 --candidates 4 --episodes 2 --threads 1 --law none"
)
FEW = "--name a --iterations 2 --evaluations 1 --episodes 2 --hidden 4 --law none"
COARSE = "--name a --points 5 --stretches 5 --sizes 3 --sweeps 2 --evaluations 1 --threads 1"
COMMANDS = {
    "train": ["train", "CarriageForce", *FLAGS.split(), "--ppo.hidden", "8"],
    "evolve": ["evolve", "CarriageForce", *SMALL.split()],
    "descend": ["descend", "CarriageForce", *FEW.split()],
    "iterate": ["iterate", "PreStretchShock", *COARSE.split()],
    "tune": ["tune", "CarriageForce", "--trials", "1", *FLAGS.split()],
    "sweep": [
        *("sweep", "--tasks", "CarriageForce", "--name", "a", "--processes", "1"),
        *("--settings", json.dumps(TRAINING)),
    ],
    "evaluate": [
        *("evaluate", "mm_gym/CarriageForce-v0", "--controller", "law.py:Law"),
        *("--episodes", "5", "--out", "runs/a"),
    ],
    "export": ["export", "p.safetensors", "--out", "runs/p.onnx"],
}
WRITTEN = dict.fromkeys(
    ("train", "evolve", "descend", "iterate", "tune", "sweep"), "checkpoint.npz"
)
WRITTEN |= {"evaluate": "scores.csv", "export": "p.onnx"}

NEEDS = {"record": "minari", "tune": "optuna"}  # packages of extras that a command is imported with

LAW = """
class Law:
    def __init__(self, scene):
        pass
    def action(self, memory, state, applied):
        return -state[:, 2:3], memory
"""


def here(trials, _, report):
    """Do the trainings of a sweep in this process."""
    for number, trial in enumerate(trials):
        report(number, _done(*trial))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with a policy and a law; no other laws are tuned for reports."""
    monkeypatch.chdir(tmp_path)
    still = "no-control"
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda s: ([base_controller(s, still)], {})
    )
    monkeypatch.setattr("agents.commands.sweep.work_here", here)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    ends = np.ones(1, np.float32)
    network((np.ones((1, 4), np.float32),), (0.0 * ends,), "tanh", -ends, ends).save(
        "p.safetensors"
    )
    Path("law.py").write_text(LAW)
    return tmp_path


def call(monkeypatch, words):
    """Return the status with which a command exits."""
    monkeypatch.setattr("sys.argv", words)
    return import_module(f"agents.commands.{words[0]}").main()


BAD = [
    (["train", "bad.toml"], "bad.toml: stepz: unknown key; did you mean 'steps'?"),
    (["evolve", "bad.toml"], "bad.toml: stepz: unknown key; allowed: task, scene"),
    (["descend", "bad.toml"], "bad.toml: stepz: unknown key; allowed: task, scene"),
    (["iterate", "bad.toml"], "bad.toml: stepz: unknown key; allowed: task, scene"),
    (["iterate", "PreStretchNoise"], "excitation: got noise; allowed for value iteration: impulse"),
    (["tune", "bad.toml"], "bad.toml: stepz: unknown key; did you mean 'steps'?"),
    (["sweep", "bad.toml"], "bad.toml: stepz: unknown key; allowed: name, tasks"),
    (["export", "bad.toml"], "bad.toml: not a policy"),
    (["export", "runs"], "runs: no such file"),
    (["evaluate", "runs/absent"], "runs/absent: no run.json here; train first"),
    (["evaluate", "lqr", "lqrr"], "got 'lqrr'; did you mean 'lqr'"),
    (["train", "Hybrit"], "got 'Hybrit'; did you mean 'Hybrid'"),
    (["evolve", "Hybrit"], "got 'Hybrit'; did you mean 'Hybrid'"),
    (["tune", "Hybrit"], "got 'Hybrit'; did you mean 'Hybrid'"),
    (["headroom", "Hybrit"], "task: got 'Hybrit'; did you mean 'Hybrid'"),
    (["headroom", "--runs", "runs/absent"], "runs/absent: no finished run here"),
    (["ranking", "runs/absent"], "runs/absent: no finished run here"),
    (["controller_tables", "Hybrit"], "task: got 'Hybrit'; did you mean 'Hybrid'"),
    *(
        ([command, "HybridRobust"], "task: got 'HybridRobust'; did you mean 'Hybrid'")
        for command in ("headroom", "controller_tables", "sealed")
    ),
    (["structures", "--structures", "towr"], "structures: got 'towr'; did you mean 'tower'"),
    (["record", "Hybrit"], "got 'Hybrit'; did you mean 'Hybrid'"),
    (["record", "mine.toml"], "mine.toml: no such file"),
    (["results", "bad.toml"], "bad.toml: stepz: unknown key"),
    *(
        (["results", "--no-train", "--out", name], message)
        for name, message in (
            ("page.json", "--out: got 'page.json'; allowed: a name that ends in .md"),
            ("page", "--out: got 'page'; allowed: a name that ends in .md"),
            ("published.md", "published.md: cannot be written: it is named for two outputs"),
            ("p.safetensors/page.md", "p.safetensors/page.md: cannot be written: Not a directory"),
        )
    ),
    (["sweep", "--tasks", "Hybrit"], "did you mean 'Hybrid'"),
    (["sweep", "--settings", '{"stepz": 3}'], "stepz: unknown key; did you mean 'steps'?"),
]


@pytest.mark.parametrize(("words", "message"), BAD, ids=lambda value: " ".join(value)[:40])
def test_bad_configuration_is_named_with_the_nearest_and_nothing_is_written(
    words, message, folder, monkeypatch
):
    Path("bad.toml").write_text("stepz = 3\n")
    before = sorted(path.name for path in folder.iterdir())
    status = call(monkeypatch, words)
    assert status.startswith("error: ")
    assert message in status
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "nearest"),
    [
        ("train --stepz", "--steps"),
        ("evolve --generation", "--generations"),
        ("descend --iteration", "--iterations"),
        ("iterate --sweep", "--sweeps"),
        ("tune --trialz", "--trials"),
        ("sweep --seedz", "--seeds"),
        ("evaluate lqr --episode", "--episodes"),
        ("export p.safetensors --ou", "--out"),
    ],
)
def test_unknown_flag_is_refused_with_the_nearest(words, nearest, monkeypatch, capsys):
    with pytest.raises(SystemExit) as caught:
        call(monkeypatch, [*words.split(), "3"])
    assert caught.value.code == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"Unrecognized options: {words.split()[-1]}" in said
    assert f" {nearest} " in said
    assert not Path("runs").exists()


EVERY = sorted(name.replace("-", "_") for name in commands())


@pytest.mark.parametrize("command", EVERY)
def test_help_is_printed_and_nothing_else_is_done(command, folder, monkeypatch, capsys):
    if command in NEEDS:
        pytest.importorskip(NEEDS[command])

    def write(*_):
        raise AssertionError

    monkeypatch.setattr(files, "_replace", write)
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit) as caught:
        call(monkeypatch, [command, "--help"])
    assert caught.value.code == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("usage: ")
    title = import_module(f"agents.commands.{command}").__doc__.split()[:3]
    assert " ".join(title) in " ".join(printed.out.split())
    assert not printed.err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("words", ["agents headroom Hybrit", "agents.headroom Hybrit"])
def test_error_ends_with_the_status_of_a_wrong_flag_and_no_traceback(words):
    done = subprocess.run(
        [sys.executable, "-m", *words.split()],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "error: " in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_commands_are_listed_with_what_they_do(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["agents"])
    top()
    printed = capsys.readouterr().out
    for name in EVERY:
        first = import_module(f"agents.commands.{name}").__doc__.splitlines()[0]
        assert re.search(
            rf"^  {name.replace('_', '-')} +{re.escape(first)}$".replace("``", ""),
            printed,
            re.MULTILINE,
        )


def test_version_is_that_of_the_package(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["agents", "--version"])
    top()
    assert capsys.readouterr().out == f"mm-gym {version('mm-gym')}\n"


def test_ctrl_c_while_a_command_is_imported_is_one_line(monkeypatch, capsys):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.__main__.import_module", interrupted)
    monkeypatch.setattr("sys.argv", ["agents", "sweep"])
    with pytest.raises(SystemExit) as caught:
        top()
    assert caught.value.code == 130
    assert capsys.readouterr().err == "interrupted: give the same command again\n"


def test_unknown_command_is_refused_with_the_nearest(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["agents", "trian"])
    with pytest.raises(SystemExit) as caught:
        top()
    assert caught.value.code == 2
    assert "got 'trian'; did you mean 'train'?" in capsys.readouterr().err


def test_tasks_and_the_controllers_of_one_are_listed(monkeypatch, capsys):
    for words, line in ((["list"], "Hybrid  "), (["list", "Hybrid"], "lqr-and-clipped-lqr\n")):
        assert call(monkeypatch, words) is None
        assert line in capsys.readouterr().out


def test_wrong_task_of_a_flag_is_refused_with_the_nearest(monkeypatch, capsys):
    with pytest.raises(SystemExit) as caught:
        call(monkeypatch, ["train", "--task", "Hybrit"])
    assert caught.value.code == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "task: got 'Hybrit'; did you mean" in said


@pytest.mark.parametrize("command", COMMANDS)
def test_folder_that_cannot_be_written_to_is_named(command, monkeypatch):
    Path("runs").write_text("a file")
    status = call(monkeypatch, COMMANDS[command])
    assert status.startswith("error: runs/")
    assert "cannot be" in status
    assert Path("runs").read_text() == "a file"


@pytest.mark.parametrize("command", COMMANDS)
def test_full_disk_is_named_and_the_same_command_works_when_there_is_room(command, monkeypatch):
    replace = files._replace

    def full(target, content):
        if target.name == WRITTEN[command]:
            raise OSError(28, "No space left on device")
        replace(target, content)

    if command == "export":
        pytest.importorskip("onnx")
    with monkeypatch.context() as patch:
        patch.setattr(files, "_replace", full)
        status = call(patch, COMMANDS[command])
    assert f"{WRITTEN[command]}: cannot be written: No space left on device" in status
    assert len(status.splitlines()) <= 2
    assert call(monkeypatch, COMMANDS[command]) is None
    assert list(Path("runs").rglob(WRITTEN[command]))


def test_disk_that_is_too_full_for_a_study_is_named_in_one_line(monkeypatch):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        status = call(monkeypatch, COMMANDS["tune"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    first, second = status.splitlines()
    assert first.startswith("error: study.db: (sqlite3.OperationalError)")
    assert second == "the same command continues when this is mended"
    assert call(monkeypatch, COMMANDS["tune"]) is None


def test_name_that_the_output_cannot_show_is_one_message(monkeypatch):
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    status = call(monkeypatch, ["export", "p.safetensors", "--out", "größe.c"])
    assert status.startswith("error: 'ascii' codec can't encode")


def test_want_of_memory_is_one_message(monkeypatch):
    def starved(*_, **__):
        msg = "Unable to allocate 46.9 PiB"  # as NumPy says it
        raise MemoryError(msg)

    monkeypatch.setattr("agents.commands.evaluate.evaluate", starved)
    assert call(monkeypatch, COMMANDS["evaluate"]) == "error: Unable to allocate 46.9 PiB"


INTERRUPTED = {
    "train": "agents.training.reinforcement.Reinforcement._advance",
    "evolve": "agents.evolution.search.Evolution._advance",
    "descend": "agents.gradient.descent.Descent._advance",
    "iterate": "agents.value_iteration.iteration.ValueIteration._advance",
    "tune": "agents.training.reinforcement.Reinforcement._advance",
    "sweep": "agents.commands.sweep.work_here",
    "evaluate": "agents.commands.evaluate.evaluate",
}


@pytest.mark.parametrize("command", INTERRUPTED)
def test_ctrl_c_is_one_line_and_the_same_command_goes_on(command, monkeypatch, capsys):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(INTERRUPTED[command], interrupt)
        assert call(patch, COMMANDS[command]) == 130
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith(("interrupted: ", "interrupted after "))
    assert "give the same command again" in line
    assert call(monkeypatch, COMMANDS[command]) is None


@pytest.mark.parametrize("command", ["train", "evolve", "descend", "iterate", "sweep"])
def test_second_run_of_a_name_is_refused(command, monkeypatch):
    with Run("a").locked():
        status = call(monkeypatch, COMMANDS[command])
    assert status.startswith(f"error: runs/a: process {os.getpid()} on ")
    assert "wait for its end, or choose another name with --name" in status
    assert sorted(path.name for path in Path("runs/a").iterdir()) == [".lock"]


@pytest.mark.parametrize(
    ("command", "module", "extra"),
    [("evolve", "cma", "evolve"), ("export", "onnx", "onnx")],
)
def test_missing_extra_is_named_and_nothing_is_written(command, module, extra, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    assert f"install the extra `{extra}`" in call(monkeypatch, COMMANDS[command])
    assert not Path("runs").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_command_without_the_packages_of_agents_says_so_in_one_line(command):
    # Without site-packages, as where nothing but Python is installed.
    done = subprocess.run(
        [sys.executable, "-S", "-m", "agents", command],
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: control, filelock, jinja2, rich, stable_baselines3")
    assert line.endswith("not installed; install the extra `agents`")
