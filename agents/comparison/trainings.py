"""Finished trainings of a task in the same held-out episodes, next to a reference controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.aggregates import interquartile_mean, proportion, shared_episodes
from agents.sweeps.trials import LEARNERS
from agents.training.config import short_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from agents.comparison.robustness import Outcome
    from agents.evaluation.aggregates import Estimate
    from agents.evaluation.episodes import Evaluation
    from agents.policies import Policy

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """The validations of one training.

    Attributes
    ----------
    steps, seconds, costs
        (validations,) control steps of all lanes [-], time [s] and cost [-].
    """

    steps: Array
    seconds: Array
    costs: Array


@dataclass(frozen=True, eq=False)
class Trainings:
    """The trainings of one algorithm on a task.

    Attributes
    ----------
    algorithm
        Its name.
    results
        Of each seed, in the same held-out episodes.
    curves
        Of each seed.
    """

    algorithm: str
    results: Sequence[Evaluation]
    curves: Sequence[Curve]

    @property
    def penalties(self) -> Array:
        """(seeds, episodes) as in `Evaluation`."""
        return np.array([result.penalties for result in self.results])

    @property
    def costs(self) -> Array:
        """(seeds,) cost of each training [-]."""
        return np.array([result.cost for result in self.results])

    @property
    def median(self) -> int:
        """The seed whose cost is in the middle; of two, the better."""
        return int(np.argsort(self.costs)[(len(self.costs) - 1) // 2])

    def middle_curve(self) -> tuple[Array, Array]:
        """Return what the seeds have in common, up to the shortest: time and least cost so far.

        Returns
        -------
        seconds
            (validations,) median over the seeds [s].
        costs
            (3, validations) least, median and most of the seeds [-].
        """
        count = min(len(curve.costs) for curve in self.curves)
        seconds = np.median([curve.seconds[:count] for curve in self.curves], axis=0)
        least = [np.minimum.accumulate(curve.costs[:count]) for curve in self.curves]
        return seconds, np.percentile(least, (0.0, 50.0, 100.0), axis=0)


@dataclass(frozen=True, eq=False)
class OnTask:
    """What is known on a task.

    Attributes
    ----------
    task
        Its id.
    law
        The reference controller in the same episodes: the best of `classical_laws` in them.
    law_validation
        Its cost in the validation episodes [-].
    trainings
        Of each algorithm.
    known
        Role -> the least cost of `docs/task_scores.json` [-].
    plans
        (episodes,) costs of the best known plans [-].
    outcomes
        Of the law and of each algorithm's middle training on changed scenes.
    slopes
        Of a force alone: the LQR's, the best algorithm's middle training's at rest and at full
        scale, see `slopes`.
    examples
        Of a stretch: an episode by the law, by the same training and by the planner.
    """

    task: str
    law: Evaluation
    law_validation: float
    trainings: Sequence[Trainings]
    known: Mapping[str, float]
    plans: Array
    outcomes: Sequence[Outcome]
    slopes: Array | None
    examples: Sequence[Evaluation]

    @property
    def name(self) -> str:
        """The short name of the task."""
        return short_name(self.task)

    @property
    def best(self) -> Trainings:
        """The trainings of the best algorithm."""
        return best_of(self.trainings)

    def scores(self, costs: Array) -> Array:
        """Return s = (J_constant - J) / (J_constant - J_best known) of costs J."""
        constant = self.known["constant"]
        return (constant - costs) / (constant - self.known["planner"])


def algorithms_of(known: Sequence[OnTask]) -> list[str]:
    """Return the names of the algorithms that were run on any task, in the order of `LEARNERS`."""
    found = {of.algorithm for one in known for of in one.trainings}
    return sorted(found, key=LEARNERS.index)


def best_of(trainings: Sequence[Trainings]) -> Trainings:
    """Return the trainings of the algorithm with the least interquartile mean cost."""
    return min(trainings, key=lambda own: float(interquartile_mean(own.costs[None])))


def middle_cost(trainings: Trainings) -> Estimate:
    """Return the interquartile mean of the seeds' costs, with its interval, if there are several.

    The interval is for other seeds and other episodes.
    """
    return shared_episodes(trainings.penalties)


def cheaper(trainings: Trainings, law: Evaluation) -> int:
    """Return how many seeds cost less than a controller in the same episodes."""
    return int((trainings.costs < law.cost).sum())


def improvement(trainings: Trainings, law: Evaluation) -> Estimate:
    """Return the probability that a training's cost is below a controller's in these episodes.

    The interval is for other seeds in the same episodes.
    """
    return proportion(cheaper(trainings, law), len(trainings.costs))


def episodes_won(trainings: Trainings, law: Evaluation) -> float:
    """Return which fraction of all episodes of all seeds costs less than with the controller."""
    return float((trainings.penalties < law.penalties).mean())


def slopes(policy: Policy, at: float) -> Array:
    """Return the mean slope (n,) of the first action over each observed number, from -at to at."""
    ends = at * np.eye(policy.sizes[0])
    return (policy.act(ends) - policy.act(-ends))[:, 0] / (2.0 * at)
