"""Search the settings of an algorithm with Optuna.

For example ``python -m agents tune PreStretch --trials 50 --steps 500000 --name tuned``. All flags
of ``python -m agents train`` are allowed, and apply to every trial.

The study is ``runs/NAME/study.db``, and each trial's run folder is next to it; ``best.toml``
there is the best so far, a file like those of ``configs/agents``. After a kill or Ctrl-C the
same command continues, from the checkpoint of the trial that was running. Several processes of it
share the trials.
"""

from __future__ import annotations

import logging
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from agents.errors import command, leave
from agents.training.config import Count, TrainSettings
from agents.training.parts import make_parts
from agents.training.progress import read_ending, told_part
from agents.training.reinforcement import train
from agents.training.runs import DivergedError, Run, RunError
from mm_gym import ActionError, SimulationError
from mm_gym.files import write_text

try:
    import optuna
    from optuna.trial import TrialState
    from sqlalchemy.exc import SQLAlchemyError

    from agents.training.studies import as_toml, begin, frozen, open_study, repeat_later, suggested
except ImportError:
    msg = "error: tune needs Optuna: install the extra `tune`"
    leave(msg)

if TYPE_CHECKING:
    from optuna import Study, Trial


OVER = (TrialState.COMPLETE, TrialState.PRUNED)

# `main` says what ended a trial; Optuna would also log it with its traceback.
logging.getLogger("optuna.study._optimize").addFilter(lambda line: line.levelno < logging.WARNING)


WHY = "why"  # attribute of a trial that diverged


class TuneSettings(TrainSettings):
    """What every trial has in common, and how many there are."""

    trials: Count = 50
    """that end or are pruned, over all processes and starts"""

    folder: ClassVar[str | None] = None  # what was found before is no part of the search


@command
def main(settings: TuneSettings) -> str | None:
    """Tune from the command line."""
    try:
        path = tune(settings)
    except (OSError, optuna.exceptions.StorageInternalError, SQLAlchemyError) as error:
        return f"error: {_in_one_line(error)}\nthe same command continues when this is mended"
    print(f"written: {path}", *shortened(path.parent), sep="\n")
    return None


def shortened(folder: Path) -> list[str]:
    """Return what is told of a study's trainings that their time budget ended, none or one line."""
    runs = [Run(path.name, folder) for path in sorted(folder.glob("trial-*"))]
    endings = [ending for run in runs if (ending := read_ending(run)) is not None]
    early = [ending for ending in endings if ending.time_budget is not None]
    if not early:
        return []
    first = min(early, key=lambda ending: ending.done)
    budget = f"their time budget of {first.time_budget:g} s"
    part = told_part(first.done, first.total, first.unit)
    return [f"{len(early)} of {len(endings)} trainings were ended by {budget}, the first {part}"]


def _in_one_line(error: BaseException) -> str:
    """Return what SQLite said, where it is the cause; its messages also have the statement."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, SQLAlchemyError):
        cause = cause.__cause__
    return str(error) if cause is None else f"study.db: {cause.args[0]}"


def tune(settings: TuneSettings, root: Path = Path("runs")) -> Path:
    """Try settings until there are enough trials; return the path of the best ones' file.

    Raise `SceneError` or `CompileError` if there is nothing to train on, or no such base; no folder
    is made then. Raise `RunError` if the folder cannot be made, or holds a study of other settings,
    or no trial comes to a cost.
    """
    make_parts(settings)
    folder = root / settings.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"{folder}: cannot be the folder of a study: {error}"
        raise RunError(msg) from error
    study = open_study(settings.name, folder, settings.seed)
    own = settings.model_dump_json(exclude={"trials"})
    if study.user_attrs.setdefault("settings", own) != own:
        msg = f"{folder}: holds a study of other settings; choose another name with --name"
        raise RunError(msg)
    study.set_user_attr("settings", own)
    left = settings.trials - len(study.get_trials(deepcopy=False, states=OVER))

    if left > 0:
        enough = optuna.study.MaxTrialsCallback(settings.trials, states=OVER)
        study.optimize(
            lambda trial: _tried(trial, settings, folder),
            callbacks=[lambda *_: _write_best(study, settings, folder), enough],
            show_progress_bar=False,
        )
    path = _write_best(study, settings, folder)
    if not os.path.lexists(path):
        why = study.trials[-1].user_attrs.get(WHY, "all were pruned")
        msg = f"{folder}: none of {settings.trials} trials has a cost: {why}"
        raise RunError(msg)
    return path


def _tried(trial: Trial, settings: TuneSettings, folder: Path) -> float:
    """Return the least validation cost of a trial's training.

    It is pruned if it falls behind or diverges, as it may with a large learning rate.
    """
    own = suggested(trial, settings, f"trial-{begin(trial)}")
    run, every = Run(own.name, folder), -(-own.steps // own.evaluations)

    def report(steps: int, cost: float) -> None:
        # Only equal numbers are compared, and steps depend on the length of a rollout.
        number = min(steps // every, own.evaluations)
        if number not in frozen(trial).intermediate_values:  # as after a kill
            trial.report(cost, number)
        if trial.should_prune():
            raise optuna.TrialPruned

    try:
        train(own, run, bar=False, report=report)
    except (ActionError, DivergedError, SimulationError) as error:
        trial.set_user_attr(WHY, str(error))
        raise optuna.TrialPruned(str(error)) from error
    except (KeyboardInterrupt, OSError):  # Optuna calls the trial failed, and would not repeat it
        repeat_later(trial)
        raise
    return float(run.validations()[1].min())


def _write_best(study: Study, settings: TuneSettings, folder: Path) -> Path:
    """Write the file of the best settings, if any trial has ended."""
    path = folder / "best.toml"
    if study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
        best = study.best_trial
        own = suggested(optuna.trial.FixedTrial(best.params), settings, "best")  # pyright: ignore[reportArgumentType]
        over = study.get_trials(deepcopy=False, states=OVER)
        comment = (
            f"Validation cost {study.best_value:.4g}, the best of {len(over)} trials:\n"
            f"python -m agents tune {shlex.join(sys.argv[1:])}"
        )
        write_text(path, as_toml(own, comment, settings.name))
    return path
