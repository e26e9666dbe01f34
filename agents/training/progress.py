"""Progress of a training: its validations, its best policy and the time used."""

from __future__ import annotations

import numpy as np

from agents.training.arrays import Arrays, check_like, part_of
from agents.training.runs import METRICS, TIMES, Run, RunError
from mm_gym.arrays import Array
from mm_gym.files import write_csv


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

    COLUMNS = 3

    def __init__(self) -> None:
        self.rows: Array = np.empty((0, self.COLUMNS))
        self.best: Arrays = {}
        self.seconds = 0.0

    @classmethod
    def of(cls, arrays: Arrays) -> Progress:
        """Restore what `arrays` returned; raise `ValueError` or `KeyError` if it is damaged."""
        progress = cls()
        check_like(arrays, progress.arrays())
        own = part_of(arrays, "progress")
        progress.rows, progress.seconds = own["rows"], float(own["seconds"])
        progress.best = part_of(arrays, "best")
        if not np.isfinite(progress.rows[:, :2]).all():
            msg = "progress/rows: got steps or times that are not finite; allowed: finite numbers"
            raise ValueError(msg)
        if progress.seconds < 0.0 or bool(progress.best) != np.isfinite(progress.least_cost):
            msg = (
                f"progress: got {len(progress.rows)} validations, {progress.seconds:g} s and "
                f"{len(progress.best)} arrays of the best policy; allowed: some or none of all, "
                "and none of the policy where no cost is finite"
            )
            raise ValueError(msg)
        return progress

    def arrays(self) -> Arrays:
        """Return the arrays to keep in a checkpoint."""
        best = {f"best/{name}": array for name, array in self.best.items()}
        return best | {"progress/rows": self.rows, "progress/seconds": np.asarray(self.seconds)}

    @property
    def least_cost(self) -> float:
        """The least cost so far [-]."""
        return float(min(self.rows[:, 2], default=np.inf))

    def add(self, steps: int, cost: float) -> None:
        """Append a row."""
        self.rows = np.vstack([self.rows, (steps, self.seconds, cost)])

    def require_best(self, run: Run) -> None:
        """Raise `RunError` unless a validation had a finite cost."""
        if not self.best:
            costs = ", ".join(f"{cost:g}" for cost in self.rows[:3, 2])
            msg = (
                f"{run.metrics}: got the costs {costs} of {len(self.rows)} validations; allowed: "
                "a finite one; choose other settings, and another name with --name"
            )
            raise RunError(msg)

    def write_metrics(self, run: Run) -> None:
        """Write ``metrics.csv``, the same for the same run, and ``times.csv``, each whole."""
        steps, seconds, costs = self.rows.T
        write_csv(run.metrics, METRICS, [steps, costs])
        write_csv(run.times, TIMES, [steps, seconds])
