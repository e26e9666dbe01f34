"""Seeds and counts of NumPy, and the generator that seeds are drawn from."""

import copy

import numpy as np
import pytest
from gymnasium.wrappers import OrderEnforcing
from tasks import CARRIAGE_FORCE

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError, simulate

LANES = 3


def single():
    return MovingMassEnv(CARRIAGE_FORCE)


def vector(count=LANES):
    return MovingMassVectorEnv(CARRIAGE_FORCE, count)


def start(env, **arguments):
    return env.reset(**arguments)[0].tobytes()


@pytest.mark.parametrize("seed", [np.int64(5), np.uint8(5), np.int32(5)])
@pytest.mark.parametrize("make", [single, vector])
def test_integer_of_numpy_is_a_seed(make, seed):
    assert start(make(), seed=seed) == start(make(), seed=5)


@pytest.mark.parametrize("seed", [True, 2**64, 2**70])
@pytest.mark.parametrize(
    "begin",
    [
        lambda seed: single().reset(seed=seed),
        lambda seed: vector().reset(seed=seed),
        lambda seed: vector().reset(seed=[0, seed, 1]),
        lambda seed: simulate(CARRIAGE_FORCE, duration=0.01, seed=seed),
    ],
)
def test_seed_that_would_be_taken_for_another_is_refused(begin, seed):
    with pytest.raises(SceneError, match=rf"seed: got {seed}; allowed: an integer from 0 to 2\*"):
        begin(seed)


def test_negative_seed_of_a_simulation_is_refused():
    with pytest.raises(SceneError, match=r"seed: got -1; allowed"):
        simulate(CARRIAGE_FORCE, duration=0.01, seed=-1)


def test_lanes_count_on_from_the_largest_seed():
    first = vector().reset(seed=[2**64 - 1, 0, 1])[0]
    np.testing.assert_array_equal(vector().reset(seed=2**64 - 1)[0], first)


@pytest.mark.parametrize(
    "seeds", [np.array([7, 1, 4]), np.array([7, 1, 4], np.uint64), (np.int64(7), 1, 4), [7, 1, 4]]
)
def test_array_of_seeds_has_one_for_each_lane(seeds):
    observations, _ = vector().reset(seed=seeds)
    for observation, seed in zip(observations, (7, 1, 4), strict=True):
        assert observation.tobytes() == start(single(), seed=seed)


def test_array_of_no_dimension_is_one_seed():
    assert start(vector(), seed=np.array(6)) == start(vector(), seed=6)


def test_counts_may_be_of_numpy():
    env = MovingMassVectorEnv(CARRIAGE_FORCE, np.int64(2), threads=np.int32(1))
    assert type(env.num_envs) is int
    assert env.action_space.shape == (len(env.reset(seed=0)[0]), 1)


@pytest.mark.parametrize("make", [single, vector])
def test_generator_set_by_hand_seeds_the_next_reset(make):
    env, other = make(), make()
    for each in (env, other):
        each.reset(seed=1)
        each.reset()
        each.np_random = np.random.default_rng(99)
        assert each.np_random_seed == -1
    first, second = start(env), start(env)
    assert first == start(other)
    assert second == start(other)
    assert first != second
    env.np_random = np.random.default_rng(99)
    assert start(env) == first
    env.np_random = np.random.default_rng(98)
    assert start(env) != first


@pytest.mark.parametrize("make", [single, vector])
def test_generator_set_before_the_first_reset_has_an_effect(make):
    starts = []
    for _ in range(2):
        env = make()
        env.np_random = np.random.default_rng(3)
        starts.append(start(env))
    assert starts[0] == starts[1]


@pytest.mark.parametrize("make", [single, vector])
def test_seed_prevails_over_the_generator(make):
    env = make()
    env.np_random = np.random.default_rng(3)
    assert start(env, seed=8) == start(make(), seed=8)
    other = make()
    other.reset(seed=8)
    assert start(env) == start(other)


def test_generator_is_set_through_wrappers_and_kept_by_copies():
    env = OrderEnforcing(single())
    env.np_random = np.random.default_rng(3)
    twin = copy.deepcopy(env.unwrapped)
    assert start(env) == start(twin)


def test_generator_seeds_only_the_lanes_that_begin():
    env, other = vector(), vector()
    for each in (env, other):
        each.reset(seed=1)
    env.np_random = np.random.default_rng(3)
    mask = np.array([True, False, False])
    env.reset(options={"reset_mask": mask})
    other.reset(options={"reset_mask": mask})
    assert (env.state[0] != other.state[0]).any()
    assert (env.reset()[0][1:] == other.reset()[0][1:]).all()


def test_setting_the_generator_does_not_stop_an_episode():
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, max_episode_steps=2)
    env.reset(seed=0)
    env.np_random = np.random.default_rng(3)
    for _ in range(6):
        env.step(np.zeros((2, 1), np.float32))


@pytest.mark.parametrize("value", [7, None, np.random.RandomState(3)])
@pytest.mark.parametrize("make", [single, vector])
def test_anything_but_a_generator_is_refused_when_it_is_set(make, value):
    env, other = make(), make()
    with pytest.raises(SceneError, match=r"np_random: got .*; allowed: a numpy\.random\.Generator"):
        env.np_random = value
    assert start(env, seed=5) == start(other, seed=5)
    assert start(env) == start(other)
