"""Trainings in processes of their own, to be killed, stopped and interrupted."""

import multiprocessing
import os
import signal
import sys
from pathlib import Path
from unittest import mock

import numpy as np

from agents.commands import train as command
from agents.commands.tune import TuneSettings, tune
from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.training.config import RunSettings, TrainSettings
from agents.training.reinforcement import train
from agents.training.runs import Run
from agents.value_iteration.iteration import IterateSettings, iterate

FORKING = multiprocessing.get_context("forkserver")
"""Processes fork from one that has imported torch already, which takes seconds."""

FORKING.set_forkserver_preload([__name__])

# What Python reports before it touches a file, and which of the event's arguments is the path.
TOUCHES = {"open": 0, "os.rename": 1, "os.remove": 0, "os.chmod": 0, "os.mkdir": 0}


def begin_training(settings: TrainSettings, root: Path, touches: int | None = None):
    """Train in a new process, which kills itself before it touches so many files of the run."""
    return _begin(_run, train, settings, Run(settings.name, root), touches)


def begin_evolution(settings: EvolveSettings, root: Path, touches: int | None = None):
    """Evolve in a new process, as `begin_training` does."""
    return _begin(_run, evolve, settings, Run(settings.name, root), touches)


def begin_descent(settings: GradientSettings, root: Path, touches: int | None = None):
    """Train by gradients in a new process, as `begin_training` does."""
    return _begin(_run, descend, settings, Run(settings.name, root), touches)


def begin_iteration(settings: IterateSettings, root: Path, touches: int | None = None):
    """Iterate values in a new process, as `begin_training` does."""
    return _begin(_run, iterate, settings, Run(settings.name, root), touches)


def begin_tuning(settings: TuneSettings, root: Path, touches: int | None = None):
    """Tune in a new process, as `begin_training` does."""
    return _begin(_run, _tune, settings, Run(settings.name, root), touches)


def begin_command(arguments: list[str], folder: Path):
    """Run ``python -m agents train`` in a new process and a folder, where it writes ``errors``."""
    return _begin(_command, arguments, folder)


def kill_ten_times(begin, settings: RunSettings, root: Path) -> Run:
    """Kill a search at random instants, which goes on from where it was; return its run."""
    run, draw = Run(settings.name, root), np.random.default_rng(1)
    for _ in range(10):
        process = begin(settings, root)
        process.join(draw.uniform(2.0, 9.0))
        process.kill()
        process.join()
        assert not run.finished
    assert run.checkpoint.exists()
    return run


def _begin(target, *arguments):
    process = FORKING.Process(target=target, args=arguments)
    # The process that others fork from does not take over the import path by itself.
    with mock.patch.dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)):
        process.start()
    return process


def _run(work, settings: RunSettings, run: Run, touches: int | None) -> None:
    left = touches

    def count(event, arguments):
        nonlocal left
        if left is not None and event in TOUCHES:
            if str(run.folder) in str(arguments[TOUCHES[event]]):
                left -= 1
            if left < 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
    work(settings, run)


def _tune(settings: TuneSettings, run: Run) -> None:
    tune(settings, run.folder.parent)


def _command(arguments: list[str], folder: Path) -> None:
    # A process in the background may have inherited that Ctrl-C is ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(folder)
    sys.argv = ["agents.train", *arguments]
    with Path("errors").open("w", encoding="utf-8", buffering=1) as sys.stderr:
        status = command.main()
    sys.exit(status)
