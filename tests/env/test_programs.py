"""Programs that know Gymnasium, or Stable-Baselines3, but not this package."""

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from ppo_continuous_action import train
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from tasks import TASKS

import mm_gym  # noqa: F401 - registers the tasks


@pytest.mark.parametrize("name", TASKS)
def test_wrappers_of_gymnasium_apply(name):
    env = gymnasium.make(name)
    size = env.observation_space.shape[0]
    env = wrappers.RecordEpisodeStatistics(env)
    env = wrappers.NormalizeObservation(env)
    env = wrappers.FrameStackObservation(env, 4)
    observation, _ = env.reset(seed=0)
    env.action_space.seed(0)
    steps, total, ended = 0, 0.0, False
    while not ended:
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        steps, total, ended = steps + 1, total + reward, terminated or truncated
        assert observation.shape == (4, size)
        assert np.isfinite(observation).all()
    assert steps == info["episode"]["l"]
    assert terminated or steps == TASKS[name].control.steps
    assert info["episode"]["r"] == pytest.approx(total, rel=1e-9)
    env.close()


@pytest.mark.parametrize("name", TASKS)
def test_sync_and_native_vectors_are_made_by_name_and_agree(name, assert_same):
    made = [
        gymnasium.make_vec(name, num_envs=2, vectorization_mode=mode)
        for mode in ("sync", "vector_entry_point")
    ]
    results = []
    for envs in made:
        observations, _ = envs.reset(seed=3)
        envs.action_space.seed(3)
        seen = [observations.tolist()]
        seen += [[part.tolist() for part in envs.step(sample)[:4]] for sample in samples(envs)]
        results.append(seen)
        envs.close()
    assert_same(*results)


def samples(envs, steps=20):
    shape = (steps, *envs.action_space.shape)
    return np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)


def test_asynchronous_vector_agrees_with_the_native_one(assert_same):
    # Processes take a second to start, so one task stands for all; it is the one with everything.
    name = "mm_gym/Hybrid-v0"
    made = [
        gymnasium.make_vec(f"mm_gym:{name}", 2, "async", vector_kwargs={"context": "spawn"}),
        gymnasium.make_vec(name, 2, "vector_entry_point"),
    ]
    results = []
    for envs in made:
        seen = [envs.reset(seed=3)[0].tolist()]
        seen += [[part.tolist() for part in envs.step(sample)[:4]] for sample in samples(envs)]
        results.append(seen)
        envs.close()
    assert_same(*results)


@pytest.mark.parametrize("name", TASKS)
def test_stable_baselines_trains_through_its_own_vector(name):
    envs = make_vec_env(name, n_envs=2, seed=0)
    model = PPO("MlpPolicy", envs, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(64)
    moved = [
        not bool((p == q).all()) for p, q in zip(model.policy.parameters(), before, strict=True)
    ]
    assert any(moved)
    assert all(bool(p.isfinite().all()) for p in model.policy.parameters())
    envs.close()


@pytest.mark.parametrize("name", TASKS)
def test_clean_rl_trains(name):
    losses = train(f"mm_gym:{name}", num_envs=2, num_steps=32, updates=2)
    assert len(losses) == 2
    assert np.isfinite(losses).all()
