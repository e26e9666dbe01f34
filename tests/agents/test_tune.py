"""Does tuning go on after a kill, prune, and write files that train?"""

import ctypes
import itertools
import os
import platform
import re
import signal
import subprocess
import sys
from unittest import mock

import kills
import numpy as np
import optuna
import pytest

from agents.commands import tune as command
from agents.commands.tune import TuneSettings, shortened, tune
from agents.training import studies
from agents.training.config import TrainSettings, read_settings
from agents.training.progress import Ending
from agents.training.reinforcement import train
from agents.training.runs import DivergedError, Run, RunError
from agents.training.studies import as_toml, is_dead, suggested
from mm_gym import ActionError, SceneError, SimulationError

QUICK = TuneSettings(
    task="mm_gym/CarriageForce-v0", name="quick", lanes=8, steps=800, evaluations=2, trials=2
)


@pytest.fixture(autouse=True)
def quiet():
    optuna.logging.set_verbosity(optuna.logging.ERROR)


def ended():
    """Return the number of a process that is no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_process_of_a_trial_is_alive_or_dead():
    here = platform.node()
    assert is_dead(here, ended())
    assert is_dead(here, os.getpid())  # its number is used again
    assert not is_dead(here, os.getppid())
    assert not is_dead("elsewhere", ended())


@pytest.mark.parametrize(
    ("opened", "error", "ended", "want"),
    [(0, 87, None, True), (0, 5, None, False), (7, 0, 0, True), (7, 0, 258, False)],
)
def test_no_signal_is_sent_on_windows(opened, error, ended, want, monkeypatch):
    kernel = mock.Mock()
    kernel.OpenProcess.return_value, kernel.WaitForSingleObject.return_value = opened, ended
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("a signal is sent"))
    monkeypatch.setattr(ctypes, "WinDLL", lambda *_, **__: kernel, raising=False)
    monkeypatch.setattr(ctypes, "get_last_error", lambda: error, raising=False)
    assert is_dead(platform.node(), os.getppid()) == want
    assert kernel.CloseHandle.called == bool(opened)


def study_of(folder):
    return optuna.load_study(study_name=None, storage=f"sqlite:///{folder}/study.db")


def test_trainings_that_their_time_ended_are_told(tmp_path):
    assert shortened(tmp_path) == []
    costs = {"cost": 0.5, "began_with": 0.6, "no_control": 0.7, "began_as": "a law"}
    for number, (done, budget) in enumerate([(9000, None), (2000, 3.0), (1000, 3.0)]):
        counted = {"unit": "control step", "done": done, "total": 9000}
        Ending(**counted, time_budget=budget, **costs).write(Run(f"trial-{number}", tmp_path))
    (told,) = shortened(tmp_path)
    assert told.startswith("2 of 3 trainings were ended by their time budget of 3 s, ")
    assert told.endswith("the first after 1,000 of 9,000 control steps")


def test_best_trial_is_a_file_of_settings_and_more_trials_go_on(tmp_path):
    path = tune(QUICK, tmp_path)
    study = study_of(path.parent)
    assert len(study.trials) == 2
    best = read_settings(path, TrainSettings)
    assert (best.task, best.name, best.steps) == (QUICK.task, "quick", 800)
    assert best.ppo.learning_rate == float(f"{study.best_params['learning_rate']:.3g}")
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


def test_base_that_there_is_not_leaves_no_study(tmp_path):
    with pytest.raises(SceneError, match="base: got 'lqrr'; did you mean 'lqr'"):
        tune(QUICK.model_copy(update={"base": "lqrr"}), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("lanes", [1, 8, 13])
def test_batches_divide_the_rollout(lanes):
    drawn = {"reward": 1.0, "learning_rate": 1e-3, "1 - discount": 0.01, "hidden": "64 x 64"}
    drawn |= {"epochs": 5, "gae_lambda": 0.95, "initial_log_std": -1.0}
    drawn |= {"normalise_observations": False}
    for rollout, batches in itertools.product([25, 50, 100, 200], [2, 4, 8, 16, 32]):
        trial = optuna.trial.FixedTrial(drawn | {"rollout": rollout, "batches": batches})
        tried = suggested(trial, QUICK.model_copy(update={"lanes": lanes}), "trial-0").ppo
        assert tried.batch_size > 1
        assert lanes * rollout % tried.batch_size == 0
        assert tried.batch_size >= lanes * rollout // batches


def outcome(folder):
    """Return all that a study found out, without times."""
    files = [folder / "best.toml", *sorted(folder.glob("trial-*/metrics.csv"))]
    return {path.relative_to(folder): path.read_text() for path in files}


@pytest.mark.parametrize("wanted", [1, 10])
def test_study_killed_at_random_instants_ends_as_if_uninterrupted(wanted, tmp_path):
    settings = QUICK.model_copy(update={"trials": 1 + wanted // 2, "evaluations": 4})
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    tune(settings, whole)
    draw, killed = np.random.default_rng(wanted), 0
    while killed < wanted:
        # Just before a file is touched, where most could go wrong.
        process = kills.begin_tuning(settings, broken, int(draw.integers(12, 40)))
        process.join()
        assert process.exitcode == -signal.SIGKILL
        killed += 1
    tune(settings, broken)
    states = [trial.state.name for trial in study_of(broken / "quick").trials]
    assert "RUNNING" not in states
    assert outcome(broken / "quick") == outcome(whole / "quick")
    assert 0 < states.count("FAIL") <= wanted
    assert len(states) - states.count("FAIL") == settings.trials


def test_trial_of_a_dead_process_is_repeated_by_one_of_two(tmp_path, monkeypatch):
    study = studies.open_study("quick", tmp_path, 0)
    with pytest.warns(UserWarning, match="Heartbeat"):
        number = study.ask().number

    def dead(*_):  # and meanwhile another process finds it too
        study.tell(number, state=optuna.trial.TrialState.FAIL)
        return True

    monkeypatch.setattr(studies, "is_dead", dead)
    again = studies.open_study("quick", tmp_path, 0)
    assert [trial.state.name for trial in again.trials] == ["FAIL"]


def test_trial_behind_the_median_is_pruned(tmp_path, monkeypatch):
    monkeypatch.setattr(optuna.Trial, "should_prune", lambda trial: trial.number == 1)
    path = tune(QUICK, tmp_path)
    assert [trial.state.name for trial in study_of(path.parent).trials] == ["COMPLETE", "PRUNED"]


def test_trial_that_diverges_is_pruned_and_the_others_go_on(tmp_path, monkeypatch):
    def diverges(settings, run, **given):
        if run.folder.name == "trial-0":
            raise error
        train(settings, run, **given)

    monkeypatch.setattr(command, "train", diverges)
    for error in (DivergedError("diverged"), ActionError("nan"), SimulationError("lost")):
        root = tmp_path / type(error).__name__
        states = [trial.state.name for trial in study_of(tune(QUICK, root).parent).trials]
        assert states == ["PRUNED", "COMPLETE"]
    with pytest.raises(RunError, match="quick: none of 1 trials has a cost: lost"):
        tune(QUICK.model_copy(update={"trials": 1}), tmp_path / "none")


def test_validations_of_trials_with_other_rollouts_are_compared(tmp_path):
    path = tune(QUICK.model_copy(update={"trials": 4}), tmp_path)
    trials = study_of(path.parent).trials
    assert len({trial.params["rollout"] for trial in trials}) > 1
    for trial in trials:
        # A rollout of 8 lanes has 200 to 1600 steps, of 800: the last validation always is there.
        assert set(trial.intermediate_values) in ({1, 2}, {2})


def test_best_file_says_the_command_and_is_written_plainly(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["tune", "CarriageForce", "--name", "a b"])
    changes = {"control.steps": 20}
    text = tune(QUICK.model_copy(update={"changes": changes}), tmp_path).read_text()
    assert re.match(r"# Validation cost [\d.]+, the best of 2 trials:\n# python -m agents", text)
    assert "\n# python -m agents tune CarriageForce --name 'a b'\ntask = " in text
    assert re.search(r"\nlearning_rate = 0\.0*[1-9]\d{0,2}\n", text)
    assert '\n"control.steps" = 20\n' in text


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "crossq", "recurrent_ppo"])
def test_every_suggestion_is_a_file_of_settings(algorithm, tmp_path):
    changes = {
        "control.steps": 50,
        "sensors.noise": {"carriage_displacement": 1e-5},
        "excitation": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 2.0}],
    }
    settings = TuneSettings(algorithm=algorithm, base="lqr", changes=changes)
    trial = optuna.create_study().ask()
    own = suggested(trial, settings, "trial-0")
    file = tmp_path / "own.toml"
    file.write_text(as_toml(own, "A comment.", "own"))
    read = read_settings(file, TrainSettings)
    assert read == own.model_copy(update={"name": "own"})
    assert read.chosen != TrainSettings(algorithm=algorithm).chosen
    assert {"normalise_observations", "authority"} <= trial.params.keys()


def test_normalisation_is_not_searched_where_it_is_always_on():
    trial = optuna.create_study().ask()
    suggested(trial, TuneSettings(scene="configs/structures/frame.toml"), "trial-0")
    assert "normalise_observations" not in trial.params
