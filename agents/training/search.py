"""A search of a policy, round by round, that any kill leaves resumable.

Its log is written without torch.
"""

import math
import os
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar, Self

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from tqdm import tqdm

from agents.controllers.choices import recorded
from agents.controllers.learned import Learned
from agents.policies import AnyPolicy, policy_in
from agents.scoring import validation_cost
from agents.training.arrays import (
    Arrays,
    check_like,
    damage_named,
    load_checkpoint,
    save_checkpoint,
)
from agents.training.config import TimedSettings
from agents.training.parts import base_controller, best_controller
from agents.training.progress import Ending, Progress, told_part
from agents.training.runs import Run
from agents.training.starts import without_control
from mm_gym import ActionError, Scene

FOR_PLANS = 120.0
"""Least time that predictive control is given in the end if there is a time budget [s]. Where an
interface is followed by Runge-Kutta steps it can take an hour, on most linear plants a minute."""

LOGS = "tensorboard"  # folder of the logs that TensorBoard shows, in that of a run

VALIDATION = "validation/cost"
"""The name of the cost on the validation episodes, the same for every training."""


class Log:
    """Numbers of a training over its control steps; a continued run adds a file to its folder.

    Use it in a `with` statement, which closes the file. Readers leave out what a kill cut off.
    """

    def __init__(self, folder: Path) -> None:
        (folder / LOGS).mkdir(exist_ok=True)
        # Readers find files by this beginning, and order them by name.
        name = f"events.out.tfevents.{time.time():.6f}.{os.getpid()}"
        self._file = (folder / LOGS / name).open("wb")
        self._records = RecordWriter(self._file)
        self._write(Event(wall_time=time.time(), file_version="brain.Event:2"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, steps: int, numbers: Mapping[str, float]) -> None:
        """Add numbers, each by its name, after so many control steps."""
        values = [Summary.Value(tag=name, simple_value=value) for name, value in numbers.items()]
        self._write(Event(step=steps, wall_time=time.time(), summary=Summary(value=values)))

    def show(self) -> None:
        """Let readers see what was added so far."""
        self._file.flush()

    def _write(self, event: Event) -> None:
        self._records.write(event.SerializeToString())


class Search(ABC):
    """A search that validates the policy it has come to, and keeps the best.

    Attributes
    ----------
    unit
        The name of what is counted, as of a round.
    rounds
        Those that are done.
    counts
        How many a round counts for.
    frames
        Control steps of one.
    progress
        The validations.
    began_as
        What it begins as, in words.
    worst
        Share of the validation episodes, those that cost most, whose mean is the cost.
    total
        Number of rounds of the whole search, or infinity: on your own scene a time budget alone
        ends it, unless a number is asked for.
    """

    unit: ClassVar[str]
    between_saves: ClassVar[float] = 5.0  # longest time between checkpoints [s]
    is_compared: ClassVar[bool] = True  # whether a controller that costs less takes its place
    is_light: bool = True  # whether its state is noted in every round, as copies cost little
    interrupted: bool = False  # whether it stops after this round, as Ctrl-C asks
    counts: int = 1
    frames: int
    began_as: str
    worst: float = 1.0
    numbers: Sequence[float] = ()  # those that the searches of the base chose, for the record

    def __init__(self, settings: TimedSettings, scene: Scene) -> None:
        self.settings, self.scene = settings, scene
        self.rounds, self.progress = 0, Progress()
        size = settings.growing[0]
        self.total: float = getattr(settings, size)
        is_own = settings.scene is not None and settings.time_budget is not None
        if is_own and size not in settings.model_fields_set:
            self.total = math.inf

    @abstractmethod
    def _advance(self) -> None:
        """Do a round."""

    @abstractmethod
    def _present(self) -> Arrays:
        """Return the parameters of the policy that is validated, copied."""

    @abstractmethod
    def _policy(self, parameters: Arrays) -> AnyPolicy:
        """Return the policy of parameters."""

    @abstractmethod
    def _state(self) -> Arrays:
        """Return the arrays from which the next rounds follow; no round writes to them."""

    @abstractmethod
    def _restore(self, arrays: Arrays) -> None:
        """Go on from what `_state` returned, and count the rounds."""

    @property
    def done(self) -> float:
        """How much of the search is done, from 0 to 1: by rounds, or by time if that ends it."""
        budget, rounds = self.settings.time_budget, self.rounds / self.total
        return rounds if budget is None else min(1.0, max(rounds, self.progress.seconds / budget))

    def _told(self) -> dict[str, float]:
        """Return numbers of the last round for the log, by name."""
        return {}

    def policy(self) -> AnyPolicy:
        """Return the best policy of the validations."""
        return self._policy(self.progress.best)

    def finish(self, run: Run, *, bar: bool = True) -> None:
        """Search until rounds or time are used up, and write the best policy to the run's folder.

        An interrupted run continues from its last checkpoint; Ctrl-C writes one. Raise `RunError`
        if the folder holds another run, another process uses it, or no validation had a finite
        cost.
        """
        with run.locked():
            run.open(self.settings, self.numbers)
            if not run.finished:
                if run.checkpoint.exists():
                    self._continue(run)
                self._to_the_end(run, bar=bar)

    def _continue(self, run: Run) -> None:
        """Go on from a run's checkpoint; raise `RunError` if it is not of this search."""
        arrays = load_checkpoint(run.checkpoint)
        with damage_named(run.checkpoint):
            self.progress = Progress.of(arrays)
            check_like(arrays, self._state())
            if self.progress.best:
                check_like(self.progress.best, self._present())
            self._restore(arrays)
            if self.rounds < 0:
                msg = f"got {self.rounds} rounds; allowed: 0 or more"
                raise ValueError(msg)

    def _to_the_end(self, run: Run, *, bar: bool) -> None:
        """Search on, validate, and write the best policy; draw a progress bar if asked to."""
        progress, total = self.progress, self.total
        counted = None if math.isinf(total) else int(total)
        began = time.perf_counter() - progress.seconds
        shown = tqdm(total=counted, initial=self.rounds, unit=self.unit, disable=not bar)
        with shown, Log(run.folder) as log:
            if not len(progress.rows):
                self._validate(log)
            self._note()
            try:
                self._search(run, log, shown, began)
            except KeyboardInterrupt:
                self._save(run)
                raise KeyboardInterrupt(told_part(self.rounds, counted, self.unit)) from None
        progress.write_metrics(run)  # a process may have been killed before it did
        progress.require_best(run)
        policy = self.policy()
        ending = Ending.of(
            progress,
            self.scene,
            self.worst,
            unit=self.unit,
            done=self.rounds,
            total=counted,
            time_budget=self.settings.time_budget if self.rounds < total else None,
            began_as=self.began_as,
        )
        if self.is_compared and self.settings.scene is not None:
            budget = self.settings.time_budget
            seconds = math.inf if budget is None else max(budget, FOR_PLANS)
            if bar:  # the search seems to hang otherwise
                most = "longer" if budget is None else f"{seconds:g} s"
                told = "comparing with the classical controllers, for a minute or two"
                tqdm.write(f"{told}; predictive control may take {most}", sys.stderr)
            best = best_controller(self.scene, worst=self.worst, seconds=seconds)
            ending.controller, ending.controller_cost, ending.left_out = best
            if ending.returned is not None:
                make = partial(base_controller, self.scene, ending.returned)
                ending.numbers = list(recorded(make)[1])
        if self.is_compared and ending.is_worse and getattr(self.settings, "base", None) is None:
            without = without_control(self.scene)
            if validation_cost(self.scene, Learned(without), self.worst) < progress.least_cost:
                policy, ending.replaced = without, True
        policy_in(policy.to_bytes())  # what cannot be read does not end the run
        ending.write(run)
        policy.save(run.policy)

    def _search(self, run: Run, log: Log, shown: tqdm, began: float) -> None:
        """Do all rounds that are left, and validate; it began at a time of the clock [s]."""
        progress, saved = self.progress, self.progress.seconds
        budget = math.inf if self.settings.time_budget is None else self.settings.time_budget
        done = progress.seconds >= budget or self.rounds >= self.total
        while not done:
            self._advance()
            self.rounds += self.counts
            shown.update(self.counts)
            progress.seconds = time.perf_counter() - began
            done = progress.seconds >= budget or self.rounds >= self.total
            if told := self._told():
                log.add(self.rounds * self.frames, told)
            if due := done or self._is_due():
                self._validate(log)
                shown.set_postfix(cost=f"{progress.least_cost:.4g}")
            saves = due or progress.seconds > saved + self.between_saves
            if saves or self.interrupted or self.is_light:
                self._note()
            if saves:
                self._save(run)
                saved = progress.seconds
            if self.interrupted:
                raise KeyboardInterrupt

    def _is_due(self) -> bool:
        """Tell whether a validation is due: each so many rounds, or each part of the time."""
        if self.settings.time_budget is None:
            return self._has_passed(-(-self.total // self.settings.evaluations))
        return self.done * self.settings.evaluations >= len(self.progress.rows)

    def _has_passed(self, every: float) -> bool:
        """Tell whether the last round came to, or went beyond, a multiple of so many."""
        return self.rounds // every > (self.rounds - self.counts) // every

    def _validate(self, log: Log) -> None:
        present, steps = self._present(), self.rounds * self.frames
        cost = self._cost(present)
        log.add(steps, {VALIDATION: cost})
        log.show()
        if cost < self.progress.least_cost:
            self.progress.best = present
        self.progress.add(steps, cost)

    def _cost(self, parameters: Arrays) -> float:
        """Return the cost of parameters on the episodes of all validations."""
        try:
            return validation_cost(self.scene, Learned(self._policy(parameters)), self.worst)
        except ActionError:  # of a memory that grows without bound
            return math.inf

    def _note(self) -> None:
        """Note where an interrupted search begins again: between two rounds."""
        self.noted = self.progress.arrays() | self._state()

    def _save(self, run: Run) -> None:
        save_checkpoint(run.checkpoint, self.noted)
        self.progress.write_metrics(run)
