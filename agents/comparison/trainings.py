"""Finished trainings of a task in the same held-out episodes, beside its best law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.aggregates import (
    LEVEL,
    Estimate,
    Sample,
    estimate,
    interquartile_mean,
)
from agents.sweeps.trials import LEARNERS
from agents.training.config import short_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from agents.comparison.robustness import Outcome
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
        The best classical law, in the same episodes.
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
    """Return the interquartile mean of the seeds' costs, with its interval over seeds."""
    sample = Sample(trainings.penalties[None], np.ones(1, np.bool_))
    drawn = np.sqrt(sample.resampled(np.random.default_rng(0))[0])[:, None]
    costs = trainings.costs[None]
    return estimate(
        float(interquartile_mean(costs)),
        interquartile_mean(drawn),
        costs,
        drawn,
        trained=True,
        episodes=sample.penalties.shape[2],
    )


def improvement(trainings: Trainings, law: Evaluation) -> Estimate:
    """Return the probability that a training's cost is below the law's, with its interval.

    Seeds and episodes are drawn anew, the episodes the same for all: they are paired.
    """
    own = trainings.penalties
    both = np.stack([own, np.broadcast_to(law.penalties, own.shape)])
    drawn = Sample(both, np.array([True, False])).resampled(np.random.default_rng(0))
    found = (drawn[0] < drawn[1]).mean(axis=1)
    value = (trainings.costs < law.cost).mean()
    return Estimate(float(value), *(float(end) for end in np.percentile(found, LEVEL)))


def episodes_won(trainings: Trainings, law: Evaluation) -> float:
    """Return which part of all episodes of all seeds costs less than with the law."""
    return float((trainings.penalties < law.penalties).mean())


def slopes(policy: Policy, at: float) -> Array:
    """Return the mean slope (n,) of the first action over each observed number, from -at to at."""
    ends = at * np.eye(policy.sizes[0])
    return (policy.act(ends) - policy.act(-ends))[:, 0] / (2.0 * at)
