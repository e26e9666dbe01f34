"""Are the aggregates those of rliable, and do their intervals cover what they should?"""

import json
from pathlib import Path

import numpy as np
import pytest

from agents.evaluation.aggregates import (
    Sample,
    cost_estimate,
    estimate,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
    proportion,
    shared_episodes,
)
from agents.scoring import tail_mean

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "rliable.json").read_text("utf-8"))
"""What tests/golden/make_rliable.py wrote with rliable 1.2."""


@pytest.mark.parametrize("case", range(len(GOLDEN)))
def test_point_estimates_are_those_of_rliable(case):
    golden = GOLDEN[case]
    # rliable has a row for each run and a column for each task.
    first, second = (np.array(golden[name]).T for name in ("first", "second"))
    assert interquartile_mean(first) == pytest.approx(golden["iqm"], rel=1e-12)
    found = performance_profile(first, np.array(golden["thresholds"]))
    np.testing.assert_allclose(found, golden["profile"], rtol=1e-12)
    improvement = probability_of_improvement(first, second)
    assert improvement == pytest.approx(golden["improvement"], rel=1e-12)


def test_resamples_are_treated_one_by_one():
    scores = np.random.default_rng(2).normal(size=(6, 3, 5))
    other = np.random.default_rng(3).normal(size=(6, 3, 4))
    thresholds = np.array([-1.0, 0.0, 0.5])
    np.testing.assert_array_equal(
        interquartile_mean(scores), [interquartile_mean(one) for one in scores]
    )
    np.testing.assert_array_equal(
        performance_profile(scores, thresholds),
        [performance_profile(one, thresholds) for one in scores],
    )
    np.testing.assert_allclose(
        probability_of_improvement(scores, other),
        [probability_of_improvement(*pair) for pair in zip(scores, other, strict=True)],
    )


def simulated(generator, seeds, episodes, scatter):
    """Penalties (1, seeds, episodes) of a truth of 1: seeds by `scatter`, episodes by 0.3."""
    own = 1.0 + scatter * generator.normal(size=seeds)
    return (own[:, None] + 0.3 * generator.normal(size=(seeds, episodes)))[None]


RUNS = 1500  # simulated runs: a coverage of 95 % is uncertain by 1.1 % (two standard deviations)


@pytest.mark.parametrize("scatter", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("seeds", [5, 10])
def test_intervals_of_trained_controllers_cover_the_truth(seeds, scatter):
    generator, covered = np.random.default_rng([seeds, int(100 * scatter)]), 0
    for _ in range(RUNS):
        penalties = simulated(generator, seeds, 20, scatter)
        sample = Sample(penalties, np.array([True]))
        drawn = sample.resampled(generator, 200)
        rows = penalties[0].mean(axis=1)
        found = estimate(
            rows.mean(),
            drawn[0].mean(axis=1),
            rows[None],
            drawn[0][:, None],
            trained=True,
            episodes=20,
        )
        covered += found.low <= 1.0 <= found.high
    assert 0.93 <= covered / RUNS <= 0.97


@pytest.mark.parametrize("seeds", [1, 5])
def test_intervals_of_one_controller_cover_the_truth(seeds):
    generator, covered = np.random.default_rng(seeds), 0
    for _ in range(RUNS):
        penalties = simulated(generator, seeds, 40, 0.0)
        sample = Sample(penalties, np.array([False]))
        found = cost_estimate(sample, 0, sample.resampled(generator, 200))
        covered += found.low <= 1.0 <= found.high
    assert 0.93 <= covered / RUNS <= 0.97


def test_intervals_of_the_interquartile_mean_over_tasks_cover_the_truth():
    generator, covered = np.random.default_rng(11), 0
    for _ in range(RUNS // 2):
        parts = [simulated(generator, 5, 10, 0.2) for _ in range(3)]
        draws = [Sample(part, np.array([True])).resampled(generator, 200)[0] for part in parts]
        rows = np.stack([part[0].mean(axis=1) for part in parts], axis=-2)
        drawn = np.stack(draws, axis=-2)
        found = estimate(
            float(interquartile_mean(rows)),
            interquartile_mean(drawn),
            rows,
            drawn,
            trained=True,
            episodes=10,
        )
        covered += found.low <= 1.0 <= found.high
    # Twice the uncertainty of the other tests, around the same bounds.
    assert 0.925 <= covered / (RUNS // 2) <= 0.975


def test_controllers_share_their_draws():
    penalties = np.random.default_rng(4).uniform(size=(1, 4, 30))
    both = Sample(np.concatenate([penalties, 2.0 * penalties]), np.array([True, True]))
    drawn = both.resampled(np.random.default_rng(0), 50)
    np.testing.assert_allclose(drawn[1], 2.0 * drawn[0], rtol=1e-14)


def test_seeds_of_one_controller_are_not_drawn():
    penalties = np.repeat(np.arange(1.0, 5.0)[:, None], 6, axis=1)[None]
    fixed, drawn = (
        Sample(penalties, np.array([trained])).resampled(np.random.default_rng(0), 50)
        for trained in (False, True)
    )
    np.testing.assert_array_equal(fixed[0], np.tile(np.arange(1.0, 5.0), (50, 1)))
    assert drawn[0].mean(axis=1).std() > 0.1


def test_tail_mean_is_that_of_the_worst_tenth():
    values = np.random.default_rng(0).permutation(np.arange(100.0))
    assert tail_mean(values) == np.arange(90.0, 100.0).mean()
    assert tail_mean(np.array([3.0])) == 3.0
    both = np.stack([values, -values])
    np.testing.assert_array_equal(tail_mean(both, 0.25), [np.arange(75.0, 100.0).mean(), -12.0])
    assert tail_mean(values, 1.0) == values.mean()


def test_cost_is_that_of_all_episodes():
    penalties = np.random.default_rng(1).uniform(size=(2, 3, 10))
    sample = Sample(penalties, np.array([False, True]))
    drawn = sample.resampled(np.random.default_rng(0), 100)
    for k in range(2):
        found = cost_estimate(sample, k, drawn)
        assert found.value == pytest.approx(np.sqrt(penalties[k].mean()), rel=1e-14)
        assert found.low < found.value < found.high


def crossed(generator, seeds, scatter, of_episodes, of_both):
    """Penalties (seeds, 100) of trainings in the same episodes, whose cost is 1 in the mean.

    Seeds' costs scatter by `scatter`, episodes by `of_episodes` and what is particular to a seed
    in an episode by `of_both`, each relative to its mean.
    """

    def skewed(spread, shape):
        return generator.gamma(1.0 / spread**2, spread**2, shape)

    own = generator.normal(1.0, scatter, (seeds, 1)) ** 2
    return own * skewed(of_episodes, 100) * skewed(of_both, (seeds, 100))


def coverage_of_shared_episodes(runs, *design):
    """Return which fraction of the intervals holds the cost over all seeds and episodes."""
    generator, covered = np.random.default_rng(7), 0
    for _ in range(runs):
        found = shared_episodes(crossed(generator, *design))
        covered += found.low <= 1.0 <= found.high
    return covered / runs


@pytest.mark.parametrize(
    "design",
    [(10, 0.002, 0.5, 0.1), (10, 0.03, 0.5, 0.1), (10, 0.2, 0.5, 0.3), (3, 0.03, 0.5, 0.1)],
)
def test_intervals_of_seeds_that_share_their_episodes_cover_other_seeds_and_episodes(design):
    # Of 1,000 runs a coverage is uncertain by 1.4 % (two standard deviations).
    assert coverage_of_shared_episodes(1000, *design) >= 0.93


@pytest.mark.parametrize("seeds", [2, 3, 4, 10])
def test_intervals_of_shared_episodes_cover_whatever_scatters_most(seeds):
    spreads = [
        (seeds, scatter, of_episodes, of_both)
        for scatter in (0.002, 0.03, 0.2)
        for of_episodes in (0.2, 1.0, 2.0)
        for of_both in (0.05, 1.0)
    ]
    found = [coverage_of_shared_episodes(2000, *design) for design in spreads]
    # Least where penalties are most skewed (0.933), most where what is particular to a seed in an
    # episode is most of the scatter and counts twice (0.998); 2,000 runs are uncertain by 1 %.
    assert min(found) >= 0.92
    assert np.mean(found) >= 0.945


@pytest.mark.parametrize(
    ("seeds", "scatter"),
    [((10, 10), (0.002, 0.002)), ((10, 3), (0.03, 0.002)), ((4, 10), (0.2, 0.1))],
)
def test_intervals_of_the_ratio_of_two_trainings_cover_other_seeds_and_episodes(seeds, scatter):
    generator, covered, runs = np.random.default_rng(11), 0, 1000
    for _ in range(runs):
        shared = crossed(generator, 1, 1e-9, 0.5, 1e-3)
        own, other = (
            shared * crossed(generator, count, own, 0.05, 0.1)
            for count, own in zip(seeds, scatter, strict=True)
        )
        found = shared_episodes(own, other)
        covered += found.low <= 1.0 <= found.high
    # As above: what is particular to a seed counts twice, which errs on the wide side.
    assert covered / runs >= 0.93


def test_ratio_of_two_trainings_is_one_for_the_same_and_turns_round():
    generator = np.random.default_rng(3)
    own, other = (crossed(generator, 10, 0.03, 0.5, 0.1) for _ in range(2))
    assert shared_episodes(own, own).value == pytest.approx(1.0, rel=1e-15)
    found, turned = shared_episodes(own, other), shared_episodes(other, own)
    assert turned == pytest.approx((1.0 / found.value, 1.0 / found.high, 1.0 / found.low))
    one = shared_episodes(own, other[:1])
    assert one == pytest.approx(shared_episodes(own, other[0]))
    assert np.log(one.high / one.low) < np.log(found.high / found.low)


def test_a_single_seed_has_no_interval():
    found = shared_episodes(np.full((1, 100), 4.0))
    assert found.value == 2.0
    assert np.isnan(found.low)
    assert np.isnan(found.high)


@pytest.mark.parametrize(
    ("successes", "low", "high"), [(0, 0.0, 0.3085), (3, 0.0667, 0.6525), (10, 0.6915, 1.0)]
)
def test_proportion_is_that_of_tables(successes, low, high):
    """Of ten trials, as tabulated for Clopper and Pearson's interval, to four digits."""
    assert proportion(successes, 10) == pytest.approx((successes / 10, low, high), abs=5e-5)


def test_interval_of_one_success_in_one_trial_is_wide():
    assert proportion(1, 1) == pytest.approx((1.0, 0.025, 1.0))


@pytest.mark.parametrize("scatter", [0.01, 0.1])
def test_intervals_of_improvement_cover_other_seeds_in_the_same_episodes(scatter):
    """One of many trainings stands for the controller that the others are compared with."""
    generator, covered, runs = np.random.default_rng(5), 0, 400
    for _ in range(runs):
        reference, *others = crossed(generator, 400, scatter, 0.5, 0.1).mean(axis=1)
        better = np.array(others) < reference
        found = proportion(int(better[:10].sum()), 10)
        covered += found.low <= better.mean() <= found.high
    # Exact intervals cover at least 95 %; 400 runs are uncertain by 2.2 %.
    assert covered / runs >= 0.93
