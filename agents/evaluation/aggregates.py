"""Statistics of several runs, and intervals of two levels.

Where each seed has episodes of its own, intervals are those of a bootstrap (`estimate`); where all
seeds share their episodes, those of `shared_episodes`.

Point estimates are those of Agarwal, Schwarzer, Castro, Courville and Bellemare, *Deep
reinforcement learning at the edge of the statistical precipice*, NeurIPS 2021, and of their package
rliable. Arrays (..., tasks, seeds) hold a score for each task and seed; the axes before are
resamples.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, norm, t, trim_mean

from mm_gym.arrays import Array

LEVEL = (2.5, 97.5)  # percentiles of an interval of 95 %
RESAMPLES = 2_000  # they leave the ends of an interval uncertain by some 3 % of its half width


class Estimate(NamedTuple):
    """A value with the ends of its 95 % interval; they are NaN where the data cannot tell them."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Sample:
    """Penalties of the episodes that controllers had in common."""

    penalties: Array  # (controllers, seeds, episodes) as in `Evaluation`
    # (controllers,) bool: whether each seed is a training of its own. Where it is not, the seeds
    # are of episodes alone, of one and the same controller.
    trained: NDArray[np.bool_]

    def resampled(self, generator: np.random.Generator, resamples: int = RESAMPLES) -> Array:
        """Return mean penalties (controllers, resamples, seeds) of seeds and episodes drawn anew.

        First seeds are drawn with replacement, then episodes within each. Seeds of one and the same
        controller are not drawn: they differ in their episodes only. All controllers share the
        draws, as they share the episodes.
        """
        controllers, seeds, episodes = self.penalties.shape
        drawn_seeds = generator.integers(seeds, size=(resamples, seeds))
        drawn = generator.integers(episodes, size=(resamples, seeds, episodes))
        own = np.broadcast_to(np.arange(seeds), (resamples, seeds))
        means = np.empty((controllers, resamples, seeds))
        for k, (penalties, trained) in enumerate(zip(self.penalties, self.trained, strict=True)):
            rows = drawn_seeds if trained else own
            means[k] = penalties[rows[:, :, None], drawn].mean(axis=2)
        return means


def interquartile_mean(scores: Array) -> Array:
    """Return the mean (...) of the middle half of all scores (..., tasks, seeds)."""
    flat = scores.reshape(*scores.shape[:-2], -1)
    return np.asarray(trim_mean(flat, 0.25, axis=-1))


def performance_profile(scores: Array, thresholds: Array) -> Array:
    """Return which part (..., thresholds) of all scores is greater than each threshold."""
    flat = scores.reshape(*scores.shape[:-2], -1)
    return (flat[..., None] > thresholds).mean(axis=-2)


def probability_of_improvement(first: Array, second: Array) -> Array:
    """Return the probability (...) that a score of the first is greater than one of the second.

    It is that of Mann and Whitney's U for each task, averaged over the tasks; equal scores count
    half.
    """
    mine, other = first[..., :, None], second[..., None, :]
    wins = (mine > other) + 0.5 * (mine == other)
    return wins.mean(axis=(-1, -2, -3))


def estimate(
    value: float, draws: Array, rows: Array, drawn_rows: Array, *, trained: bool, episodes: int
) -> Estimate:
    """Return a value with its interval: the resamples' percentiles, widened to what few seeds need.

    Two levels of resampling count the scatter of episodes twice and that of seeds too little; and
    few seeds say little about their own scatter. So deviations from the value are multiplied, by
    what makes the resampled mean scatter as the seeds do, and by the ratio of Student's to the
    normal distribution's quantile for as many degrees of freedom (Davison and Hinkley, *Bootstrap
    methods and their application*, 1997, sections 3.8 and 2.4).

    Parameters
    ----------
    value
        The estimate from all that was measured.
    draws
        (resamples,) the same from each resample.
    rows
        (tasks, seeds) what the mean is of that the estimate follows: the scores, or penalties.
    drawn_rows
        (resamples, tasks, seeds) the same of each resample.
    trained
        Whether each seed is a training of its own.
    episodes
        Of each seed.
    """
    tasks, seeds = rows.shape
    if trained and seeds > 1:
        scatter = np.sqrt(rows.var(axis=1, ddof=1).sum() / seeds) / tasks
        resampled, freedom = drawn_rows.mean(axis=(1, 2)).std(), tasks * (seeds - 1)
        widened = scatter / resampled if resampled > 0.0 else 1.0
    else:
        freedom = max(tasks * seeds * (episodes - 1), 1)
        widened = np.sqrt(episodes / max(episodes - 1, 1))
    widened *= t.ppf(0.975, freedom) / norm.ppf(0.975)
    low, high = value + widened * (np.percentile(draws, LEVEL) - value)
    return Estimate(float(value), float(low), float(high))


def of_means(
    sample: Sample, resampled: Array, of: Callable[..., Array], *controllers: int
) -> Estimate:
    """Return what follows from the mean penalties of controllers in their common episodes.

    The interval is for seeds as those of the first controller. `resampled` is
    `Sample.resampled` of all.
    """
    means = [sample.penalties[k].mean(axis=1) for k in controllers]
    drawn = [resampled[k] for k in controllers]
    return estimate(
        float(of(*(one.mean() for one in means))),
        of(*(one.mean(axis=1) for one in drawn)),
        of(*means)[None],
        of(*drawn)[:, None],
        trained=bool(sample.trained[controllers[0]]),
        episodes=sample.penalties.shape[2],
    )


def cost_estimate(sample: Sample, controller: int, resampled: Array) -> Estimate:
    """Return the cost of one controller over all seeds, with `Sample.resampled` of all."""
    found = of_means(sample, resampled, lambda own: own, controller)
    return Estimate(*(float(np.sqrt(max(value, 0.0))) for value in found))


def shared_episodes(penalties: Array, reference: Array | None = None) -> Estimate:
    """Return the interquartile mean of the seeds' costs over all episodes and trainings.

    The interval is for seeds and episodes drawn anew. It adds the squares of two margins: that of
    the mean over seeds, from the spread of the winsorised costs (Tukey and McLaughlin, *Less
    vulnerable confidence and significance procedures*, Sankhya A 25, 1963), and that of the mean
    over episodes, from the cost's slope over each episode's penalty. Each margin has Student's
    quantile for its own number of values, so few seeds do not borrow certainty from many episodes.
    What is particular to a seed in an episode is in both, which errs on the wide side. Ends are
    those of the logarithm: a cost is positive. A single seed says nothing of others: it has no
    interval.

    Parameters
    ----------
    penalties
        (seeds, episodes) as in `Evaluation`, of the same episodes.
    reference
        (episodes,) of one other controller, or (seeds, episodes) of other trainings, in the same
        episodes: the mean is then divided by their cost, and what makes an episode expensive for
        both widens no interval.
    """
    value, of_seeds, slopes = _middle(penalties)
    if reference is not None:
        other, of_others, its_slopes = _middle(np.atleast_2d(reference))
        value, slopes, of_seeds = value / other, slopes - its_slopes, np.hypot(of_seeds, of_others)
    seeds, episodes = penalties.shape
    if seeds == 1:
        return Estimate(value, np.nan, np.nan)
    margin = np.hypot(of_seeds, _margin(slopes.std(ddof=1) / np.sqrt(episodes), episodes))
    return Estimate(value, float(value / np.exp(margin)), float(value * np.exp(margin)))


def _middle(penalties: Array) -> tuple[float, float, Array]:
    """Return the interquartile mean of the seeds' costs, and two properties of its logarithm.

    These are the margin over seeds, 0 for a single seed, and the slopes (episodes,) over penalties.
    """
    seeds = len(penalties)
    costs = np.sqrt(penalties.mean(axis=1))
    cut = seeds // 4
    middle = np.argsort(costs)[cut : seeds - cut]
    value, kept = float(costs[middle].mean()), len(middle)
    slopes = (penalties[middle] / (2.0 * costs[middle, None])).mean(axis=0) / value
    if seeds == 1:
        return value, 0.0, slopes
    winsorised = np.clip(costs, costs[middle].min(), costs[middle].max())
    error = winsorised.std(ddof=1) * seeds / kept / np.sqrt(seeds) / value
    return value, _margin(error, kept), slopes


def _margin(error: float, count: int) -> float:
    """Return half the width of the interval of a mean of values with this standard error."""
    return float(error * t.ppf(0.975, count - 1))


def proportion(successes: int, trials: int) -> Estimate:
    """Return a proportion with its interval, that of Clopper and Pearson (Biometrika 26, 1934)."""
    ends = binomtest(successes, trials).proportion_ci()
    return Estimate(successes / trials, float(ends.low), float(ends.high))
