"""Is a run's folder usable, and the message clear, whatever the machine does to a training?"""

import resource
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest

from agents.commands import train as command
from agents.training import search
from agents.training.arrays import load_checkpoint
from agents.training.config import TrainSettings
from agents.training.lanes import TrainingLanes
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError

SMALL = TrainSettings(
    task="mm_gym/CarriageForce-v0",
    name="small",
    lanes=8,
    steps=800,
    evaluations=8,
    ppo={"rollout": 10, "batch_size": 40, "hidden": (8,)},
)
ARGUMENTS = [
    *("CarriageForce", "--name", "small", "--lanes", "8", "--steps", "800", "--evaluations", "8"),
    *("--ppo.rollout", "10", "--ppo.batch-size", "40", "--ppo.hidden", "8"),
    *("--ppo.reward-scale", "0.05"),  # the default, which the task's file has not
]


def whole(folder):
    run = Run("small", folder)
    train(SMALL, run, bar=False)
    return run


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return whole(tmp_path_factory.mktemp("runs"))


def assert_continues(run, other):
    """The folder is usable: a training goes on in it, and ends as one that had no trouble."""
    train(SMALL, run, bar=False)
    assert run.policy.read_bytes() == other.policy.read_bytes()
    assert run.metrics.read_text() == other.metrics.read_text()


def test_full_disk_is_named_and_the_run_continues_when_there_is_room(
    uninterrupted, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["train", *ARGUMENTS])
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = len(uninterrupted.checkpoint.read_bytes()) // 2
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
    try:
        error = command.main()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert error.startswith("error: runs/small/checkpoint.npz: cannot be written: File too large")
    assert "runs/small: its last checkpoint is whole" in error
    run = Run("small", tmp_path / "runs")
    assert not list(run.folder.glob(".checkpoint*"))  # no part of a file is left
    assert_continues(run, uninterrupted)


def test_disk_that_fills_up_in_the_middle_keeps_the_last_checkpoint(
    uninterrupted, tmp_path, monkeypatch
):
    run, left = Run("small", tmp_path), 3
    save = search.save_checkpoint

    def fill(path, arrays):
        nonlocal left
        left -= 1
        if left == 0:
            raise OSError(28, "No space left on device", str(path))
        save(path, arrays)

    with monkeypatch.context() as patch:
        patch.setattr(search, "save_checkpoint", fill)
        with pytest.raises(OSError, match="No space left"):
            train(SMALL, run, bar=False)
    assert int(load_checkpoint(run.checkpoint)["model/steps"]) == 240
    assert_continues(run, uninterrupted)


def test_missing_extra_is_named_before_a_folder_is_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    monkeypatch.setattr("sys.argv", ["train", *ARGUMENTS[:9], "--algorithm", "tqc"])
    assert command.main() == (
        "error: algorithm 'tqc' needs sb3-contrib: install the extra `contrib`"
    )
    assert not Path("runs").exists()


def test_missing_optuna_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.delitem(sys.modules, "agents.commands.tune", raising=False)
    with pytest.raises(SystemExit) as caught:
        import_module("agents.commands.tune")
    said = "error: tune needs Optuna: install the extra `tune`"
    assert (caught.value.code, capsys.readouterr().err) == (2, f"{said}\n")


@pytest.mark.usefixtures("ctrl_c")
def test_second_ctrl_c_does_not_wait(tmp_path, monkeypatch):
    settings = TrainSettings(
        task=SMALL.task, name="small", lanes=8, steps=800, algorithm="sac", evaluations=1
    )
    step, left = TrainingLanes.step_wait, 3

    def interrupt(lanes):
        nonlocal left
        left -= 1
        if left == 0:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            msg = "the second signal was not delivered"
            raise AssertionError(msg)
        return step(lanes)

    monkeypatch.setattr(TrainingLanes, "step_wait", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train(settings, Run("small", tmp_path), bar=False)


def test_checkpoint_of_another_algorithm_is_refused(uninterrupted, tmp_path):
    run = Run("small", tmp_path)
    run.folder.mkdir()
    run.checkpoint.write_bytes(uninterrupted.checkpoint.read_bytes())
    other = SMALL.model_copy(update={"algorithm": "sac"})
    with pytest.raises(RunError, match=r"checkpoint\.npz: not a checkpoint"):
        train(other, run, bar=False)


def test_every_flag_of_an_algorithm_is_typed_and_unknown_ones_are_refused(capsys, monkeypatch):
    for words, text in (
        (["--sac.tau", "fast"], "fast"),
        (["--sac.tao", "0.1"], "--sac.tau"),
        (["--algorithm", "sak"], "sac"),
    ):
        monkeypatch.setattr("sys.argv", ["train", "Hybrid", *words])
        with pytest.raises(SystemExit) as caught:
            command.main()
        assert caught.value.code == 2
        shown = capsys.readouterr()
        assert text in shown.err + shown.out
