"""The contract of Gymnasium and Stable-Baselines3, on every registered task."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3
from tasks import TASKS

from mm_gym import MovingMassEnv, MovingMassVectorEnv


@pytest.fixture(params=list(TASKS))
def env(request):
    made = gymnasium.make(request.param).unwrapped
    yield made
    made.close()


# Velocities and the like have no bounds; Gymnasium ignores these two for its own environments.
@pytest.mark.filterwarnings(
    "ignore:.*A Box observation space m.*imum value is -?infinity:UserWarning"
)
def test_gymnasium_finds_nothing_to_complain_about(env):
    # Other warnings are errors here.
    check_env(env)


def test_stable_baselines_finds_nothing_to_complain_about(env):
    check_env_of_sb3(env)


def test_tasks_are_made_without_importing_the_package():
    # Gymnasium 1.0 gave up its plug-ins; the module's name before the id stands for the import.
    program = f"""
import gymnasium
for name in {list(TASKS)!r}:
    env = gymnasium.make(f"mm_gym:{{name}}")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    entry = "vector_entry_point"
    envs = gymnasium.make_vec(f"mm_gym:{{name}}", num_envs=3, vectorization_mode=entry)
    envs.reset(seed=0)
    print(type(envs.unwrapped).__name__, envs.step(envs.action_space.sample())[0].shape[0])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.decode().splitlines() == ["MovingMassVectorEnv 3"] * len(TASKS)


@pytest.mark.parametrize("name", TASKS)
def test_vector_of_a_task_is_the_native_one(name):
    envs = gymnasium.make_vec(name, num_envs=4)
    assert isinstance(envs.unwrapped, MovingMassVectorEnv)
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(np.ascontiguousarray(observations))
    envs.close()


def test_twin_rollouts_with_one_seed_agree_to_the_last_bit(env, assert_same):
    twin = MovingMassEnv(env.scene)
    assert_same(env.reset(seed=7), twin.reset(seed=7))
    env.action_space.seed(3)
    for step in range(250):
        action = env.action_space.sample()
        result = env.step(action)
        assert_same(result, twin.step(action))
        if result[2] or result[3] or step == 120:
            # Without a seed: the random stream continues.
            assert_same(env.reset(), twin.reset())


def test_different_seeds_begin_differently_and_streams_go_on(env):
    starts = [env.reset(seed=seed)[0].tobytes() for seed in range(20)]
    starts += [env.reset()[0].tobytes() for _ in range(20)]
    assert len(set(starts)) == 40


def test_first_reset_needs_no_seed_and_is_then_random():
    name = next(iter(TASKS))
    starts = {gymnasium.make(name).unwrapped.reset()[0].tobytes() for _ in range(5)}
    assert len(starts) == 5


def test_observations_do_not_share_memory(env):
    kept = [env.reset(seed=0)[0]]
    kept += [env.step(env.action_space.sample())[0] for _ in range(5)]
    copies = [observation.copy() for observation in kept]
    env.reset()
    for i, observation in enumerate(kept):
        assert np.array_equal(observation, copies[i])
        assert not any(np.shares_memory(observation, other) for other in kept[:i])


def test_no_observation_is_constant_under_random_actions(env):
    env.action_space.seed(0)
    seen = [env.reset(seed=0)[0]]
    seen += [env.step(env.action_space.sample())[0] for _ in range(60)]
    assert (np.ptp(seen, axis=0) > 0.01).all()


def test_observations_are_of_order_one(env):
    env.action_space.seed(0)
    seen = []
    for seed in range(10):
        env.reset(seed=seed)
        for _ in range(90):
            observation, _, terminated, *_ = env.step(env.action_space.sample())
            seen.append(observation)
            if terminated:
                break
    spread = np.std(seen, axis=0)
    assert (spread > 0.05).all()
    assert (spread < 5.0).all()


def test_initial_state_really_varies(env):
    starts = np.array([env.reset(seed=seed)[0] for seed in range(300)])
    varied = np.ptp(starts, axis=0)
    assert (varied > 0).any()
    # What varies covers its range: 300 uniform draws come within 5 % of either end (miss: 4e-7).
    for column in starts[:, varied > 0].T:
        assert column.min() < -0.9 * np.abs(starts).max() or column.min() < 0.05 * column.max()
        assert column.max() > 0.0


def start_of(env, name):
    """The value of a drawn field in a new episode."""
    _, info = env.reset()
    x1, x2, v1, v2 = info["state"]
    starts = {
        "initial.carriage_displacement": x1,
        "initial.sphere_offset": x2 - x1,
        "initial.carriage_velocity": v1,
        "initial.sphere_velocity": v2,
        "initial.stretch": info["applied"][-1],
    }
    return starts[name] if name in starts else env.drawn(name)


def test_drawn_values_follow_their_ranges(env):
    plant = env.plant
    names = {row: name for name, row in plant.support.names.items()}
    for row, low, high in plant.draws:
        values = np.array([start_of(env, names[int(row)]) for _ in range(2000)])
        assert low <= values.min()
        assert values.max() <= high
        # Uniform: the mean of 2000 draws strays less than 5 standard errors, 0.29/sqrt(2000) each.
        assert abs(values.mean() - (low + high) / 2) <= 5 * (high - low) * 0.29 / 2000**0.5
