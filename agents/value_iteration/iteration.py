"""The iteration: sweeps over the grid, with the impulses to come in expectation.

The law is the best for an endless episode: values are those of the mean cost a step, relative to
that of rest, so there is no discount. White, *Dynamic programming, Markov chains, and the method of
successive approximations*, J. Math. Anal. Appl. 6 (1963); on a grid with interpolation: Falcone and
Ferretti, *Semi-Lagrangian approximation schemes for linear and Hamilton-Jacobi equations* (2013).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.network.arrays import Arrays
from agents.training.runs import Run
from agents.training.search import Search
from agents.value_iteration.problem import problem_of
from agents.value_iteration.settings import IterateSettings
from agents.value_table.kernel import expect, sweep
from agents.value_table.policy import ARRAYS, NUMBERS, TablePolicy
from mm_gym import Scene

Table = NDArray[np.float32]

BETWEEN = 20
"""Sweeps from one expectation to the next; an impulse is rare, and what it adds changes slowly."""


def iterate(settings: IterateSettings, run: Run, *, bar: bool = True) -> None:
    """Iterate until sweeps or time are used up, and write the best policy to the run's folder.

    An interrupted run continues from its last checkpoint; Ctrl-C writes one. Raise `SceneError`,
    `CompileError` or `DesignError` if the scene is not one that it solves. No folder is made. Raise
    `RunError` if the folder holds another run, or another process uses it.
    """
    ValueIteration(settings, settings.rewarded_scene()).finish(run, bar=bar)


class ValueIteration(Search):
    """Values on a grid, swept from the end of a control step to its start.

    Attributes
    ----------
    problem
        What is solved.
    values, expected
        Tables of the cost to come before a step, relative to rest, and of what impulses add.
    mean
        Cost of a step on average, as of the last sweep that followed an expectation [-].
    residual
        By how much that sweep raised some values more than others, over the largest value [-].
    """

    unit = "sweep"
    began_as = "the best action for the present step"

    def __init__(self, settings: IterateSettings, scene: Scene) -> None:
        super().__init__(settings, scene)
        self.settings: IterateSettings = settings
        self.problem = problem_of(scene, settings.stretches, settings.sizes)
        n = settings.points
        shape = (settings.stretches, 4, n, n, n, len(self.problem.squares))
        self.values, self.expected = np.zeros((2, *shape), np.float32)
        self.mean, self.residual = 0.0, np.inf
        self.frames = self.values.size

    @property
    def total(self) -> int:
        """Number of sweeps."""
        return self.settings.sweeps

    def _advance(self) -> None:
        fresh = self.rounds % BETWEEN == BETWEEN - 1
        problem, rules = self.problem, (self.problem.cost, self.problem.squares)
        if fresh and problem.chances.size:
            self.expected = np.empty_like(self.expected)
            self._share(expect, self.values, self.expected, problem.jumps, problem.chances, *rules)
        swept = np.empty_like(self.values)
        self._share(sweep, self._after(), swept, problem.moves, *rules, problem.travel)
        rest = swept[0, 0, 0, 0, 0, 0]
        if fresh:
            raised = swept - self.values
            self.mean, spread = float(rest), float(raised.max() - raised.min())
            self.residual = spread / float(swept.max())
        self.values = swept - rest

    def _share(self, kernel: Callable[..., None], *arguments: object) -> None:
        """Run a kernel over all lines of the grid, divided among threads."""
        lines = 4 * self.settings.points**2
        bounds = np.linspace(0, lines, self.settings.threads + 1).astype(int)
        with ThreadPoolExecutor(self.settings.threads) as threads:
            runs = [
                threads.submit(kernel, *arguments, first, last)
                for first, last in itertools.pairwise(bounds)
            ]
        for run in runs:
            run.result()

    def _after(self) -> Table:
        """Return the table at the end of a step, its cost apart, with the impulses in it."""
        stays = np.float32(1.0 - self.problem.chances.sum())
        return stays * self.values + self.expected

    def _told(self) -> dict[str, float]:
        """Return the mean cost of a step and the residual, once they are known."""
        known = np.isfinite(self.residual)
        return {"search/mean": self.mean, "search/residual": self.residual} if known else {}

    def _present(self) -> Arrays:
        return {"after": self._after()}

    def _policy(self, parameters: Arrays) -> TablePolicy:
        after: Any = parameters["after"]
        own = {name: getattr(self.problem, name) for name in (*ARRAYS, *NUMBERS)}
        return TablePolicy(after=after, **own)

    def _state(self) -> Arrays:
        return {
            "values/rounds": np.asarray(self.rounds),
            "values/values": self.values,
            "values/expected": self.expected,
        }

    def _restore(self, arrays: Arrays) -> None:
        self.rounds = int(arrays["values/rounds"])
        self.values, self.expected = arrays["values/values"], arrays["values/expected"]
