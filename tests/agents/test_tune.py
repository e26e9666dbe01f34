"""Does tuning go on after a kill, prune, and write files that train?"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import optuna
import pytest

from agents import tune as command
from agents.training.config import TrainSettings, read_settings
from agents.training.runs import RunError
from agents.training.search_space import as_toml, suggested
from agents.tune import TuneSettings, tune

ROOT = Path(__file__).parents[2]
QUICK = TuneSettings(
    task="mm_gym/CarriageForce-v0", name="quick", lanes=8, steps=800, evaluations=2, trials=2
)


@pytest.fixture(autouse=True)
def quiet():
    optuna.logging.set_verbosity(optuna.logging.ERROR)


def study_of(folder):
    return optuna.load_study(study_name=None, storage=f"sqlite:///{folder}/study.db")


def test_best_trial_is_a_file_of_settings_and_more_trials_go_on(tmp_path):
    path = tune(QUICK, tmp_path)
    study = study_of(path.parent)
    assert len(study.trials) == 2
    best = read_settings(path, TrainSettings)
    assert (best.task, best.name, best.steps) == (QUICK.task, "quick", 800)
    assert best.ppo.learning_rate == study.best_params["learning_rate"]
    metrics = np.loadtxt(
        path.parent / f"trial-{study.best_trial.number}" / "metrics.csv",
        delimiter=",",
        skiprows=1,
        ndmin=2,
    )
    assert metrics[:, 1].min() == study.best_value
    tune(QUICK.model_copy(update={"trials": 3}), tmp_path)
    assert len(study_of(path.parent).trials) == 3
    with pytest.raises(RunError, match="holds a study of other settings"):
        tune(QUICK.model_copy(update={"steps": 801}), tmp_path)


def test_killed_trial_goes_on_from_its_checkpoint(tmp_path):
    code = (
        "import sys; from pathlib import Path; from agents.tune import TuneSettings, tune; "
        f"tune(TuneSettings(**{SLOW.model_dump()!r}), Path(sys.argv[1]))"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    arguments = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(
        arguments, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL
    ) as process:
        checkpoint = tmp_path / "slow" / "trial-0" / "checkpoint.npz"
        while not checkpoint.exists():
            time.sleep(0.02)
            assert process.poll() is None
        process.send_signal(signal.SIGKILL)
    killed = (checkpoint.parent / "metrics.csv").read_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "GRACE", 1)
        patch.setattr(command, "HEARTBEAT", 1)
        time.sleep(2.0)
        tune(SLOW, tmp_path)
    states = [trial.state.name for trial in study_of(tmp_path / "slow").trials]
    assert states == ["FAIL", "COMPLETE"]
    assert not (tmp_path / "slow" / "trial-1").exists()
    metrics = (checkpoint.parent / "metrics.csv").read_text()
    assert metrics.startswith(killed)
    assert len(metrics) > len(killed)


SLOW = QUICK.model_copy(update={"name": "slow", "steps": 4800, "evaluations": 6, "trials": 1})


def test_trial_behind_the_median_is_pruned(tmp_path, monkeypatch):
    monkeypatch.setattr(optuna.Trial, "should_prune", lambda trial: trial.number == 1)
    path = tune(QUICK, tmp_path)
    assert [trial.state.name for trial in study_of(path.parent).trials] == ["COMPLETE", "PRUNED"]


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "crossq", "recurrent_ppo"])
def test_every_suggestion_is_a_file_of_settings(algorithm, tmp_path):
    settings = TuneSettings(algorithm=algorithm, base="lqr", changes={"control.steps": 50})
    trial = optuna.create_study().ask()
    own = suggested(trial, settings, "trial-0")
    file = tmp_path / "own.toml"
    file.write_text(as_toml(own, "A comment.", "own"))
    read = read_settings(file, TrainSettings)
    assert read == own.model_copy(update={"name": "own"})
    assert read.chosen != TrainSettings(algorithm=algorithm).chosen
