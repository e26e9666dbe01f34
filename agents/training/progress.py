"""Progress of a training: its validations, its best policy and the time used, and how it ended."""

from __future__ import annotations

import json
import math
import os

import numpy as np
from pydantic import BaseModel

from agents.control.controller import joined, part
from agents.control.feedback import Feedback, TrueState
from agents.controllers.constant import no_control
from agents.scoring import validation_cost
from agents.training.arrays import Arrays, check_like
from agents.training.runs import METRICS, TIMES, DivergedError, Run, read_as
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.files import write_csv, write_text


class Progress:
    """The validations so far, the best policy, and the time used.

    Attributes
    ----------
    rows
        Steps [-], time [s] and cost [-] of each validation.
    best
        The parameters of the policy of least cost, empty before the first finite one.
    seconds
        Time of training, without interruptions [s].
    """

    def __init__(self) -> None:
        self.rows: Array = np.empty((0, 3))
        self.best: Arrays = {}
        self.seconds = 0.0

    @classmethod
    def of(cls, arrays: Arrays) -> Progress:
        """Restore what `arrays` returned; raise `ValueError` or `KeyError` if it is damaged."""
        progress = cls()
        check_like(arrays, progress.arrays())
        own = part(arrays, "progress")
        progress.rows, progress.seconds = own["rows"], float(own["seconds"])
        progress.best = part(arrays, "best")
        if not np.isfinite(progress.rows[:, :2]).all():
            got = "steps or times that are not finite"
            refuse("progress/rows", got, "finite numbers", ValueError)
        if progress.seconds < 0.0 or bool(progress.best) != np.isfinite(progress.least_cost):
            got = (
                f"{len(progress.rows)} validations, {progress.seconds:g} s and "
                f"{len(progress.best)} arrays of the best policy"
            )
            allowed = "some or none of all, and none of the policy where no cost is finite"
            refuse("progress", got, allowed, ValueError)
        return progress

    def arrays(self) -> Arrays:
        """Return the arrays to keep in a checkpoint."""
        own = {"rows": self.rows, "seconds": np.asarray(self.seconds)}
        return joined(best=self.best, progress=own)

    @property
    def least_cost(self) -> float:
        """The least cost so far [-]."""
        return float(min(self.rows[:, 2], default=np.inf))

    def add(self, steps: int, cost: float) -> None:
        """Append a row."""
        self.rows = np.vstack([self.rows, (steps, self.seconds, cost)])

    def require_best(self, run: Run) -> None:
        """Raise `DivergedError` unless a validation had a finite cost."""
        if not self.best:
            costs = ", ".join(f"{cost:g}" for cost in self.rows[:3, 2])
            got = f"the costs {costs} of {len(self.rows)} validations"
            advice = "choose other settings, and another name with --name"
            refuse(f"{run.metrics}", got, f"a finite one; {advice}", DivergedError)

    def write_metrics(self, run: Run) -> None:
        """Write ``metrics.csv``, the same for the same run, and ``times.csv``, each whole."""
        steps, seconds, costs = self.rows.T
        write_csv(run.metrics, METRICS, [steps, costs])
        write_csv(run.times, TIMES, [steps, seconds])


ROUND_OFF = 1e-4
"""Relative difference of costs that counts as none: some are of networks in single precision."""


class Ending(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """What ``end.json`` holds; its costs are those on the validation episodes [-]."""

    unit: str  # what is counted, as "sweep"
    done: int  # how many of them were done
    total: int | None  # how many the settings ask for
    time_budget: float | None  # after which the run ended before all were done [s], or None
    cost: float | None  # of the best agent; None if it is not finite
    began_as: str  # what the run began as
    began_with: float | None  # its cost; None of a run that began before it was noted
    no_control: float | None  # cost of no control
    replaced: bool = False  # whether the policy is no control, as all agents were worse
    # Name and cost of the scene's best classical controller, if it was looked for; where it costs
    # less than the best agent, it is what the run returns.
    controller: str | None = None
    controller_cost: float | None = None
    numbers: list[float] | None = None  # those that the searches of this controller chose
    left_out: str | None = None  # name of a controller that took too long to be compared

    @classmethod
    def of(cls, run: Progress, scene: Scene, worst: float = 1.0, **told: object) -> Ending:
        """Return the ending of a run, given its validations on the worst share of the episodes.

        Told are the other attributes, without the costs.
        """
        without = Feedback(scene, no_control(scene), TrueState())  # no estimate is needed
        steps, _, cost = run.rows[0]
        costs = {
            "cost": run.least_cost,
            "began_with": float(cost) if steps == 0 else math.inf,
            "no_control": validation_cost(scene, without, worst),
        }
        finite = {name: cost if math.isfinite(cost) else None for name, cost in costs.items()}
        return cls.model_validate({**told, **finite})

    @property
    def is_worse(self) -> bool:
        """Whether the best agent costs more than no control."""
        if self.cost is None or self.no_control is None:
            return self.cost is None
        return self.cost > self.no_control * (1.0 + ROUND_OFF)

    @property
    def returned(self) -> str | None:
        """Name of the controller that costs less than the best agent, or None."""
        if self.controller is None or self.controller_cost is None:
            return None
        mine = math.inf if self.cost is None else self.cost
        return self.controller if self.controller_cost < mine * (1.0 - ROUND_OFF) else None

    def write(self, run: Run) -> None:
        """Write it to the run's folder."""
        write_text(run.ending, json.dumps(self.model_dump(), indent=2) + "\n")

    @property
    def notes(self) -> list[str]:
        """What the agent's user has to know, a line each; how far a shortened run came is last."""
        told: list[str] = []
        if self.returned is not None:
            told.append(
                f"note: on the validation episodes {self.returned} costs "
                f"{_told(self.controller_cost)} and the best agent {_told(self.cost)}; commands "
                "that score or export this run therefore take the controller, and "
                "policy.safetensors holds the agent"
            )
        if self.left_out is not None:
            told.append(
                f"note: {self.left_out} was not compared, because it takes too long on this scene; "
                "a larger --time-budget gives it more"
            )
        if self.is_worse:
            kept = "no control" if self.replaced else "the best agent"
            told.append(
                "warning: on the validation episodes all agents were worse than no control: "
                f"the best costs {_told(self.cost)}, no control {_told(self.no_control)}; "
                f"the policy is {kept}"
            )
        elif self.cost == self.began_with:
            told.append(
                "note: on the validation episodes no agent was better than the initial policy, "
                f"{self.began_as}, which costs {_told(self.cost)}"
            )
        if self.time_budget is not None:
            told.append(
                f"ended by its time budget of {self.time_budget:g} s "
                f"{told_part(self.done, self.total, self.unit)}; "
                "a larger --time-budget continues it"
            )
        return told


def told_part(done: int, total: int | None, unit: str) -> str:
    """Return the words for how much of a run is done; without a total, time alone ends it."""
    return f"after {done:,} {unit}s" if total is None else f"after {done:,} of {total:,} {unit}s"


def _told(cost: float | None) -> str:
    return "not finite" if cost is None else f"{cost:.6g}"


def read_ending(run: Run) -> Ending | None:
    """Return how a run ended, or None where an earlier version did not note it.

    Raise `RunError` if its file is damaged.
    """
    if not os.path.lexists(run.ending):
        return None
    return read_as(Ending, run.ending, "the end of a run")


def notes_of(run: Run) -> list[str]:
    """Return what is told of how a finished run ended; raise as `read_ending` does."""
    ending = read_ending(run)
    return [] if ending is None else ending.notes
