"""Does RLlib store what happened, and does its page work as it is printed?"""

import os
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import ray
from pages import run_page
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.utils.replay_buffers.episode_replay_buffer import EpisodeReplayBuffer
from transitions import CHANGES, ROUNDING, check_shuffled, check_transitions

import mm_gym

WORKERS = 10

# RLlib stores what the module says; the environment gets it moved to its own range and back.
ACTION_ROUNDING = 4 * ROUNDING


def collected(**arguments):
    """Whole episodes, as RLlib's own environment runner collects them from the native lanes."""
    config = (
        PPOConfig()
        .environment(
            "mm_gym:mm_gym/CarriageForce-v0",
            env_config={"changes": CHANGES, "info": "none", **arguments},
        )
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=4,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .debugging(seed=1)
    )
    runner = SingleAgentEnvRunner(config=config)
    episodes = runner.sample(num_episodes=40)
    runner.stop()
    return [episode.to_numpy() for episode in episodes]


@pytest.fixture(scope="module")
def episodes():
    return collected()


def test_blocks_of_the_page_run(tmp_path):
    assert float(run_page("rllib", tmp_path).split()[-1]) < 0


def first_step():
    """Make, reset and step; return the process, the kernels that it compiled, and the state."""
    import gymnasium  # noqa: PLC0415 - in a process of its own

    import mm_gym  # noqa: PLC0415, F401
    from mm_gym.compiler.dispatcher import OnceDispatcher  # noqa: PLC0415

    compiled, made = [], OnceDispatcher._announced_and_made

    def noted(self, kinds):
        compiled.append(f"{self.py_func.__qualname__}{kinds}")
        return made(self, kinds)

    OnceDispatcher._announced_and_made = noted
    env = gymnasium.make("mm_gym/CarriageForce-v0")
    env.reset(seed=0)
    _, _, _, _, info = env.step(np.ones(1, np.float32))
    return os.getpid(), compiled, info["state"].tolist()


def test_workers_that_start_at_once_compile_each_kernel_in_one_of_them(tmp_path):
    places = [str(Path(mm_gym.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    variables = {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(places)}
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers lack this module
    ray.init(num_cpus=WORKERS, runtime_env={"env_vars": variables}, include_dashboard=False)
    try:
        worker = ray.remote(first_step)
        results = ray.get([worker.remote() for _ in range(WORKERS)])
    finally:
        ray.shutdown()
    processes, compiled, states = zip(*results, strict=True)
    assert len(set(processes)) == WORKERS
    kernels = Counter(name for names in compiled for name in names)
    assert set(kernels.values()) == {1}
    assert sum("advance" in name for name in kernels) == 1
    assert all(state == states[0] for state in states)


def check_episodes(episodes):
    columns = {"before": [], "actions": [], "after": [], "terminated": [], "truncated": []}
    for episode in episodes:
        observations = episode.get_observations()
        columns["before"].append(observations[:-1])
        columns["after"].append(observations[1:])
        columns["actions"].append(np.clip(episode.get_actions(), -1, 1))
        for name, over in (
            ("terminated", episode.is_terminated),
            ("truncated", episode.is_truncated),
        ):
            flags = np.zeros(len(observations) - 1, np.bool_)
            flags[-1] = over
            columns[name].append(flags)
    # One after the other, as if one lane had played them all.
    check_transitions(
        *(np.concatenate(parts)[:, None] for parts in columns.values()),
        action_rounding=ACTION_ROUNDING,
    )


def test_stored_transitions_follow_the_plant_and_end_where_it_ends(episodes):
    check_episodes(episodes)


def test_other_autoreset_mode_gives_wrong_ends_as_the_page_says():
    with pytest.raises(AssertionError):
        check_episodes(collected(autoreset_mode="SameStep"))


def test_replayed_samples_follow_the_plant(episodes):
    buffer = EpisodeReplayBuffer(capacity=10_000)
    buffer.add(episodes)
    # As its algorithms sample: episodes of one step.
    samples = buffer.sample(num_items=400, n_step=1, sample_episodes=True)
    assert {len(sample) for sample in samples} == {1}
    observations = np.array([sample.get_observations() for sample in samples])
    check_shuffled(
        observations[:, 0],
        np.clip([sample.get_actions()[0] for sample in samples], -1, 1),
        observations[:, 1],
        np.array([sample.is_terminated for sample in samples]),
        action_rounding=ACTION_ROUNDING,
    )
