"""Are the normal numbers normal, out to the tails, and independent of each other?"""

import numba
import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import binom, kstest

from mm_gym.lanes.memory import span
from mm_gym.lanes.random import next_episode, normal_pair, normals, seed_streams

BAND = 3.2905  # standard deviations that a normal number exceeds once in a thousand times

KOLMOGOROV = 1.9495
"""What Kolmogorov's statistic times the root of the size exceeds once in a thousand times."""

BINS = 2**16


@numba.njit(error_model="numpy")
def fill(streams, numbers):
    """Draw numbers (columns, lanes), two columns at a time."""
    for column in range(0, numbers.shape[0], 2):
        for i in span(0, numbers.shape[1]):
            numbers[column, i], numbers[column + 1, i] = normals(streams, i)


@numba.njit(error_model="numpy")
def fill_from(first, second, numbers):
    for i in range(first.shape[0]):
        numbers[0, i], numbers[1, i] = normal_pair(first[i], second[i])


@numba.njit(error_model="numpy")
def begin_next(streams):
    for i in range(streams.shape[1]):
        next_episode(streams, i)


def streams_of(lanes, seed=0):
    streams = np.zeros((2, lanes), np.uint64)
    seed_streams(streams, np.arange(lanes, dtype=np.uint64) + np.uint64(seed), np.ones(lanes, bool))
    return streams


def drawn(streams, columns):
    numbers = np.empty((columns, streams.shape[1]))
    fill(streams, numbers)
    return numbers


def statistics(size):
    """Return Kolmogorov's statistic on a grid, and how many of `size` are beyond 1 .. 6."""
    streams, counts, beyond, rest = streams_of(1000), np.zeros(BINS), np.zeros((2, 6)), size
    while rest > 0:
        numbers = drawn(streams, 1000)
        counts += np.bincount((ndtr(numbers) * BINS).astype(int).ravel(), minlength=BINS)[:BINS]
        for k in range(6):
            beyond[:, k] += np.sum(numbers < -k - 1.0), np.sum(numbers > k + 1.0)
        rest -= numbers.size
    gap = np.cumsum(counts) / size - np.arange(1, BINS + 1) / BINS
    return np.abs(gap).max(), beyond


@pytest.mark.parametrize("size", [10**6, 10**8])
def test_numbers_are_normal_out_to_six_standard_deviations(size):
    statistic, beyond = statistics(size)
    # On a grid the statistic is smaller than on the line by less than a bin.
    assert statistic < KOLMOGOROV / np.sqrt(size)
    for k in range(6):
        low, high = binom.ppf([0.0005, 0.9995], size, ndtr(-k - 1.0))
        assert np.all((beyond[:, k] >= low) & (beyond[:, k] <= high))


def test_radius_follows_its_law_beyond_six_standard_deviations():
    # The radius is beyond 6 where the first draw is below 2^64 exp(-18).
    count, rng = 200_000, np.random.default_rng(1)
    first = rng.integers(0, int(2.0**64 * np.exp(-18.0)), count, dtype=np.uint64)
    second = rng.integers(0, 2**64, count, dtype=np.uint64)
    numbers = np.empty((2, count))
    fill_from(first, second, numbers)
    x, y = numbers
    assert kstest(0.5 * (x**2 + y**2) - 18.0, "expon").pvalue > 0.001
    assert kstest(np.arctan2(y, x) / (2.0 * np.pi) + 0.5, "uniform").pvalue > 0.001
    expected = 2.0 * count * ndtr(-6.0) / np.exp(-18.0)
    for side in (x, -x, y, -y):
        assert abs(np.sum(side > 6.0) - 0.5 * expected) < BAND * np.sqrt(0.5 * expected)


def test_largest_and_smallest_radius_are_those_of_53_bits():
    numbers = np.empty((2, 2))
    fill_from(np.array([0, 2**64 - 1], np.uint64), np.zeros(2, np.uint64), numbers)
    assert np.hypot(*numbers[:, 0]) == pytest.approx(np.sqrt(106.0 * np.log(2.0)), rel=1e-15)
    assert np.all(numbers[:, 1] == 0.0)


def test_lanes_episodes_and_columns_are_uncorrelated():
    streams, episodes = streams_of(2000), []
    for _ in range(3):
        begin_next(streams)
        episodes.append(drawn(streams, 100))
    numbers = np.array(episodes)  # (episodes, columns, lanes)
    for of in (lambda x: x, np.square, np.abs):
        values = of(numbers)
        values = (values - values.mean()) / values.std()
        for axis in range(3):
            for distance in (1, 2):
                ahead = np.take(values, np.arange(distance, values.shape[axis]), axis)
                behind = np.take(values, np.arange(values.shape[axis] - distance), axis)
                # Of n independent products the mean has the standard deviation 1 / sqrt(n).
                assert abs(np.mean(ahead * behind)) < BAND / np.sqrt(ahead.size)


def test_a_lone_lane_draws_what_it_draws_among_others():
    together, alone = streams_of(37), streams_of(37)
    numbers = drawn(together, 6)
    for i in range(37):
        one = np.ascontiguousarray(alone[:, i : i + 1])
        np.testing.assert_array_equal(drawn(one, 6)[:, 0], numbers[:, i])
