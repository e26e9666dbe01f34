"""Searches of settings: studies of Optuna in SQLite that end after any kill as if without one.

A trial's settings depend on the study's seed, its place among the trials, and what was completed
before it. So one that a killed process was busy with is repeated at its place, and processes that
work on one study never draw the same.
"""

import ctypes
import os
import platform
import sqlite3
import sys
import warnings
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import optuna
from optuna import Study, Trial
from optuna.distributions import BaseDistribution
from optuna.samplers import TPESampler
from optuna.storages import RDBStorage, RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

from agents.training.config import OffPolicySettings, PPOSettings, TrainSettings
from agents.training.runs import RunError
from mm_gym import SceneError
from mm_gym.files import read_beginning
from mm_gym.scene import toml_block

HEARTBEAT, GRACE = 15, 60
"""Seconds between two signs of life of a trial, and without one after which it is repeated."""

MOST_REPETITIONS = 100
"""Of one trial, so that one which no machine has room for is given up at last."""

MAGIC = b"SQLite format 3\0"  # first bytes of a database
ASIDE = ("-journal", "-wal", "-shm")  # endings of the files that SQLite reads with a database

SYNCHRONIZE, ACCESS_DENIED = 0x100000, 5
"""Of Windows: the right to wait for a process, and the error of one that is another user's."""

PROCESS = "process"
"""Attribute of a trial: the machine and the number of the process that is busy with it."""


def open_study(name: str, folder: Path, seed: int) -> Study:
    """Open the study in a folder, or begin it; repeat trials whose process is dead.

    Raise `RunError` if there is something else in the place of its file, or it is damaged.
    """
    _check_database(folder / "study.db")
    repeat = _repetition()
    with _without_warnings():
        storage = RDBStorage(
            f"sqlite:///{(folder / 'study.db').resolve()}",
            heartbeat_interval=HEARTBEAT,
            grace_period=GRACE,
            heartbeat_stale_trial_callback=repeat,
        )
    study = optuna.create_study(
        study_name=name,
        storage=storage,
        load_if_exists=True,
        sampler=ByPlace(seed),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=5),
    )
    for trial in study.get_trials(states=(TrialState.RUNNING,)):
        if is_dead(*trial.user_attrs.get(PROCESS, ("", 0))):
            try:
                study.tell(trial.number, state=TrialState.FAIL)
            except (ValueError, optuna.exceptions.UpdateFinishedTrialError):
                continue  # another process has, and repeats it
            repeat(study, trial)
    return study


def _check_database(file: Path) -> None:
    """Raise `RunError` unless there is no file, or a whole one of SQLite's."""
    if not os.path.lexists(file):
        return
    try:
        if read_beginning(file, len(MAGIC)) not in {b"", MAGIC}:  # empty: begun, then killed
            msg = f"{file}: not a study: not a file of SQLite"
            raise RunError(msg)
        for ending in ASIDE:
            if os.path.lexists(f"{file}{ending}"):
                read_beginning(f"{file}{ending}", 0)
        with closing(sqlite3.connect(file, timeout=GRACE)) as database:
            (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
            (page,) = database.execute("PRAGMA page_size").fetchone()
    except (SceneError, sqlite3.Error) as error:
        msg = str(error) if isinstance(error, SceneError) else f"{file}: not a study: {error}"
        raise RunError(msg) from None
    if found == "ok" and file.stat().st_size % page:
        found = "its end is missing"  # SQLite takes zeros for it
    if found != "ok":
        msg = f"{file}: not a study: damaged: {found.splitlines()[0]}"
        raise RunError(msg)


def begin(trial: Trial) -> int:
    """Note which process is busy with a trial; return its place."""
    trial.set_user_attr(PROCESS, (platform.node(), os.getpid()))
    return place_of(trial.study, frozen(trial))


def repeat_later(trial: Trial) -> None:
    """Let a trial that is about to fail be repeated."""
    _repetition()(trial.study, frozen(trial))


def place_of(study: Study, trial: FrozenTrial) -> int:
    """Return the number that a trial would have if none had been repeated."""
    first = _first(trial)
    trials = study.get_trials(deepcopy=False)
    return sum(_first(other) == other.number for other in trials[:first])


def frozen(trial: Trial) -> FrozenTrial:
    """Return a trial with all that is known of it."""
    return trial.study.get_trials(deepcopy=False)[trial.number]


class ByPlace(TPESampler):
    """Optuna's tree-structured Parzen estimator, its random numbers by seed, place and name."""

    def __init__(self, seed: int) -> None:
        super().__init__(multivariate=False)  # every parameter is drawn by itself
        self.seed = seed

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:  # noqa: ANN401 - Optuna's
        """Draw a parameter."""
        words = f"{self.seed} {place_of(study, trial)} {param_name}"
        estimator = TPESampler(seed=zlib.crc32(words.encode()))
        return estimator.sample_independent(study, trial, param_name, param_distribution)


def _repetition() -> RetryHeartbeatStaleTrialCallback:
    """Return what appends a trial again, with its settings and the validations so far."""
    with _without_warnings():
        return RetryHeartbeatStaleTrialCallback(MOST_REPETITIONS, inherit_intermediate_values=True)


def _first(trial: FrozenTrial) -> int:
    """Return the number of the trial of which this one is a repetition, or its own."""
    with _without_warnings():
        number = RetryHeartbeatStaleTrialCallback.retried_trial_number(trial)
    return trial.number if number is None else number


def is_dead(machine: str, number: int) -> bool:
    """Tell whether a process was on this machine and is no more."""
    if machine != platform.node():
        return False
    if number == os.getpid():  # a number that is used again
        return True
    if sys.platform == "win32":
        return _is_dead_on_windows(number)
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        pass
    return False


def _is_dead_on_windows(number: int) -> bool:
    """Tell the same where signal 0 is Ctrl+C, not a question."""
    kernel = ctypes.WinDLL("kernel32", use_last_error=True)
    process = kernel.OpenProcess(SYNCHRONIZE, False, number)
    if not process:
        return ctypes.get_last_error() != ACCESS_DENIED
    is_over = kernel.WaitForSingleObject(process, 0) == 0
    kernel.CloseHandle(process)
    return is_over


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Keep Optuna from calling heartbeats experimental, as it does since its version 2.8."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        yield


LAYERS = {"32 x 32": (32, 32), "64 x 64": (64, 64), "128 x 128": (128, 128), "256": (256,)}

RUN = ("name", "seed", "threads")
"""Settings that a file of settings leaves out: they are a run's own."""


def suggested(trial: Trial, settings: TrainSettings, name: str) -> TrainSettings:
    """Return the settings that a trial tries, under the name of its run."""
    chosen = settings.chosen
    reward = chosen.reward_scale * trial.suggest_float("reward", 0.1, 10.0, log=True)
    own: dict[str, Any] = {
        "learning_rate": _short(trial.suggest_float("learning_rate", 1e-4, 1e-2, log=True)),
        "discount": round(1.0 - trial.suggest_float("1 - discount", 5e-3, 0.2, log=True), 4),
        "hidden": LAYERS[trial.suggest_categorical("hidden", list(LAYERS))],
        "reward_scale": _short(reward),
    }
    if isinstance(chosen, PPOSettings):
        own |= {
            "rollout": trial.suggest_categorical("rollout", [25, 50, 100, 200]),
            "epochs": trial.suggest_int("epochs", 3, 15),
            "gae_lambda": _short(trial.suggest_float("gae_lambda", 0.8, 0.99)),
            "initial_log_std": _short(trial.suggest_float("initial_log_std", -2.0, 0.5)),
        }
        parts = trial.suggest_categorical("batches", [2, 4, 8, 16, 32])
        samples = settings.lanes * own["rollout"]
        sizes = range(max(2, samples // parts), samples + 1)
        own["batch_size"] = next(size for size in sizes if samples % size == 0)
    if isinstance(chosen, OffPolicySettings):
        own |= {
            "gradient_steps": trial.suggest_int("gradient_steps", 1, 16, log=True),
            "batch_size": trial.suggest_categorical("batch_size", [128, 256, 512]),
        }
    if "tau" in type(chosen).model_fields:
        own["tau"] = _short(trial.suggest_float("tau", 2e-3, 5e-2, log=True))
    data = plain(settings)
    data[settings.algorithm] |= own
    if settings.scene is None:  # an own scene is always normalised
        data["normalise_observations"] = trial.suggest_categorical(
            "normalise_observations", [False, True]
        )
    if settings.base is not None:
        data["authority"] = _short(trial.suggest_float("authority", 0.1, 1.0))
    return TrainSettings.of(data | {"name": name})


def _short(value: float) -> float:
    """Return a value with three digits, which a file can hold and no training tells from it."""
    return float(f"{value:.3g}")


def plain(settings: TrainSettings) -> dict[str, Any]:
    """Return the settings of a training alone, whatever a subclass adds, as data."""
    return settings.model_dump(include=set(TrainSettings.model_fields))


def as_toml(settings: TrainSettings, comment: str, name: str) -> str:
    """Return a file like those of `configs/agents`: what differs from the defaults.

    Parameters
    ----------
    comment
        Its first lines.
    name
        The name of its runs.
    """
    default, data = TrainSettings().model_dump(), plain(settings)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    top: dict[str, Any] = {"task": settings.task, "name": name}
    tables: list[str] = []
    for key, value in data.items():
        if key == "task" or key in RUN or value == default[key]:
            continue
        if not isinstance(value, dict):
            top[key] = value
        elif key in ("changes", settings.algorithm):
            own = {k: v for k, v in value.items() if v != default[key].get(k)}
            tables.append(toml_block(f"[{key}]", own))
    return "\n".join([head + toml_block("", top), *tables])
