"""Progress of a training: its validations, its best policy and the time used."""

from __future__ import annotations

import numpy as np

from agents.training.arrays import Arrays, check_like, part_of
from agents.training.runs import METRICS, TIMES, Run
from mm_gym.arrays import Array
from mm_gym.files import write_csv


class Progress:
    """The validations so far, the best policy, and the time used.

    Attributes
    ----------
    rows
        Steps [-], time [s] and cost [-] of each validation.
    best
        The parameters of the policy of least cost, empty before the first validation.
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
        if progress.seconds < 0.0 or bool(progress.best) != bool(len(progress.rows)):
            msg = (
                f"progress: got {len(progress.rows)} validations, {progress.seconds:g} s and "
                f"{len(progress.best)} arrays of the best policy; allowed: some or none of all"
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

    def write_metrics(self, run: Run) -> None:
        """Write ``metrics.csv``, the same for the same run, and ``times.csv``, each whole."""
        steps, seconds, costs = self.rows.T
        write_csv(run.metrics, METRICS, [steps, costs])
        write_csv(run.times, TIMES, [steps, seconds])
